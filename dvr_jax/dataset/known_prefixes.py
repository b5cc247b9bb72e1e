"""What the labels of a scene say of any prefix: promising, known to be bad, or unknown.

A sweep ends with the first few feasible sequences. The targets of the paper are therefore 0 for many prefixes that
nobody has looked at, and a network would learn that these are bad.

A prefix is known to be bad if nothing feasible begins with it that is no longer than the longest known solution. The
shortest known solution would do for the lengths that a sweep has completed. For a length that it has begun and not
completed, however, a few prefixes would have the target 1, and others, as good as they, a known 0.
"""

from collections.abc import Iterable

from dvr_jax.dataset.sequence_index import ActionNumbers, SequenceIndex
from dvr_jax.dataset.targets import prefixes_of


class KnownPrefixes:
    """The knowledge about the prefixes of one scene."""

    def __init__(
        self,
        index: SequenceIndex,
        feasible: Iterable[ActionNumbers],
        infeasible: Iterable[ActionNumbers],
        refuted: Iterable[ActionNumbers],
        impossible: Iterable[int] = (),
        duplicates: Iterable[int] = (),
    ) -> None:
        """Take the labels of a scene.

        Args:
            index: the actions and sequences of the scene.
            feasible: sequences that are feasible.
            infeasible: sequences that are not feasible.
            refuted: prefixes that nothing feasible begins with.
            impossible: actions that a constant of the scene refutes.
            duplicates: actions that are other actions by another name, so that no sweep asks for them.
        """
        self._index = index
        self._impossible = frozenset(impossible)
        self._never_asked = self._impossible | frozenset(duplicates)
        self._bad = {*infeasible, *refuted}

        solutions = set(feasible)
        self._longest = max(map(len, solutions), default=0)
        self._promising: set[ActionNumbers] = set()
        for solution in solutions:
            self._promising.update([(), *prefixes_of(solution)])

        self._all_continuations_bad: dict[ActionNumbers, bool] = {}

    def refuted_after(self, sequence: ActionNumbers) -> int:
        """Return the number of actions after which a label refutes a sequence; 0 if no label does."""
        for prefix in prefixes_of(sequence):
            if prefix in self._bad:
                return len(prefix)
        return 0

    def known_steps(self, sequence: ActionNumbers) -> list[bool]:
        """Return for each j whether the target f_j of a sequence is known; a bad prefix stays bad."""
        # All targets are known from the first action on that a label or a constant of the scene refutes.
        undecided = len(sequence)
        refuted_after = self.refuted_after(sequence)
        if refuted_after:
            undecided = refuted_after - 1
        for step, action in enumerate(sequence[:undecided]):
            if action in self._impossible:
                undecided = step
                break

        known = [self._is_known(sequence[:length]) for length in range(1, undecided + 1)]
        return known + [True] * (len(sequence) - undecided)

    def _is_known(self, prefix: ActionNumbers) -> bool:
        """Return whether a prefix is promising, or known not to be."""
        return prefix in self._promising or self._is_bad(prefix, self._index.state_after(prefix))

    def _is_bad(self, prefix: ActionNumbers, state: int) -> bool:
        """Return whether nothing feasible begins with a prefix that is no longer than the longest solution."""
        if prefix in self._bad:
            return True
        if prefix in self._promising:
            return False
        if self._index.grounding.is_goal(state) and len(prefix) <= self._longest:
            return False

        if prefix not in self._all_continuations_bad:
            self._all_continuations_bad[prefix] = self._are_continuations_bad(prefix, state)
        return self._all_continuations_bad[prefix]

    def _are_continuations_bad(self, prefix: ActionNumbers, state: int) -> bool:
        """Return whether each action that leaves the goal reachable leads to a bad prefix."""
        grounding = self._index.grounding
        remaining = self._longest - len(prefix) - 1
        if remaining < 0:
            return True

        for action in grounding.applicable(state):
            if action in self._never_asked:
                continue
            after = grounding.successor(state, action)
            reaches_goal = grounding.can_reach_goal(after, remaining)
            if reaches_goal and not self._is_bad((*prefix, action), after):
                return False
        return True
