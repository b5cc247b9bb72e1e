"""What the data set needs of a scene's logic: actions by name, and the continuations of a prefix, counted and drawn.

A continuation of a state is a sequence of actions that ends where the goal first holds. Continuations are counted
from state to state (some hundred states, whatever the number of sequences), and continuation number r, in the order of
length and then of action indices, is found by walking down those counts. Drawing r uniformly therefore draws uniformly
from all continuations, without writing any of the others down.
"""

import functools
import random
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

from dvr_jax.logic import Grounding, ground_actions
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.scene.types import Scene


class _Steps(NamedTuple):
    """The first actions of all continuations of one state that have one length."""

    ends: tuple[int, ...]
    """Continuations that begin with this action or one before it, a running total."""
    actions: tuple[int, ...]
    states: tuple[int, ...]
    """The states that the actions lead to."""
    total: int


class SequenceIndex:
    """A grounding with its actions by name and its continuations by number."""

    def __init__(self, grounding: Grounding) -> None:
        """Tables are filled as they are asked for."""
        self.grounding = grounding
        self.index_of = {str(action): index for index, action in enumerate(grounding.actions)}
        self._from: dict[tuple[int, int], _Steps] = {}
        self._up_to: dict[tuple[int, int], list[int]] = {}

    def indices(self, actions: Sequence[str]) -> tuple[int, ...]:
        """Numbers of actions given by name; an unknown one is an error that lists valid ones."""
        for name in actions:
            if name not in self.index_of:
                raise LogicError(f"there is no action {name!r}; valid: {listed(self.index_of)}.")
        return tuple(self.index_of[name] for name in actions)

    def state_after(self, sequence: tuple[int, ...]) -> int:
        """State after actions given by number; an inapplicable action, or one after the goal, is an error."""
        state = self.grounding.initial_state
        for done, index in enumerate(sequence):
            if self.grounding.is_goal(state):
                raise LogicError(f"the goal holds after {done} of {len(sequence)} actions; it must end there.")
            state = self.grounding.successor(state, index)
        return state

    def count(self, state: int, length: int) -> int:
        """Number of continuations of a state with exactly this many actions."""
        return self._steps(state, length).total

    def count_up_to(self, state: int, most: int) -> int:
        """Number of continuations of a state with at most this many actions."""
        return self._lengths(state, most)[-1]

    def continuation(self, state: int, most: int, number: int) -> tuple[int, ...]:
        """Continuation number `number` of those with at most `most` actions, as action indices."""
        ends = self._lengths(state, most)
        length = bisect_right(ends, number)
        number -= ends[length - 1] if length else 0
        actions = []
        for remaining in range(length, 0, -1):
            steps = self._steps(state, remaining)
            chosen = bisect_right(steps.ends, number)
            number -= steps.ends[chosen - 1] if chosen else 0
            actions.append(steps.actions[chosen])
            state = steps.states[chosen]
        return tuple(actions)

    def draw(self, prefix: tuple[int, ...], k_max: int, generator: random.Random) -> Iterator[tuple[int, ...]]:
        """All goal-reaching sequences of at most k_max actions that begin with the prefix, in uniformly random order.

        Lazy: taking the first m of them draws m without replacement, at a cost that does not depend on their number.
        """
        state, most = self.state_after(prefix), k_max - len(prefix)
        for number in _permutation(self.count_up_to(state, most), generator):
            yield prefix + self.continuation(state, most, number)

    def _lengths(self, state: int, most: int) -> list[int]:
        """Numbers of continuations with at most 0, 1, .. `most` actions (at least one entry)."""
        key = (state, most)
        if key not in self._up_to:
            self._up_to[key] = list(accumulate((self.count(state, n) for n in range(most + 1)), initial=0))[1:] or [0]
        return self._up_to[key]

    def _steps(self, state: int, length: int) -> _Steps:
        """First steps of the continuations of exactly this length."""
        key = (state, length)
        if key not in self._from:
            self._from[key] = self._find_steps(state, length)
        return self._from[key]

    def _find_steps(self, state: int, length: int) -> _Steps:
        if length == 0 or self.grounding.is_goal(state):
            return _Steps((), (), (), int(length == 0 and self.grounding.is_goal(state)))
        after = [(index, self.grounding.successor(state, index)) for index in self.grounding.applicable(state)]
        counted = [(index, reached, self.count(reached, length - 1)) for index, reached in after]
        possible = [step for step in counted if step[2]]
        ends = tuple(accumulate(number for _, _, number in possible))
        actions, states = tuple(index for index, _, _ in possible), tuple(reached for _, reached, _ in possible)
        return _Steps(ends, actions, states, ends[-1] if ends else 0)


def sequence_index(scene: Scene) -> SequenceIndex:
    """The symbols of a scene, shared by all scenes whose objects and goal object have the same names."""
    return _symbols(tuple(item.name for item in scene.objects), scene.goal.object)


@functools.lru_cache(maxsize=64)
def _symbols(names: tuple[str, ...], goal_object: str) -> SequenceIndex:
    return SequenceIndex(ground_actions(names, goal_object))


def _permutation(number: int, generator: random.Random) -> Iterator[int]:
    """A random permutation of 0 .. number - 1, lazily: Fisher and Yates' shuffle of a list that is never built."""
    moved: dict[int, int] = {}
    for place in range(number):
        # Three times as fast as randrange; no number is more likely than another by more than `number` / 2^53.
        chosen = place + int(generator.random() * (number - place))
        yield moved.get(chosen, chosen)
        moved[chosen] = moved.pop(place, place)
