"""Plan many sampled scenes: solved share, lengths of the solutions, times; killed and started again it goes on.

Every scene's result is one line of a JSON Lines file, written as soon as it is there."""

from __future__ import annotations

import hashlib
import os
import statistics
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import tyro

from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.errors import DvrError
from dvr_jax.model.predictor import SHIPPED, Predictor, load_network
from dvr_jax.planning.planner import plan
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.sampling import DEFAULT_DISTRIBUTION, SceneDistribution, ShapeChoice, scene_of_seed
from dvr_jax.scene.types import Scene
from dvr_jax.search.searches import GUIDED, SEARCHES
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.warm import warm_up
from dvr_jax.workcell.constants import MAXIMUM_OBJECTS


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
        """Refuse values that make no sense."""
        for name in ("number", "objects", "k_max", "workers"):
            if getattr(self, name) < 1:
                raise DvrError(f"--{name.replace('_', '-')} is {getattr(self, name)}; valid is 1 or more.")
        if self.objects > MAXIMUM_OBJECTS:
            raise DvrError(f"--objects is {self.objects}; valid are 1 to {MAXIMUM_OBJECTS}.")
        if not 0 <= self.cubes <= 1:
            raise DvrError(f"--cubes is {self.cubes}; valid is 0 to 1.")
        if self.seed < 0:
            raise DvrError(f"--seed is {self.seed}; valid is 0 or more.")
        if not self.time_limit > 0:
            raise DvrError(f"--time-limit is {self.time_limit}; valid is a positive number.")
        if self.search not in SEARCHES:
            raise DvrError(f"there is no search '{self.search}'; valid: {', '.join(SEARCHES)}.")
        if self.search not in GUIDED and self.network is not None:
            raise DvrError(f"--search {self.search} takes no --network; valid with one: {', '.join(GUIDED)}.")


def _scene(options: ScenesOptions, index: int) -> Scene:
    distribution = SceneDistribution(shape=options.shape, cube_share=options.cubes)
    return scene_of_seed(options.seed, index, options.objects, distribution)


@lru_cache(maxsize=1)
def _network(search: str, path: Path | None) -> Predictor | None:
    return load_network(search, path) if search in GUIDED else None


def _get_ready(options: ScenesOptions) -> None:
    """Compile or load everything before the first scene is timed."""
    warm_up(_scene(options, 0), options.k_max, _network(options.search, options.network))


def _plan_one(options: ScenesOptions, index: int) -> dict[str, object]:
    scene = _scene(options, index)
    network = _network(options.search, options.network)
    result = plan(scene, options.search, options.k_max, seed=0, time_limit=options.time_limit, network=network)
    return {
        "scene": index,
        "status": result.status,
        "words": result.action_descriptions,
        "seconds": {name: round(value, 3) for name, value in result.seconds.items()},
        "nlps": result.nlps,
        "verdicts": result.verdicts,
        "rejected": result.rejected,
        "passed": result.report is not None and result.report.passed,
    }


def _header(options: ScenesOptions) -> dict[str, object]:
    """What results must agree in to stand in one file."""
    chosen = asdict(options)
    for name in ("number", "workers", "out"):
        del chosen[name]
    chosen["network"] = _hash_network(options) if options.search in GUIDED else ""
    return chosen


def _hash_network(options: ScenesOptions) -> str:
    path = options.network or SHIPPED / f"{options.search}.npz"
    if path.is_dir():  # a training's, of which the latest checkpoint counts
        return load_network(options.search, path).checksum
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def results(options: ScenesOptions) -> Iterator[dict[str, object]]:
    """ConstraintValues of all scenes, those first that the file has."""
    options.check()
    _network(options.search, options.network)
    ledger = ResultsFile(options.out, _header(options))
    todo = ledger.missing(options.number)
    yield from (row for index, row in ledger.rows.items() if index < options.number)
    if not todo:
        return
    with worker_processes(options.workers, _get_ready, options) as pool:
        for future in as_completed([pool.submit(_plan_one, options, index) for index in todo]):
            row = future.result()
            ledger.add(row)
            words = f"{row['status']}, {len(row['words'])} actions"  # type: ignore[arg-type]
            print(f"  scene {row['scene']}: {words}, {row['seconds']['total']} s", file=sys.stderr, flush=True)  # type: ignore[index]
            yield row


def run(arguments: list[str]) -> int:
    """Plan the scenes, print the table."""
    options = tyro.cli(ScenesOptions, prog="python -m dvr_jax.bench scenes", args=arguments)
    rows = list(results(options))
    solved = [row for row in rows if row["words"]]
    lengths = Counter(len(row["words"]) for row in solved)  # type: ignore[arg-type]
    exhausted = sum(row["status"] == PlanStatus.EXHAUSTED for row in rows)
    passed = sum(bool(row["passed"]) for row in solved)
    print(f"{len(rows)} scenes of {options.objects} objects ({options.shape}, seed {options.seed}), {options.search}")
    print(f"solved {len(solved)} ({len(solved) / len(rows):.0%}); pass the independent check: {passed}")
    print(f"unsolved: {exhausted} with the tree exhausted, {len(rows) - len(solved) - exhausted} at the time limit")
    for length in range(2, options.k_max + 1):
        of_length = [row for row in solved if len(row["words"]) == length]  # type: ignore[arg-type]
        share = lengths[length] / len(rows)
        seconds = [row["seconds"]["total"] for row in of_length]  # type: ignore[index]
        median = f", median {statistics.median(seconds):.2f} s" if seconds else ""
        print(f"  length {length}: {lengths[length]:>4} ({share:5.1%}) {'#' * round(100 * share)}{median}")
    return 0
