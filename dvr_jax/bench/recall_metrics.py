"""The recall benchmark's counts as metrics: names, units and directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dvr_jax.bench.metrics import Direction, Metric

KINDS = ("keyframes", "path")
"""Kinds of problems."""

ALL_LENGTHS = "all"
"""Name of the line over problems of all lengths."""

PASSED = "paths that pass the check"
CHECKED = "feasible paths that were checked"


@dataclass(frozen=True)
class Counts:
    """Verdicts of the oracle and of ours on some problems."""

    problems: int
    """Problems."""
    oracle: int
    """Problems that the oracle finds feasible."""
    ours: int
    """Problems that ours finds feasible."""
    both: int
    """Problems that both find feasible."""

    @property
    def recall(self) -> float | None:
        """Share of the oracle's feasible problems that ours finds feasible; None where there are none."""
        return self.both / self.oracle if self.oracle else None


def count_pairs(pairs: Sequence[tuple[bool, bool]]) -> Counts:
    """Count the pairs of verdicts, the oracle's first."""
    return Counts(
        problems=len(pairs),
        oracle=sum(oracle for oracle, _ in pairs),
        ours=sum(ours for _, ours in pairs),
        both=sum(oracle and ours for oracle, ours in pairs),
    )


def metric_name(kind: str, length: int | str, count: str) -> str:
    """Name the metric of one count.

    Args:
        kind: one of `KINDS`.
        length: number of actions, or `ALL_LENGTHS`.
        count: a field of `Counts`, or "recall".

    Returns:
        The name.
    """
    return f"{kind} {length}: {count}"


def to_metrics(
    table: Sequence[tuple[str, int | str, Counts]], checked: Sequence[bool]
) -> list[Metric]:
    """Turn the table of counts into metrics.

    Args:
        table: kind, length and counts of each line.
        checked: whether each feasible path passes the independent check.

    Returns:
        The metrics.
    """
    metrics: list[Metric] = []
    for kind, length, counts in table:
        # The problems and the oracle's verdicts are frozen; the solver is to find what the oracle finds, or more.
        values = (
            ("problems", counts.problems, Direction.EQUAL),
            ("oracle", counts.oracle, Direction.EQUAL),
            ("ours", counts.ours, Direction.HIGHER),
            ("both", counts.both, Direction.HIGHER),
        )
        for name, value, direction in values:
            metrics.append(Metric(metric_name(kind, length, name), value, "problems", direction))

        if counts.recall is not None:
            name = metric_name(kind, length, "recall")
            metrics.append(Metric(name, counts.recall, "fraction", Direction.HIGHER))

    metrics.append(Metric(CHECKED, len(checked), "paths", Direction.HIGHER))
    metrics.append(Metric(PASSED, sum(checked), "paths", Direction.HIGHER))
    return metrics
