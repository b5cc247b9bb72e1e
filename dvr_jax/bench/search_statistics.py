"""Statistics over searches of the same scenes, for the printed tables and for the figures in the docs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dvr_jax.bench.scene_result import SceneResult

Table = Mapping[int, SceneResult]
"""Results of one search by the number of the scene."""


def count_feasible(tables: Sequence[Table]) -> int:
    """Count the scenes that at least one of the searches solves."""
    solved = {scene for table in tables for scene, result in table.items() if result.solved}
    return len(solved)


def speed_ups(ours: Table, theirs: Table, length: int) -> list[float]:
    """Compare the total times of two searches on scenes where both found plans of one length.

    Args:
        ours: results of the search that is compared.
        theirs: results of the search that it is compared with.
        length: number of actions of the plans.

    Returns:
        For each such scene, their time as a multiple of ours.
    """
    ratios = []
    for scene, result in ours.items():
        other = theirs.get(scene)
        if other is not None and result.length == other.length == length:
            ratios.append(other.total_seconds / result.total_seconds)
    return ratios


@dataclass(frozen=True)
class LengthComparison:
    """How the lengths of two searches' plans compare over the scenes that both solve."""

    both: int
    """Scenes that both solve."""
    longer: int
    """Scenes where ours has more actions."""
    shorter: int
    """Scenes where ours has fewer actions."""


def compare_lengths(ours: Table, theirs: Table) -> LengthComparison:
    """Compare the lengths of two searches' plans.

    Args:
        ours: results of the search that is compared.
        theirs: results of the search that it is compared with.

    Returns:
        The counts.
    """
    both = [
        scene
        for scene, result in ours.items()
        if result.solved and scene in theirs and theirs[scene].solved
    ]
    return LengthComparison(
        both=len(both),
        longer=sum(ours[scene].length > theirs[scene].length for scene in both),
        shorter=sum(ours[scene].length < theirs[scene].length for scene in both),
    )


def first_right_share(results: Sequence[SceneResult]) -> float:
    """Share of the solved scenes where the first sequence that the search proposed is the plan."""
    first = [result.sequences_proposed == 1 for result in results]
    return sum(first) / len(first)


def stage_share(results: Sequence[SceneResult], stage: str) -> float:
    """Share of the total time that one stage takes, over all these scenes together.

    Args:
        results: results of scenes.
        stage: name of the stage, such as "network" or "image".

    Returns:
        The share, 0 where there are no results.
    """
    total = sum(result.total_seconds for result in results)
    stage_seconds = sum(result.seconds.get(stage, 0.0) for result in results)
    return stage_seconds / total if total else 0.0
