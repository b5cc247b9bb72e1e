"""The training targets of the paper, section "Training Targets": which prefixes of a sequence are promising.

For sequence i of a scene and goal, with actions a_1 .. a_K and verdict F, and every j in 1 .. K,

    f_j = 1   if F = 1,
    f_j = 1   if some sequence l of the same scene and goal has F = 1 and the same first j actions,
    f_j = 0   otherwise.

The first case is the second with l = i, so f_j = 1 exactly if a_1 .. a_j is a prefix of a feasible sequence.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError


def targets(sequences: Sequence[tuple[int, ...]], feasible: Sequence[bool]) -> list[NDArray[np.float32]]:
    """Targets f_j (K_i,) of each sequence, 0 or 1; all sequences are of one scene and one goal.

    `sequences` holds actions by number, `feasible` one verdict for each sequence.
    """
    if len(sequences) != len(feasible):
        raise DvrError(f"there are {len(sequences)} sequences and {len(feasible)} verdicts; valid is one for each.")
    promising = {
        sequence[:length]
        for sequence, verdict in zip(sequences, feasible, strict=True)
        if verdict
        for length in range(1, len(sequence) + 1)
    }
    return [np.array(promising_steps(sequence, promising), dtype=np.float32) for sequence in sequences]


def promising_steps(sequence: tuple[int, ...], promising: set[tuple[int, ...]]) -> list[float]:
    """f_j of one sequence, given all prefixes of feasible ones: ones as far as it follows them, then zeros."""
    shared = 0
    while shared < len(sequence) and sequence[: shared + 1] in promising:
        shared += 1
    return [1.0] * shared + [0.0] * (len(sequence) - shared)
