"""The training targets of the paper, section "Training Targets": the prefixes of a sequence that are promising.

For sequence i of a scene and goal, with actions a_1, ..., a_K and verdict F, and every j in 1, ..., K,

    f_j = 1   if F = 1,
    f_j = 1   if some sequence l of the same scene and goal has F = 1 and the same first j actions,
    f_j = 0   otherwise.

The first case is the second one with l = i, so f_j = 1 exactly if a_1, ..., a_j is a prefix of a feasible sequence.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from dvr_jax.dataset.sequence_index import ActionNumbers
from dvr_jax.errors import DvrError


def targets(
    sequences: Sequence[ActionNumbers],
    feasible: Sequence[bool],
) -> list[Float32[np.ndarray, " actions"]]:
    """Compute the targets f_j of sequences of one scene and one goal.

    Args:
        sequences: actions by number.
        feasible: one verdict for each sequence.

    Returns:
        For each sequence an array of 0 and 1, one for each of its actions.

    Raises:
        DvrError: the numbers of sequences and verdicts differ.
    """
    if len(sequences) != len(feasible):
        raise DvrError(
            f"there are {len(sequences)} sequences and {len(feasible)} verdicts; valid is one for each."
        )

    promising: set[ActionNumbers] = set()
    for sequence, verdict in zip(sequences, feasible, strict=True):
        if verdict:
            promising.update(prefixes_of(sequence))

    return [_targets_of(sequence, promising) for sequence in sequences]


def prefixes_of(sequence: ActionNumbers) -> list[ActionNumbers]:
    """Return the first action, the first two actions, and so on up to the whole sequence."""
    return [sequence[:length] for length in range(1, len(sequence) + 1)]


def _targets_of(
    sequence: ActionNumbers,
    promising: set[ActionNumbers],
) -> Float32[np.ndarray, " actions"]:
    """Return ones as far as a sequence follows a feasible one, then zeros."""
    shared = 0
    while shared < len(sequence) and sequence[: shared + 1] in promising:
        shared += 1

    values = np.zeros(len(sequence), dtype=np.float32)
    values[:shared] = 1.0
    return values
