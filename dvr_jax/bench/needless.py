"""Needless actions: the plans of the search `dvr` beside those of multi-bound search, which tries short ones first.

Each scene is planned three times: by `dvr`, by `dvr` with `shortest=True`, and by `mbts`. A plan with more actions than
that of `mbts` has needless ones. Every scene's result is one line of a JSON Lines file, written as soon as it is there.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from itertools import count, islice
from pathlib import Path

import tyro

from dvr_jax.bench.results_file import ResultsFile
from dvr_jax.bench.scenes import load_search_network
from dvr_jax.errors import DvrError
from dvr_jax.planning.planner import plan
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.sampling import SceneDistribution, ShapeChoice, scene_of_seed
from dvr_jax.scene.types import MAXIMUM_OBJECTS, Scene
from dvr_jax.search.warm import warm_up

WAYS: Mapping[str, tuple[str, bool]] = {
    "dvr": ("dvr", False),
    "dvr, shortest": ("dvr", True),
    "mbts": ("mbts", False),
}
"""The ways to plan a scene by their names: the search, and whether the least number of actions is asked for."""

Lengths = dict[str, int | None]
"""Number of actions of a scene's plan by each way; None where no plan was found."""


@dataclass(frozen=True)
class NeedlessOptions:
    """Plan sampled scenes by dvr, by dvr --shortest and by mbts, and count the plans with needless actions."""

    number: int = 300
    """Scenes."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    shape: ShapeChoice = "box"
    """Shapes of the objects."""
    sides: bool = False
    """Only scenes with an object on each side of the table's middle, x = 0, between the two arms."""
    seed: int = 6
    """Of the scenes."""
    k_max: int = 6
    """Largest number of actions."""
    time_limit: float = 60.0
    """For each plan [s]."""
    workers: int = os.cpu_count() or 1
    """Processes, one scene each at a time."""
    out: Path | None = None
    """JSON Lines file of results; scenes that it already has are not planned again."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option is out of its range.
        """
        for name in ("number", "objects", "k_max", "workers"):
            if getattr(self, name) < 1:
                flag = name.replace("_", "-")
                raise DvrError(f"--{flag} is {getattr(self, name)}; valid is 1 or more.")
        least = 2 if self.sides else 1
        if not least <= self.objects <= MAXIMUM_OBJECTS:
            raise DvrError(f"--objects is {self.objects}; valid are {least} to {MAXIMUM_OBJECTS}.")
        if self.seed < 0:
            raise DvrError(f"--seed is {self.seed}; valid is 0 or more.")
        if not self.time_limit > 0:
            raise DvrError(f"--time-limit is {self.time_limit}; valid is a positive number.")


def draw_scenes(options: NeedlessOptions) -> Iterator[Scene]:
    """Yield the scenes of a seed that the options ask for, without an end.

    Args:
        options: Which scenes.
    """
    distribution = SceneDistribution(shape=options.shape)
    for index in count():
        scene = scene_of_seed(options.seed, index, options.objects, distribution)
        if not options.sides or has_both_sides(scene):
            yield scene


def has_both_sides(scene: Scene) -> bool:
    """Return whether an object stands on each side of the table's middle."""
    x = [item.position[0] for item in scene.objects]
    return min(x) < 0 < max(x)


def lengths_of(scene: Scene, k_max: int, time_limit: float) -> Lengths:
    """Plan a scene by each way, and return the numbers of actions.

    Args:
        scene: A valid scene.
        k_max: Largest number of actions.
        time_limit: Limit of each plan [s].
    """
    found: Lengths = {}
    for name, (search, shortest) in WAYS.items():
        result = plan(
            scene,
            search,
            k_max,
            time_limit=time_limit,
            network=load_search_network(search, None),
            termination="feasible",
            shortest=shortest,
        )
        found[name] = len(result.actions) if result.solved else None
    return found


def run(arguments: list[str]) -> int:
    """Plan the scenes and print the table."""
    options = tyro.cli(NeedlessOptions, prog="python -m dvr_jax.bench needless", args=arguments)
    options.check()
    header = {name: value for name, value in asdict(options).items() if name not in _NOT_IN_HEADER}
    results = ResultsFile(options.out, header)
    todo = results.missing(options.number)
    if todo:
        _plan_missing(options, todo, results)

    rows = [results.rows[index]["lengths"] for index in range(options.number)]
    for line in table(rows):
        print(line)
    return 0


_NOT_IN_HEADER = ("number", "workers", "out")
"""Options in which results of one file may differ."""


def _plan_missing(options: NeedlessOptions, todo: Sequence[int], results: ResultsFile) -> None:
    """Plan the scenes that have no result, and keep their results."""
    scenes = list(islice(draw_scenes(options), max(todo) + 1))
    with worker_processes(options.workers, _prepare_worker, options) as pool:
        index_of = {
            pool.submit(lengths_of, scenes[index], options.k_max, options.time_limit): index
            for index in todo
        }
        for future in as_completed(index_of):
            index = index_of[future]
            results.add({"scene": index, "lengths": future.result()})
            print(f"  scene {index}: {future.result()}", file=sys.stderr, flush=True)


def _prepare_worker(options: NeedlessOptions) -> None:
    """Compile or load everything before the first time limit begins."""
    network = load_search_network("dvr", None)
    warm_up(next(draw_scenes(options)), options.k_max, network)


def table(rows: Sequence[Lengths]) -> list[str]:
    """Return lines that say how many plans have needless actions.

    Args:
        rows: Numbers of actions of each scene's plans.
    """
    lines = [f"{len(rows)} scenes, of which mbts solves {sum(r['mbts'] is not None for r in rows)}"]
    for name in WAYS:
        if name == "mbts":
            continue
        pairs = [
            (r[name], r["mbts"]) for r in rows if r[name] is not None and r["mbts"] is not None
        ]
        longer = [index for index, r in enumerate(rows) if is_longer(r, name)]
        share = len(longer) / len(pairs) if pairs else 0.0
        only = sum(r[name] is None and r["mbts"] is not None for r in rows)
        lines.append(
            f"{name}: {len(longer)} of {len(pairs)} plans have more actions than that of mbts ({share:.1%}); "
            f"{only} scenes are solved by mbts alone"
        )
        lines += [
            f"  scene {index}: {rows[index][name]} instead of {rows[index]['mbts']}"
            for index in longer
        ]
    return lines


def is_longer(lengths: Lengths, name: str) -> bool:
    """Return whether a plan has more actions than that of `mbts`.

    Args:
        lengths: Numbers of actions of one scene's plans.
        name: The way of the plan.
    """
    own = lengths[name]
    least = lengths["mbts"]
    return own is not None and least is not None and own > least
