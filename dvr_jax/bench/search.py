"""The paper's main figures on held-out scenes: total time and NLPs solved by length of the solution.

The same scenes are searched by the network, by the feasibility classifier and by multi-bound tree search. Each search
`NAME` gets a file `NAME.jsonl` (resumable), and `search.png` holds the box plots of figures 5 to 7 of the paper.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from dvr_jax.bench.scene_result import SceneResult, group_by_length
from dvr_jax.bench.scenes import ScenesOptions, plan_scenes
from dvr_jax.bench.search_plots import save_plots
from dvr_jax.bench.search_statistics import (
    Table,
    compare_lengths,
    count_feasible,
    first_right_share,
    speed_ups,
    stage_share,
)
from dvr_jax.errors import DvrError
from dvr_jax.model.predictor import SHIPPED
from dvr_jax.search.searches import GUIDED, SEARCHES

BASELINE = "mbts"
"""The search that the others' speed-up is over."""

TABLE_HEAD = (
    "  length scenes   total s   first right   proposed   paths tried   path NLPs   "
    "keyframe NLPs (medians; means)"
)


@dataclass(frozen=True)
class SearchOptions:
    """Solve the same scenes by several searches and compare them."""

    out: Path
    """Folder for results and plots; what it already has is not computed again."""
    searches: tuple[str, ...] = ("dvr", "classifier", "mbts")
    """Of dvr, classifier, mbts, bfs."""
    networks: Path = SHIPPED
    """Folder with a network NAME.npz for each of the guided searches (`network.npz` of a training, renamed); by default
    the shipped ones."""
    number: int = 500
    """Scenes."""
    objects: int = 2
    """Objects in each scene, 1 to 8."""
    seed: int = 2
    """Of the scenes. The shipped networks were trained on seeds 100 to 102."""
    k_max: int = 6
    """Largest number of actions."""
    time_limit: float = 60.0
    """For each scene and search [s]."""
    workers: int = ScenesOptions.workers
    """Processes, one scene each at a time."""


def run(arguments: list[str]) -> int:
    """Solve the scenes, print the tables and plot them."""
    options = tyro.cli(SearchOptions, prog="python -m dvr_jax.bench search", args=arguments)
    if not options.searches:
        raise DvrError(f"--searches names none; valid are {', '.join(SEARCHES)}.")

    tables = {name: _search_scenes(options, name) for name in options.searches}

    print(
        f"{options.number} scenes of {options.objects} objects (seed {options.seed}), {options.time_limit:g} s each"
    )
    feasible = count_feasible(list(tables.values()))
    for name, table in tables.items():
        _print_search(name, list(table.values()), feasible, options.k_max)

    if BASELINE in tables:
        for name, table in tables.items():
            if name != BASELINE:
                _print_speed_up(name, table, tables[BASELINE], options.k_max)

    save_plots(options.out / "search.png", tables, options.k_max)
    return 0


def _search_scenes(options: SearchOptions, name: str) -> Table:
    """Results of one search, in the order of the scenes."""
    scenes_options = ScenesOptions(
        number=options.number,
        objects=options.objects,
        seed=options.seed,
        k_max=options.k_max,
        time_limit=options.time_limit,
        workers=options.workers,
        search=name,
    )
    network = options.networks / f"{name}.npz" if name in GUIDED else None
    out = options.out / f"{name}.jsonl"
    results = plan_scenes(replace(scenes_options, network=network, out=out))
    return {result.scene: result for result in sorted(results, key=lambda result: result.scene)}


def _median(results: Sequence[SceneResult], value: Callable[[SceneResult], float]) -> str:
    return f"{statistics.median(map(value, results)):.3g}" if results else "-"


def _print_search(name: str, results: Sequence[SceneResult], feasible: int, k_max: int) -> None:
    """Print one search's times and counts by length."""
    solved = [result for result in results if result.solved]
    network_share = stage_share(solved, "network")
    share = ""
    if network_share:
        share = f"; of the time, network {network_share:.1%}, its depth image {stage_share(solved, 'image'):.1%}"
    print(
        f"{name}: {len(solved)} solved, {feasible - len(solved)} of the {feasible} feasible scenes not{share}"
    )

    print(TABLE_HEAD)
    for length, of_length in group_by_length(solved, k_max).items():
        if of_length:
            _print_length(length, of_length)

    unsolved = [result for result in results if not result.solved]
    median = _median(unsolved, lambda result: result.total_seconds)
    all_seconds = sum(result.total_seconds for result in results)
    print(f"  unsolved {len(unsolved):>4} {median:>9}   all scenes together: {all_seconds:.0f} s")


def _print_length(length: int, results: Sequence[SceneResult]) -> None:
    values: tuple[Callable[[SceneResult], float], ...] = (
        lambda result: result.sequences_proposed,
        lambda result: result.paths_tried,
        lambda result: result.path_nlps,
        lambda result: result.keyframe_nlps,
    )
    columns = []
    for value in values:
        mean = statistics.mean(map(value, results))
        columns.append(f"{_median(results, value)}; {mean:<8.3g}".rjust(13))

    seconds = _median(results, lambda result: result.total_seconds)
    first_right = first_right_share(results)
    print(f"  {length:>6} {len(results):>6} {seconds:>9} {first_right:>12.0%} {' '.join(columns)}")


def _print_speed_up(name: str, ours: Table, theirs: Table, k_max: int) -> None:
    """Print how much faster one search is than the baseline, and whether its plans are longer."""
    print(f"speed-up of {name} over {BASELINE}, scenes where both found the same length: median")
    for length in range(1, k_max + 1):
        ratios = speed_ups(ours, theirs, length)
        if ratios:
            print(f"  {length:>6} {len(ratios):>6} scenes {statistics.median(ratios):>8.1f}x")

    lengths = compare_lengths(ours, theirs)
    print(
        f"  of {lengths.both} solved by both, {name}'s solution has more actions in {lengths.longer}, "
        f"fewer in {lengths.shorter}"
    )
