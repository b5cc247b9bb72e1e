"""What `python -m dvr_jax.bench peers` prints of its rows."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Any

from dvr_jax.solver.continuous_collision import PATH_SAMPLES

LEGEND = """\
feasible: by each one's own verdict (robotic's: its scaled violations add up to less than 0.1, equalities and
inequalities apart). times: medians of CPU time [ms], first of problems that both find feasible, then of those that both
try and find infeasible; ratio: robotic's median as a multiple of ours. by our measure: of the solutions that robotic
calls feasible, those within our tolerances everywhere, and with paths looked at in their slices only. A solver has no
path where it found no keyframes. Of finer paths our measure is not taken; robotic's own verdict is stricter there,
since its sums have more terms. check: feasible paths that the independent check accepts."""

FINER = PATH_SAMPLES
"""Slices of `robotic`'s finer paths as a multiple of ours."""

COMPARISONS = {
    "keyframes": ("keyframes", "ours", "robotic"),
    "paths, both at the same slices alone": ("path", "ours at slices", "robotic"),
    "paths, ours free between its slices, too": ("path", "ours", "robotic"),
    f"paths, ours the same, robotic's of {FINER} times the slices": ("path", "ours", "robotic finer"),
}
"""Title of each table: kind of problem, and the two that it holds side by side."""


def _side_by_side(rows: Sequence[dict[str, Any]], kind: str, ours_name: str, their_name: str) -> str:
    """Verdicts and median times of the problems of one kind and length."""
    pairs = [(row[kind].get(ours_name), row[kind].get(their_name)) for row in rows]
    verdicts = [tuple(side is not None and bool(side["feasible"]) for side in pair) for pair in pairs]
    counts = [verdicts.count(verdict) for verdict in ((True, True), (True, False), (False, True), (False, False))]
    cells = [f"{len(rows):>5} {counts[0]:>5} {counts[1]:>5} {counts[2]:>8} {counts[3]:>8}"]
    for wanted in ((True, True), (False, False)):
        tried = [
            (ours["seconds"], theirs["seconds"])
            for (ours, theirs), verdict in zip(pairs, verdicts, strict=True)
            if verdict == wanted and ours is not None and theirs is not None
        ]
        cells.append(_times(tried))
    found = [[side for side in sides if side is not None and side["feasible"]] for sides in zip(*pairs, strict=True)]
    measured = [theirs["our measure"] for theirs in found[1] if "our measure" in theirs]
    names = ("ratio",) if kind == "keyframes" else ("ratio", "ratio at slices")
    within = [sum(measure[name] <= 1 for measure in measured) for name in names] if measured else ["-" for _ in names]
    cells.append(" ".join(f"{number:>4}" for number in within) + f" of {len(found[1]):>3}")
    if kind == "path":
        cells += [f"{sum(side['passed'] for side in sides):>4} of {len(sides):>3}" for sides in found]
    return " | ".join(cells)


def _times(pairs: Sequence[tuple[float, float]]) -> str:
    """Medians of ours and of `robotic`'s [ms], and the latter as a multiple of ours."""
    if not pairs:
        return f"{'-':>7} {'-':>8} {'-':>6}"
    ours, theirs = (1e3 * statistics.median(seconds) for seconds in zip(*pairs, strict=True))
    return f"{ours:>7.0f} {theirs:>8.0f} {theirs / ours if ours else math.inf:>6.1f}"


def print_tables(rows: Sequence[dict[str, Any]]) -> None:
    """Verdicts and times of each comparison, by length and source."""
    print(LEGEND)
    for title, (kind, ours, theirs) in COMPARISONS.items():
        last = "by our measure" if kind == "keyframes" else "by our measure    | check: ours | robotic's"
        print(f"\n{title}\n{'':<10}{'':>5} {'feasible in':<29} | {'both feasible':<23} | {'both infeasible':<23} |")
        verdicts = f"{'count':>5} {'both':>5} {'ours':>5} {'robotic':>8} {'neither':>8}"
        times = f"{'ours':>7} {'robotic':>8} {'ratio':>6}"
        print(f"{'':<10}{verdicts} | {times} | {times} | {last}")
        # Paths: of what at least one of the two has tried.
        tried = [row for row in rows if row[kind]]
        for name in (*sorted({row["length"] for row in rows}), "drawn", "found", "all"):
            chosen = [row for row in tried if name in (row["length"], row["source"], "all")]
            if chosen:
                print(f"{name:<10}" + _side_by_side(chosen, kind, ours, theirs))
