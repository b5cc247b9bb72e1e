"""The training targets of the paper, section "Training Targets": which prefixes of a sequence are promising.

For sequence i of a scene and goal, with actions a_1 .. a_K and verdict F, and every j in 1 .. K,

    f_j = 1   if F = 1,
    f_j = 1   if some sequence l of the same scene and goal has F = 1 and the same first j actions,
    f_j = 0   otherwise.

The first case is the second with l = i, so f_j = 1 exactly if a_1 .. a_j is a prefix of a feasible sequence.

A sweep ends with the first few feasible sequences, so the last case holds of many prefixes that only nobody has looked
at: they would be learned to be bad. `Verdicts` tells them from those that are known to be bad: nothing that begins with
them and is no longer than the longest known solution is feasible. (With the shortest for the longest, of a length that
a sweep has begun but not ended, a few prefixes would be ones and the others, as good as they, zeros.)
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from dvr_jax.dataset.symbols import SequenceIndex
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


class Verdicts:
    """What the labels of one scene say of any prefix."""

    def __init__(
        self,
        symbols: SequenceIndex,
        feasible: Iterable[tuple[int, ...]],
        infeasible: Iterable[tuple[int, ...]],
        refuted: Iterable[tuple[int, ...]],
        impossible: Iterable[int] = (),
        duplicates: Iterable[int] = (),
    ) -> None:
        """Sequences that are feasible, sequences that are not, and prefixes that nothing feasible begins with; actions
        that a constant of the scene refutes, and those that are others by another name, which nobody asks for."""
        self._symbols = symbols
        self._impossible = frozenset(impossible)
        self._unasked = self._impossible | frozenset(duplicates)
        solutions = set(feasible)
        self._bad = {*infeasible, *refuted}
        self._longest = max(map(len, solutions), default=0)
        self._promising = {sequence[:length] for sequence in solutions for length in range(len(sequence) + 1)}
        self._all_bad: dict[tuple[int, ...], bool] = {}

    def refuted_after(self, sequence: tuple[int, ...]) -> int:
        """Number of actions after which a label refutes a sequence; 0 if none does."""
        lengths = range(1, len(sequence) + 1)
        return next((length for length in lengths if sequence[:length] in self._bad), 0)

    def known_steps(self, sequence: tuple[int, ...]) -> list[bool]:
        """For each j whether f_j of this sequence is known; once it is bad, it stays so."""
        undecided = (self.refuted_after(sequence) or len(sequence) + 1) - 1
        undecided = next((step for step in range(undecided) if sequence[step] in self._impossible), undecided)
        known = [self._is_known(sequence[:length]) for length in range(1, undecided + 1)]
        return known + [True] * (len(sequence) - undecided)

    def _is_known(self, prefix: tuple[int, ...]) -> bool:
        """Whether a prefix is promising, or known not to be."""
        return prefix in self._promising or self._is_bad(prefix, self._symbols.state_after(prefix))

    def _is_bad(self, prefix: tuple[int, ...], state: int) -> bool:
        """Whether nothing feasible that is no longer than the longest solution begins with a prefix."""
        if prefix in self._bad:
            return True
        grounding, remaining = self._symbols.grounding, self._longest - len(prefix) - 1
        if prefix in self._promising or (grounding.is_goal(state) and remaining >= -1):
            return False
        if prefix not in self._all_bad:
            self._all_bad[prefix] = all(
                self._is_bad((*prefix, action), after)
                for action in grounding.applicable(state)
                if action not in self._unasked
                for after in [grounding.successor(state, action)]
                if remaining >= 0 and grounding.can_reach_goal(after, remaining)
            )
        return self._all_bad[prefix]
