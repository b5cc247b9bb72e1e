"""How long the answer takes for scenes without a solution, and how the results differ from those of an earlier version.

The scenes are planned as `dvr_jax.bench.scenes` does, with the same results file. Both files that are compared must be
of the same scenes, and of the same limits of actions and of time.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import tyro

from dvr_jax.bench.results_file import read_results
from dvr_jax.bench.scene_result import SceneResult
from dvr_jax.bench.scenes import ScenesOptions, header_options, plan_scenes
from dvr_jax.errors import DvrError

COMPARED = (
    "objects",
    "shape",
    "cubes",
    "workcell",
    "fixed",
    "seed",
    "search",
    "k_max",
    "time_limit",
)
"""Options in which the files that are compared must agree; the networks and the versions may differ."""


@dataclass(frozen=True)
class UnsolvableOptions(ScenesOptions):
    """Plan sampled scenes, and say how long the answer takes where there is no solution."""

    number: int = 1000
    """Scenes."""
    seed: int = 6
    """Of the scenes."""
    search: str = "dvr"
    """dvr, classifier, mbts or bfs."""
    before: Path | None = None
    """JSON Lines file of results of an earlier version, with which the new results are compared."""


def run(arguments: list[str]) -> int:
    """Plan the scenes and print the figures."""
    options = tyro.cli(UnsolvableOptions, prog="python -m dvr_jax.bench unsolvable", args=arguments)
    planned = scenes_options(options)
    planned.check()

    # A file that cannot be compared is refused before the scenes are planned.
    before = None
    if options.before is not None:
        before = read_before(options.before, header_options(planned))

    results = sorted(plan_scenes(planned), key=lambda result: result.scene)
    for line in describe(results, options.k_max, options.time_limit):
        print(line)
    if before is not None:
        for line in compare(before, results):
            print(line)
    return 0


def scenes_options(options: UnsolvableOptions) -> ScenesOptions:
    """Return the options of `bench scenes` that are among those of this benchmark."""
    return ScenesOptions(
        **{field.name: getattr(options, field.name) for field in fields(ScenesOptions)}
    )


def read_before(path: Path, wanted: Mapping[str, object]) -> list[SceneResult]:
    """Read the results of an earlier version.

    Args:
        path: The file.
        wanted: Options of the new results.

    Raises:
        DvrError: The file holds no results, or results of other scenes or limits.
    """
    options, rows = read_results(path)
    for name in COMPARED:
        # A tuple of the options is a list in the file.
        expected = list(wanted[name]) if isinstance(wanted[name], tuple) else wanted[name]  # type: ignore[call-overload]
        if options.get(name) != expected:
            flag = name.replace("_", "-")
            raise DvrError(
                f"{path} holds results of --{flag} {options.get(name)}, and this benchmark has --{flag} {expected}; "
                "only results of the same scenes and limits are compared."
            )
    return [SceneResult.from_row(row) for row in rows.values()]


def describe(results: Sequence[SceneResult], k_max: int, time_limit: float) -> list[str]:
    """Return lines on the times of all scenes and of those without a solution.

    Args:
        results: Results of all scenes.
        k_max: Largest number of actions.
        time_limit: Limit of each scene [s].
    """
    total = math.fsum(result.total_seconds for result in results)
    unsolved = [result for result in results if not result.solved]
    lines = [
        f"{len(results)} scenes, at most {k_max} actions and {time_limit:g} s each: {total:.1f} s in all",
        f"without a solution: {len(unsolved)}, of which {sum(is_open(each) for each in unsolved)} at the time limit",
    ]
    if unsolved:
        seconds = sorted(result.total_seconds for result in unsolved)
        share = math.fsum(seconds) / total if total else 0.0
        lines.append(
            f"seconds until their answer: median {statistics.median(seconds):.2f}, "
            f"95 % within {percentile(seconds, 0.95):.2f}, at most {seconds[-1]:.2f}; {share:.0%} of all time"
        )
        slowest = sorted(unsolved, key=lambda result: -result.total_seconds)[:5]
        named = ", ".join(f"{each.scene} ({each.total_seconds:.2f} s)" for each in slowest)
        lines.append(f"the slowest of them: scenes {named}")
    return lines


def is_open(result: SceneResult) -> bool:
    """Return whether it is not known if a scene has a solution."""
    return result.status == "time limit"


def percentile(ordered: Sequence[float], share: float) -> float:
    """Return the least of some numbers that is not exceeded by a share of them.

    Args:
        ordered: The numbers in increasing order, at least one.
        share: The share, above 0 and at most 1.
    """
    return ordered[max(math.ceil(share * len(ordered)) - 1, 0)]


def compare(before: Sequence[SceneResult], results: Sequence[SceneResult]) -> list[str]:
    """Return lines on the differences from earlier results: times, and each scene with another status or length.

    Args:
        before: Earlier results.
        results: New results.
    """
    known = {result.scene: result for result in before}
    pairs = [(known[each.scene], each) for each in results if each.scene in known]
    seconds = [
        math.fsum(result.total_seconds for result in part) for part in zip(*pairs, strict=True)
    ]
    lines = [f"compared with earlier results: {len(pairs)} scenes"]
    if pairs:
        old, new = seconds
        lines.append(f"their seconds: {old:.1f} before, {new:.1f} now ({new / max(old, 1e-9):.0%})")
    differing = [(old, new) for old, new in pairs if _outcome(old) != _outcome(new)]
    lines.append(f"scenes with another status or number of actions: {len(differing)}")
    lines += [
        f"  scene {new.scene}: {_outcome(old)} before, {_outcome(new)} now"
        for old, new in differing
    ]
    return lines


def _outcome(result: SceneResult) -> str:
    """Return the status of a result and the number of its actions in words."""
    return f"{result.status} ({result.length} actions)" if result.solved else result.status
