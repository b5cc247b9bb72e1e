"""What `python -m dvr_jax.bench peers` prints of its rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dvr_jax.bench.peer_statistics import (
    COMPARISONS,
    Comparison,
    SideBySide,
    Times,
    compare_sides,
    describe_costs,
)
from dvr_jax.solver.continuous_collision import PATH_SAMPLES

FINER = PATH_SAMPLES
"""Slices of `robotic`'s finer paths as a multiple of ours."""

LEGEND = """\
feasible: by each one's own verdict (robotic's: its scaled violations add up to less than 0.1, equalities and
inequalities apart). times: medians of CPU time [ms], first of problems that both find feasible, then of those that both
try and find infeasible; ratio: robotic's median as a multiple of ours. by our measure: of the solutions that robotic
calls feasible, those within our tolerances everywhere, and with paths looked at in their slices only. A solver has no
path where it found no keyframes. Of finer paths our measure is not taken; robotic's own verdict is stricter there,
since its sums have more terms. check: feasible paths that the independent check accepts, with up to 3 mm of
penetration. cost: how many of the paths that it accepts of both cost us no more than 1 % above robotic, and the median
ratio of costs."""


def print_tables(rows: Sequence[dict[str, Any]]) -> None:
    """Print verdicts and times of each comparison, by length and source."""
    print(LEGEND)
    for comparison in COMPARISONS:
        _print_table(rows, comparison)


def _print_table(rows: Sequence[dict[str, Any]], comparison: Comparison) -> None:
    last = (
        "by our measure"
        if comparison.kind == "keyframes"
        else "by our measure    | check: ours | robotic's | cost"
    )
    verdicts = f"{'count':>5} {'both':>5} {'ours':>5} {'robotic':>8} {'neither':>8}"
    times = f"{'ours':>7} {'robotic':>8} {'ratio':>6}"
    print(f"\n{comparison.title}")
    print(
        f"{'':<10}{'':>5} {'feasible in':<29} | {'both feasible':<23} | {'both infeasible':<23} |"
    )
    print(f"{'':<10}{verdicts} | {times} | {times} | {last}")

    # Paths: of what at least one of the two has tried.
    tried = [row for row in rows if row[comparison.kind]]
    for name in (*sorted({row["length"] for row in rows}), "drawn", "found", "all"):
        chosen = [row for row in tried if name in (row["length"], row["source"], "all")]
        if chosen:
            sides = compare_sides(chosen, comparison.kind, comparison.ours, comparison.theirs)
            print(f"{name:<10}" + _format_line(sides, comparison.kind))


def _format_line(sides: SideBySide, kind: str) -> str:
    """Verdicts and median times of the problems of one kind and length."""
    cells = [
        f"{sides.problems:>5} {sides.both:>5} {sides.ours_alone:>5} {sides.theirs_alone:>8} {sides.neither:>8}",
        _format_times(sides.feasible_times),
        _format_times(sides.infeasible_times),
        _format_measures(sides, kind),
    ]
    if kind == "path":
        for solutions in (sides.our_solutions, sides.their_solutions):
            passed = sum(solution["passed"] for solution in solutions)
            cells.append(f"{passed:>4} of {len(solutions):>3}")
        cells.append(describe_costs(sides.cost_ratios) or "-")
    return " | ".join(cells)


def _format_measures(sides: SideBySide, kind: str) -> str:
    """Number of `robotic`'s solutions that are within our tolerances."""
    names = ("ratio",) if kind == "keyframes" else ("ratio", "ratio at slices")
    measured = [
        solution["our measure"] for solution in sides.their_solutions if "our measure" in solution
    ]

    within: list[str] = []
    for name in names:
        number = sum(measure[name] <= 1 for measure in measured)
        within.append(f"{number:>4}" if measured else f"{'-':>4}")
    return " ".join(within) + f" of {len(sides.their_solutions):>3}"


def _format_times(times: Times | None) -> str:
    """Medians of ours and of `robotic`'s [ms], and the latter as a multiple of ours."""
    if times is None:
        return f"{'-':>7} {'-':>8} {'-':>6}"
    return f"{1e3 * times.ours:>7.0f} {1e3 * times.theirs:>8.0f} {times.ratio:>6.1f}"
