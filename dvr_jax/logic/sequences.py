"""Action sequences that reach the goal: their numbers by length (Table I of the paper), and the sequences themselves.

A sequence ends when the goal first holds. There are far fewer distinct states than sequences (304 states and 482,816
sequences of length 6 with five objects). Counts are therefore carried from state to state, and no sequence is written
down to be counted.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from dvr_jax.logic.errors import LogicError
from dvr_jax.logic.grounding import Grounding


def count_sequences(grounding: Grounding, k_max: int) -> dict[int, int]:
    """Count the sequences that reach the goal, by length.

    Args:
        grounding: the actions, the initial state and the goal.
        k_max: the largest length.

    Returns:
        The number of sequences of each length from 1 to k_max.

    Raises:
        LogicError: k_max is negative.
    """
    if k_max < 0:
        raise LogicError(f"the largest length is {k_max}; it must not be negative.")

    # `ways` counts the action sequences so far that lead to each state. None of them reaches the goal before its end.
    counts: dict[int, int] = {}
    ways = Counter({grounding.initial_state: 1})
    for length in range(1, k_max + 1):
        ways_after = _extend(grounding, ways)
        at_goal = [state for state in ways_after if grounding.is_goal(state)]
        counts[length] = sum(ways_after.pop(state) for state in at_goal)
        ways = ways_after
    return counts


def _extend(grounding: Grounding, ways: Counter[int]) -> Counter[int]:
    """Count the ways to each state after one more action."""
    ways_after: Counter[int] = Counter()
    for state, number in ways.items():
        # Only the initial state can be a goal here; all sequences that reach the goal later are taken out.
        if grounding.is_goal(state):
            continue
        for index in grounding.applicable(state):
            ways_after[grounding.successor(state, index)] += number
    return ways_after


def enumerate_sequences(grounding: Grounding, length: int) -> Iterator[tuple[int, ...]]:
    """Enumerate the sequences of one length that reach the goal, lazily.

    Args:
        grounding: the actions, the initial state and the goal.
        length: the number of actions.

    Returns:
        The sequences as indices of actions, in lexicographic order.

    Raises:
        LogicError: the length is negative.
    """
    if length < 0:
        raise LogicError(f"the length is {length}; it must not be negative.")
    return _Enumeration(grounding).sequences(length)


class _Step(NamedTuple):
    """An action that leaves the goal reachable, and the state after it."""

    action: int
    state: int


class _Enumeration:
    """The enumeration of sequences, which keeps the useful steps from each state."""

    def __init__(self, grounding: Grounding) -> None:
        self._grounding = grounding
        self._steps_from: dict[tuple[int, int], tuple[_Step, ...]] = {}

    def sequences(self, length: int) -> Iterator[tuple[int, ...]]:
        """Yield the sequences of one length that reach the goal, in lexicographic order."""
        start = self._grounding.initial_state
        if length == 0:
            if self._grounding.is_goal(start):
                yield ()
            return

        # A stack of iterators instead of nested generators: each sequence costs one step, whatever its length.
        prefix: list[int] = []
        stack = [iter(self._steps(start, length))]
        while stack:
            step = next(stack[-1], None)
            if step is None:
                stack.pop()
                del prefix[-1:]
            elif len(stack) == length:
                yield (*prefix, step.action)
            else:
                prefix.append(step.action)
                stack.append(iter(self._steps(step.state, length - len(stack))))

    def _steps(self, state: int, remaining: int) -> tuple[_Step, ...]:
        """Return the steps after which the goal can first be reached by exactly remaining - 1 more."""
        key = (state, remaining)
        if key not in self._steps_from:
            self._steps_from[key] = tuple(self._find_steps(state, remaining))
        return self._steps_from[key]

    def _find_steps(self, state: int, remaining: int) -> Iterator[_Step]:
        """Yield the steps of `_steps` without keeping them."""
        # A sequence ends at the goal.
        if self._grounding.is_goal(state):
            return

        for index in self._grounding.applicable(state):
            after = self._grounding.successor(state, index)
            if self._grounding.reaches_goal_in(after, remaining - 1):
                yield _Step(index, after)
