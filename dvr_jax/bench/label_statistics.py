"""Counts over labels that an oracle judged again, for the printed table and for the figures in the docs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class VerdictCounts:
    """How many labels of one verdict the oracle confirms."""

    verdict: str
    """"feasible" or "infeasible by BOUND"."""
    confirmed: int
    """Labels that the oracle confirms."""
    judged: int
    """Labels that it judged."""

    @property
    def share(self) -> float:
        """Confirmed share."""
        return self.confirmed / self.judged


def count_verdicts(rows: Sequence[Mapping[str, Any]]) -> list[VerdictCounts]:
    """Count the confirmed rows of each verdict, in alphabetical order of the verdicts."""
    confirmed: dict[str, list[bool]] = defaultdict(list)
    for row in rows:
        confirmed[row["verdict"]].append(bool(row["confirmed"]))
    return [
        VerdictCounts(name, sum(flags), len(flags)) for name, flags in sorted(confirmed.items())
    ]


def infeasible_share(counts: Sequence[VerdictCounts], totals: Mapping[str, int]) -> float | None:
    """Estimate the share of all infeasible labels that holds, each verdict weighted by its number of labels.

    Args:
        counts: confirmed and judged labels of each verdict.
        totals: number of labels of each verdict in the data.

    Returns:
        The share; None where no infeasible label was judged.
    """
    refuted = [item for item in counts if item.verdict != "feasible"]
    weight = sum(totals[item.verdict] for item in refuted)
    if not weight:
        return None
    return sum(item.share * totals[item.verdict] for item in refuted) / weight
