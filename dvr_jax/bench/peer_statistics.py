"""Counts and times of the comparison with `robotic`, for the printed tables and for the figures in the docs."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Side = Mapping[str, Any]
"""Verdict, time and measures of one solver on one problem."""


@dataclass(frozen=True)
class Comparison:
    """Two kinds of solutions that a table holds side by side."""

    title: str
    """Title of the table."""
    kind: str
    """"keyframes" or "path"."""
    ours: str
    """Which of our solutions."""
    theirs: str
    """Which of `robotic`'s."""


COMPARISONS = (
    Comparison("keyframes", "keyframes", "ours", "robotic"),
    Comparison("paths, both at the same slices alone", "path", "ours at slices", "robotic"),
    Comparison("paths, ours free between its slices, too", "path", "ours", "robotic"),
    Comparison(
        "paths, ours the same, robotic's of 3 times the slices",
        "path",
        "ours",
        "robotic finer",
    ),
    Comparison(
        "optimal paths, ours free between its slices, too", "path", "ours optimal", "robotic"
    ),
    Comparison(
        "optimal paths, ours the same, robotic's of 3 times the slices",
        "path",
        "ours optimal",
        "robotic finer",
    ),
)
"""The tables."""

EQUAL_COST = 1.01
"""Our cost is not above that of `robotic` if it is at most this multiple of it."""


@dataclass(frozen=True)
class Times:
    """Median CPU times of both solvers on the same problems."""

    ours: float
    """Ours [s]."""
    theirs: float
    """That of `robotic` [s]."""

    @property
    def ratio(self) -> float:
        """That of `robotic` as a multiple of ours."""
        return self.theirs / self.ours if self.ours else math.inf


@dataclass(frozen=True)
class SideBySide:
    """Both solvers' verdicts and times on problems of one kind."""

    problems: int
    """Problems that at least one of the two has tried."""
    both: int
    """Problems that both find feasible."""
    ours_alone: int
    """Problems that ours alone finds feasible."""
    theirs_alone: int
    """Problems that `robotic` alone finds feasible."""
    neither: int
    """Problems that neither finds feasible."""
    feasible_times: Times | None
    """Times over the problems that both find feasible; None where there are none."""
    infeasible_times: Times | None
    """Times over the problems that both try and find infeasible; None where there are none."""
    our_solutions: tuple[Side, ...]
    """Our feasible solutions."""
    their_solutions: tuple[Side, ...]
    """Those of `robotic`."""
    cost_ratios: tuple[float, ...]
    """Our costs as multiples of those of `robotic`, of the problems of which both solutions pass the check."""


def compare_sides(
    rows: Sequence[Mapping[str, Any]], kind: str, ours_name: str, theirs_name: str
) -> SideBySide:
    """Count the verdicts and take the median times of problems of one kind.

    Args:
        rows: results of problems.
        kind: "keyframes" or "path".
        ours_name: which of our solutions is compared.
        theirs_name: which solution of `robotic` it is compared with.

    Returns:
        Counts, times and solutions.
    """
    pairs = [(row[kind].get(ours_name), row[kind].get(theirs_name)) for row in rows]
    verdicts = [(_is_feasible(ours), _is_feasible(theirs)) for ours, theirs in pairs]

    # A solver that found no keyframes has not tried the path, so the times are of problems with both sides.
    times: dict[tuple[bool, bool], list[tuple[float, float]]] = {
        (True, True): [],
        (False, False): [],
    }
    for (ours, theirs), verdict in zip(pairs, verdicts, strict=True):
        if verdict in times and ours is not None and theirs is not None:
            times[verdict].append((ours["seconds"], theirs["seconds"]))

    return SideBySide(
        problems=len(rows),
        both=verdicts.count((True, True)),
        ours_alone=verdicts.count((True, False)),
        theirs_alone=verdicts.count((False, True)),
        neither=verdicts.count((False, False)),
        feasible_times=_median_times(times[True, True]),
        infeasible_times=_median_times(times[False, False]),
        our_solutions=tuple(ours for ours, _ in pairs if _is_feasible(ours)),
        their_solutions=tuple(theirs for _, theirs in pairs if _is_feasible(theirs)),
        cost_ratios=tuple(
            ours["cost"] / theirs["cost"]
            for ours, theirs in pairs
            if ours is not None and theirs is not None and _has_cost(ours) and _has_cost(theirs)
        ),
    )


def _has_cost(side: Side) -> bool:
    """Return whether a path passes the check and its cost is known; results of earlier versions have no costs."""
    return bool(side.get("passed")) and "cost" in side


def describe_costs(ratios: Sequence[float]) -> str | None:
    """Return how many of our costs are not above those of `robotic`, and their median ratio; None without any.

    Args:
        ratios: Our costs as multiples of those of `robotic`.
    """
    if not ratios:
        return None
    equal = sum(ratio <= EQUAL_COST for ratio in ratios)
    return f"{equal} of {len(ratios)} ({statistics.median(ratios):.2f})"


def _is_feasible(side: Side | None) -> bool:
    return side is not None and bool(side["feasible"])


def _median_times(pairs: Sequence[tuple[float, float]]) -> Times | None:
    if not pairs:
        return None
    return Times(
        ours=statistics.median(ours for ours, _ in pairs),
        theirs=statistics.median(theirs for _, theirs in pairs),
    )
