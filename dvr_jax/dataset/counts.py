"""Counts of what shards hold: scenes, labels by verdict, and infeasible sequences."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.labeled_scenes import LabeledScene, labeled_scenes
from dvr_jax.dataset.sequence_index import ActionNumbers
from dvr_jax.dataset.shards import read_columns


@dataclass(frozen=True, slots=True)
class LabelCounts:
    """Counts over shards."""

    scenes: int
    """Complete scenes, those without a label included."""

    solved: int
    """Scenes with a feasible sequence."""

    feasible: int
    """Labels of feasible sequences."""

    infeasible: int
    """Labels of single sequences that are infeasible."""

    refuted_prefixes: int
    """Labels of prefixes."""

    shortest: dict[int, int]
    """Number of scenes by the length of their shortest feasible sequence."""


def count_labels(infos: Iterable[ShardInfo]) -> LabelCounts:
    """Count the scenes and labels of shards."""
    scenes = 0
    verdicts: Counter[str] = Counter()
    shortest: Counter[int] = Counter()
    for info in infos:
        columns = read_columns(info)
        scenes += len(info.scenes)
        verdicts["feasible"] += int(columns.feasible.sum())
        verdicts["refuted prefix"] += int(columns.refuted_prefix.sum())
        verdicts["infeasible"] += int((~columns.feasible & ~columns.refuted_prefix).sum())

        length = np.diff(columns.action_ends)
        for row in range(len(info.scenes)):
            labels = columns.labels_of(row)
            feasible_lengths = length[labels][columns.feasible[labels]]
            if len(feasible_lengths):
                shortest[int(feasible_lengths.min())] += 1

    return LabelCounts(
        scenes=scenes,
        solved=shortest.total(),
        feasible=verdicts["feasible"],
        infeasible=verdicts["infeasible"],
        refuted_prefixes=verdicts["refuted prefix"],
        shortest=dict(sorted(shortest.items())),
    )


def count_infeasible_sequences(infos: Iterable[ShardInfo], k_max: int) -> int:
    """Count the sequences that are known to be infeasible.

    These have a label or begin with a refuted prefix; each counts once, also where both hold.

    Args:
        infos: the shards.
        k_max: the largest number of actions.

    Returns:
        The number of sequences.
    """
    return sum(
        _infeasible_sequences(labeled, k_max)
        for info in infos
        for labeled in labeled_scenes(info, read_columns(info))
    )


def _infeasible_sequences(labeled: LabeledScene, k_max: int) -> int:
    """Count the sequences of one scene that are known to be infeasible."""
    refuted = set(labeled.refuted_prefixes)
    total = 0
    for sequence in labeled.infeasible:
        if len(sequence) <= k_max and not _begins_with_refuted(sequence, refuted):
            total += 1

    # A prefix below another one is counted with that one.
    for prefix in labeled.refuted_prefixes:
        if not _begins_with_refuted(prefix, refuted):
            state = labeled.index.state_after(prefix)
            total += labeled.index.count_up_to(state, k_max - len(prefix))
    return total


def _begins_with_refuted(sequence: ActionNumbers, refuted: set[ActionNumbers]) -> bool:
    """Return whether a shorter prefix of a sequence is refuted."""
    return any(sequence[:length] in refuted for length in range(len(sequence)))
