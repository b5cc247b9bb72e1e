"""The index of a scene's action sequences: actions by name, and continuations of a prefix counted, numbered and drawn.

A continuation of a state is a sequence of actions that ends where the goal first holds. Continuations are counted from
state to state. There are some hundred states, whatever the number of sequences.

Continuations are numbered in the order of length and then of the indices of their actions. Continuation number r is
found by walking down the counts. A number r that is drawn uniformly therefore gives a continuation that is drawn
uniformly from all of them, and no other continuation is written down.
"""

import functools
import random
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate

from dvr_jax.logic import Grounding, LogicError
from dvr_jax.logic.errors import listed
from dvr_jax.operators import ground_scene
from dvr_jax.scene.types import Scene

ActionNumbers = tuple[int, ...]
"""A sequence of actions, or a prefix of one, by the numbers of the actions in the grounding."""


@dataclass(frozen=True, slots=True)
class _FirstSteps:
    """The first actions of all continuations of one state that have one length."""

    cumulative: tuple[int, ...]
    """Number of continuations that begin with this action or with one before it."""

    actions: tuple[int, ...]
    """Indices of the actions, ascending."""

    states: tuple[int, ...]
    """The states after the actions."""

    total: int
    """Number of continuations."""


class SequenceIndex:
    """A grounding with its actions by name and its continuations by number."""

    def __init__(self, grounding: Grounding) -> None:
        """Build the index of a grounding; counts are computed when they are first needed."""
        self.grounding = grounding
        self.index_of = {str(action): index for index, action in enumerate(grounding.actions)}
        self._first_steps_of: dict[tuple[int, int], _FirstSteps] = {}
        self._cumulative_of: dict[tuple[int, int], list[int]] = {}

    def indices(self, actions: Sequence[str]) -> ActionNumbers:
        """Return the numbers of actions that are given by name.

        Args:
            actions: names, as `str(Action)` writes them.

        Returns:
            Their numbers in the actions of the grounding.

        Raises:
            LogicError: an action is unknown; the message lists valid ones.
        """
        for name in actions:
            if name not in self.index_of:
                raise LogicError(f"there is no action {name!r}; valid: {listed(self.index_of)}.")
        return tuple(self.index_of[name] for name in actions)

    def state_after(self, sequence: ActionNumbers) -> int:
        """Return the state after a sequence.

        Args:
            sequence: numbers of actions.

        Returns:
            The state after the last action.

        Raises:
            LogicError: an action does not apply, or follows after the goal.
        """
        state = self.grounding.initial_state
        for done, index in enumerate(sequence):
            if self.grounding.is_goal(state):
                raise LogicError(
                    f"the goal holds after {done} of {len(sequence)} actions; it must end there."
                )
            state = self.grounding.successor(state, index)
        return state

    def count(self, state: int, length: int) -> int:
        """Count the continuations of one length.

        Args:
            state: the state to start from.
            length: the number of actions.

        Returns:
            The number of continuations with exactly this many actions.
        """
        return self._first_steps(state, length).total

    def count_up_to(self, state: int, most: int) -> int:
        """Count the continuations up to a length.

        Args:
            state: the state to start from.
            most: the largest number of actions.

        Returns:
            The number of continuations with at most this many actions.
        """
        return self._cumulative(state, most)[-1]

    def continuation(self, state: int, most: int, number: int) -> ActionNumbers:
        """Find a continuation by its number.

        Args:
            state: the state to start from.
            most: the largest number of actions.
            number: the number of the continuation, from 0 to `count_up_to(state, most)` - 1.

        Returns:
            The continuation as numbers of actions.
        """
        # The shortest continuations come first.
        cumulative = self._cumulative(state, most)
        length = bisect_right(cumulative, number)
        if length:
            number -= cumulative[length - 1]

        # Each step leaves the rank among the continuations that begin with the same action.
        actions: list[int] = []
        for remaining in range(length, 0, -1):
            steps = self._first_steps(state, remaining)
            chosen = bisect_right(steps.cumulative, number)
            if chosen:
                number -= steps.cumulative[chosen - 1]
            actions.append(steps.actions[chosen])
            state = steps.states[chosen]
        return tuple(actions)

    def draw(
        self,
        prefix: ActionNumbers,
        k_max: int,
        generator: random.Random,
    ) -> Iterator[ActionNumbers]:
        """Yield all sequences that begin with a prefix and reach the goal, in uniformly random order.

        The iterator is lazy: its first m sequences are m draws without replacement, at a cost that does not depend on
        the number of sequences.

        Args:
            prefix: numbers of actions.
            k_max: the largest number of actions of a sequence, prefix included.
            generator: the source of randomness; each sequence that is taken consumes one number.

        Yields:
            Sequences as numbers of actions, the prefix included.
        """
        state = self.state_after(prefix)
        most = k_max - len(prefix)
        for number in _permutation(self.count_up_to(state, most), generator):
            yield prefix + self.continuation(state, most, number)

    def _cumulative(self, state: int, most: int) -> list[int]:
        """Return the numbers of continuations with at most 0, 1, ..., `most` actions; at least one entry."""
        key = (state, most)
        if key not in self._cumulative_of:
            counts = [self.count(state, length) for length in range(most + 1)]
            self._cumulative_of[key] = list(accumulate(counts)) or [0]
        return self._cumulative_of[key]

    def _first_steps(self, state: int, length: int) -> _FirstSteps:
        """Return the first steps of the continuations of exactly this length."""
        key = (state, length)
        if key not in self._first_steps_of:
            self._first_steps_of[key] = self._find_first_steps(state, length)
        return self._first_steps_of[key]

    def _find_first_steps(self, state: int, length: int) -> _FirstSteps:
        """Find the first steps anew; the counts of the states after them are kept."""
        # A continuation ends at the goal: only the empty one is left there.
        is_goal = self.grounding.is_goal(state)
        if length == 0 or is_goal:
            return _FirstSteps((), (), (), int(length == 0 and is_goal))

        actions: list[int] = []
        states: list[int] = []
        cumulative: list[int] = []
        total = 0
        for index in self.grounding.applicable(state):
            after = self.grounding.successor(state, index)
            number = self.count(after, length - 1)
            if number:
                total += number
                actions.append(index)
                states.append(after)
                cumulative.append(total)
        return _FirstSteps(tuple(cumulative), tuple(actions), tuple(states), total)


def sequence_index_of(scene: Scene) -> SequenceIndex:
    """Return the index of a scene, shared by all scenes whose objects and goal object have the same names."""
    return _sequence_index(ground_scene(scene))


@functools.lru_cache(maxsize=64)
def _sequence_index(grounding: Grounding) -> SequenceIndex:
    return SequenceIndex(grounding)


def _permutation(number: int, generator: random.Random) -> Iterator[int]:
    """Yield a random permutation of 0, ..., number - 1 lazily.

    This is Fisher and Yates' shuffle of a list that is never built: `moved` holds the entries that have left their
    place.
    """
    moved: dict[int, int] = {}
    for place in range(number):
        # Three times as fast as randrange; no number is more likely than another by more than `number` / 2^53.
        chosen = place + int(generator.random() * (number - place))
        yield moved.get(chosen, chosen)
        moved[chosen] = moved.pop(place, place)
