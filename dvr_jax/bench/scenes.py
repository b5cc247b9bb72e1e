"""Plan many sampled scenes by one search: solved share, lengths of the solutions, times.

Every scene's result is one line of a JSON Lines file, written as soon as it is there. A benchmark that was stopped
goes on where it was.
"""

from __future__ import annotations

import hashlib
import math
import os
import statistics
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import tyro

from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.bench.scene_result import SceneResult, group_by_length
from dvr_jax.errors import DvrError
from dvr_jax.model.predictor import SHIPPED, Predictor, load_network
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.distribution import validate_request
from dvr_jax.scene.sampling import (
    DEFAULT_DISTRIBUTION,
    SceneDistribution,
    ShapeChoice,
    scene_of_seed,
)
from dvr_jax.scene.types import MAXIMUM_OBJECTS, Scene
from dvr_jax.search.searches import GUIDED, SEARCHES
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.warm import warm_up
from dvr_jax.workcell.workcell import named_workcell


@dataclass(frozen=True)
class ScenesOptions:
    """Plan sampled scenes and say how many are solved, and with how many actions."""

    number: int = 100
    """Scenes."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    shape: ShapeChoice = "box"
    """Shapes of the objects."""
    cubes: float = DEFAULT_DISTRIBUTION.cube_share
    """Share of the boxes that are small cubes, which one arm cannot hand to the other in the air."""
    workcell: str = "facing"
    """facing (the paper's), facing-1.0, facing-1.6, side-by-side or single."""
    fixed: tuple[int, int] = DEFAULT_DISTRIBUTION.fixed_bodies
    """Least and largest number of fixed bodies in a scene."""
    seed: int = 1
    """Of the scenes. The shipped networks were trained on seeds 100 to 102."""
    search: str = "mbts"
    """dvr, classifier, mbts or bfs."""
    network: Path | None = None
    """Trained network of the search's kind, for dvr and classifier; by default the shipped one."""
    k_max: int = 6
    """Largest number of actions."""
    time_limit: float = 60.0
    """For each scene [s]."""
    workers: int = os.cpu_count() or 1
    """Processes, one scene each at a time."""
    out: Path | None = None
    """JSON Lines file of results; scenes that it already has are not planned again."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option is out of its range, or the search does not exist or takes no network.
        """
        for name in ("number", "objects", "k_max", "workers"):
            value = getattr(self, name)
            if value < 1:
                raise DvrError(f"--{name.replace('_', '-')} is {value}; valid is 1 or more.")

        if self.objects > MAXIMUM_OBJECTS:
            raise DvrError(f"--objects is {self.objects}; valid are 1 to {MAXIMUM_OBJECTS}.")
        if not 0 <= self.cubes <= 1:
            raise DvrError(f"--cubes is {self.cubes}; valid is 0 to 1.")
        if self.seed < 0:
            raise DvrError(f"--seed is {self.seed}; valid is 0 or more.")
        if not self.time_limit > 0:
            raise DvrError(f"--time-limit is {self.time_limit}; valid is a positive number.")

        validate_request(self.objects, SceneDistribution(fixed_bodies=self.fixed))
        named_workcell(self.workcell)

        if self.search not in SEARCHES:
            raise DvrError(f"there is no search '{self.search}'; valid: {', '.join(SEARCHES)}.")
        if self.search not in GUIDED and self.network is not None:
            raise DvrError(
                f"--search {self.search} takes no --network; valid with one: {', '.join(GUIDED)}."
            )


def _scene(options: ScenesOptions, index: int) -> Scene:
    distribution = SceneDistribution(
        shape=options.shape, cube_share=options.cubes, fixed_bodies=options.fixed
    )
    return scene_of_seed(
        options.seed, index, options.objects, distribution, named_workcell(options.workcell)
    )


@lru_cache(maxsize=1)
def load_search_network(search: str, path: Path | None) -> Predictor | None:
    """Load the network of a search once.

    Args:
        search: Name of the search.
        path: File or folder of the network; None is the shipped one.

    Returns:
        The network; None for a search that none guides.
    """
    return load_network(search, path) if search in GUIDED else None


def prepare_worker(options: ScenesOptions) -> None:
    """Compile or load everything before the first scene is timed."""
    network = load_search_network(options.search, options.network)

    # Programs depend on the number of fixed bodies: one scene of each number.
    scenes = [_scene(options, index) for index in range(options.number)]
    for scene in {len(scene.fixed): scene for scene in scenes}.values():
        warm_up(scene, options.k_max, network)


def plan_scene(options: ScenesOptions, index: int, termination: str = "optimal") -> Plan:
    """Plan one of the scenes.

    Args:
        options: The scenes, and how they are planned.
        index: Number of the scene.
        termination: "feasible" or "optimal", the termination of paths.
    """
    return plan(
        _scene(options, index),
        options.search,
        options.k_max,
        seed=0,
        time_limit=options.time_limit,
        network=load_search_network(options.search, options.network),
        termination=termination,
    )


def _plan_one(options: ScenesOptions, index: int) -> SceneResult:
    result = plan_scene(options, index)
    return SceneResult(
        scene=index,
        status=result.status,
        action_descriptions=result.action_descriptions,
        seconds=result.seconds,
        nlps=result.nlps,
        verdicts=result.verdicts,
        rejected=result.rejected,
        passed=result.report is not None and result.report.passed,
        deepest_penetration=result.report.deepest_penetration if result.report else math.nan,
    )


def header_options(options: ScenesOptions) -> dict[str, object]:
    """Name what results must agree in to stand in one file."""
    chosen = asdict(options)
    for name in ("number", "workers", "out"):
        del chosen[name]
    chosen["network"] = _hash_network(options) if options.search in GUIDED else ""
    return chosen


def _hash_network(options: ScenesOptions) -> str:
    path = options.network or SHIPPED / f"{options.search}.npz"

    # A folder is a training's, of which the latest checkpoint counts.
    if path.is_dir():
        return load_network(options.search, path).checksum

    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def plan_scenes(options: ScenesOptions) -> Iterator[SceneResult]:
    """Give the results of all scenes, first those that the file has.

    Raises:
        DvrError: An option makes no sense, or the file holds results of other options or of another version.
    """
    options.check()

    # The network is loaded here once, so that a bad file is refused before any worker starts.
    load_search_network(options.search, options.network)

    results_file = ResultsFile(options.out, header_options(options))
    todo = results_file.missing(options.number)
    for index, row in results_file.rows.items():
        if index < options.number:
            yield SceneResult.from_row(row)
    if not todo:
        return

    with worker_processes(options.workers, prepare_worker, options) as pool:
        futures = [pool.submit(_plan_one, options, index) for index in todo]
        for future in as_completed(futures):
            row = future.result().to_row()
            result = SceneResult.from_row(row)
            results_file.add(row)
            print(
                f"  scene {result.scene}: {result.status}, {result.length} actions, {result.total_seconds} s",
                file=sys.stderr,
                flush=True,
            )
            yield result


def run(arguments: list[str]) -> int:
    """Plan the scenes and print the table."""
    options = tyro.cli(ScenesOptions, prog="python -m dvr_jax.bench scenes", args=arguments)
    results = list(plan_scenes(options))
    print(
        f"{len(results)} scenes of {options.objects} objects ({options.shape}, seed {options.seed}), {options.search}"
    )

    solved = [result for result in results if result.solved]
    exhausted = sum(result.status == PlanStatus.EXHAUSTED for result in results)
    passed = sum(result.passed for result in solved)
    deepest = max((result.deepest_penetration for result in solved), default=0.0)
    late = len(results) - len(solved) - exhausted
    print(
        f"solved {len(solved)} ({len(solved) / len(results):.0%}); pass the independent check: {passed}"
    )
    print(f"deepest penetration in any plan: {1000 * deepest:.2f} mm")
    print(f"unsolved: {exhausted} with the tree exhausted, {late} at the time limit")

    for length, of_length in group_by_length(results, options.k_max).items():
        # A plan needs a grasp and a place, so a length of 1 does not occur.
        if length >= 2:
            _print_length(length, of_length, len(results))
    return 0


def _print_length(length: int, results: Sequence[SceneResult], number_of_scenes: int) -> None:
    share = len(results) / number_of_scenes
    bar = "#" * round(100 * share)
    seconds = [result.total_seconds for result in results]
    median = f", median {statistics.median(seconds):.2f} s" if seconds else ""
    print(f"  length {length}: {len(results):>4} ({share:5.1%}) {bar}{median}")
