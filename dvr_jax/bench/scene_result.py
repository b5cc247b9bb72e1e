"""The result of planning one scene, as the benchmarks keep it and as the figures are counted from it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

PENETRATION_KEY = "deepest_penetration"
"""Key of the deepest penetration [m] in a row on disk."""

DESCRIPTIONS_KEY = "words"
"""Key of the action descriptions in a row on disk. Rows since version 0.2 have it, so the name stays."""


@dataclass(frozen=True)
class SceneResult:
    """What one search found for one scene."""

    scene: int
    """Number of the scene."""
    status: str
    """"solved", "tree exhausted" or "time limit"."""
    action_descriptions: tuple[str, ...]
    """The plan's actions in words; empty unless solved."""
    seconds: Mapping[str, float]
    """Time by stage, and "total" [s]."""
    nlps: Mapping[str, int]
    """NLPs solved by bound; every start counts."""
    verdicts: Mapping[str, int]
    """Prefixes judged by bound; "leaf" counts the sequences that reach the goal."""
    rejected: int
    """Feasible paths that the independent check refused."""
    passed: bool
    """Whether the motion passed the independent check."""
    deepest_penetration: float = math.nan
    """How far two bodies penetrate at most in the motion [m]; NaN without a plan, and in rows before version 0.9."""

    @property
    def solved(self) -> bool:
        """Whether there is a plan."""
        return bool(self.action_descriptions)

    @property
    def length(self) -> int:
        """Number of actions of the plan, 0 where there is none."""
        return len(self.action_descriptions)

    @property
    def total_seconds(self) -> float:
        """Seconds from image to checked motion."""
        return self.seconds["total"]

    @property
    def path_nlps(self) -> int:
        """Path NLPs solved; every start counts."""
        return self.nlps.get("path", 0)

    @property
    def paths_tried(self) -> int:
        """Sequences whose path was tried."""
        return self.verdicts.get("path", 0)

    @property
    def sequences_proposed(self) -> int:
        """Sequences that reach the goal and were considered, also those that a keyframe bound refuted.

        It is the number of NLPs of a search that solves each proposed sequence as one path.
        """
        return self.verdicts.get("leaf", 0)

    @property
    def keyframe_nlps(self) -> int:
        """Keyframe NLPs solved, of whole prefixes and of single objects."""
        return sum(self.nlps.get(bound, 0) for bound in ("window", "pose", "sequence"))

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> SceneResult:
        """Read a row of a results file."""
        return cls(
            scene=int(row["scene"]),
            status=str(row["status"]),
            action_descriptions=tuple(row[DESCRIPTIONS_KEY]),
            seconds=row["seconds"],
            nlps=row["nlps"],
            verdicts=row["verdicts"],
            rejected=int(row["rejected"]),
            passed=bool(row["passed"]),
            deepest_penetration=float(row.get(PENETRATION_KEY, math.nan)),
        )

    def to_row(self) -> dict[str, Any]:
        """Give the row of a results file."""
        row = {
            "scene": self.scene,
            "status": self.status,
            DESCRIPTIONS_KEY: list(self.action_descriptions),
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "nlps": dict(self.nlps),
            "verdicts": dict(self.verdicts),
            "rejected": self.rejected,
            "passed": self.passed,
        }
        # JSON has no NaN.
        if not math.isnan(self.deepest_penetration):
            row[PENETRATION_KEY] = self.deepest_penetration
        return row


def group_by_length(results: Sequence[SceneResult], k_max: int) -> dict[int, list[SceneResult]]:
    """Group results by the number of actions of their plans.

    Args:
        results: results of any scenes; those without a plan are left out.
        k_max: largest number of actions.

    Returns:
        The results of each length from 1 to k_max.
    """
    groups: dict[int, list[SceneResult]] = {length: [] for length in range(1, k_max + 1)}
    for result in results:
        if result.length in groups:
            groups[result.length].append(result)
    return groups
