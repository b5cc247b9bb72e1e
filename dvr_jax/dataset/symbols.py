"""What the data set needs of a scene's logic: actions by name, and the continuations of a prefix, counted and drawn.

A continuation of a state is a sequence of actions that ends where the goal first holds. Continuations are counted
from state to state (some hundred states, whatever the number of sequences), and continuation number r, in the order of
length and then of action indices, is found by walking down those counts. Drawing r uniformly therefore draws uniformly
from all continuations, without writing any of the others down.
"""

import functools
import random
from collections.abc import Iterator, Sequence

from dvr_jax.logic import Grounding, ground_actions
from dvr_jax.logic.errors import SymbolicError, listed
from dvr_jax.scene.types import Scene


class Symbols:
    """A grounding with its actions by name and its continuations by number."""

    def __init__(self, grounding: Grounding) -> None:
        """Tables are filled as they are asked for."""
        self.grounding = grounding
        self.index_of = {str(action): index for index, action in enumerate(grounding.actions)}
        self._steps: dict[tuple[int, int], tuple[tuple[int, int, int], ...]] = {}
        self._counts: dict[tuple[int, int], int] = {}

    def indices(self, actions: Sequence[str]) -> tuple[int, ...]:
        """Numbers of actions given by name; an unknown one is an error that lists valid ones."""
        for name in actions:
            if name not in self.index_of:
                raise SymbolicError(f"there is no action {name!r}; valid: {listed(self.index_of)}.")
        return tuple(self.index_of[name] for name in actions)

    def state_after(self, sequence: tuple[int, ...]) -> int:
        """State after actions given by number; an inapplicable action, or one after the goal, is an error."""
        state = self.grounding.initial_state
        for done, index in enumerate(sequence):
            if self.grounding.is_goal(state):
                raise SymbolicError(f"the goal holds after {done} of {len(sequence)} actions; it must end there.")
            state = self.grounding.successor(state, index)
        return state

    def count(self, state: int, length: int) -> int:
        """Number of continuations of a state with exactly this many actions."""
        if self.grounding.is_goal(state) or length == 0:
            return int(self.grounding.is_goal(state) and length == 0)
        key = (state, length)
        if key not in self._counts:
            self._counts[key] = sum(number for _, _, number in self._next(state, length))
        return self._counts[key]

    def count_up_to(self, state: int, most: int) -> int:
        """Number of continuations of a state with at most this many actions."""
        return sum(self.count(state, length) for length in range(most + 1))

    def continuation(self, state: int, most: int, number: int) -> tuple[int, ...]:
        """Continuation number `number` of those with at most `most` actions, as action indices."""
        length = 0
        while number >= (here := self.count(state, length)):
            number -= here
            length += 1
            assert length <= most, "the number is below count_up_to"
        actions = []
        for remaining in range(length, 0, -1):
            for index, after, ways in self._next(state, remaining):
                if number < ways:
                    actions.append(index)
                    state = after
                    break
                number -= ways
        return tuple(actions)

    def draw(self, prefix: tuple[int, ...], k_max: int, generator: random.Random) -> Iterator[tuple[int, ...]]:
        """All goal-reaching sequences of at most k_max actions that begin with the prefix, in uniformly random order.

        Lazy: taking the first m of them draws m without replacement, at a cost that does not depend on their number.
        """
        state, most = self.state_after(prefix), k_max - len(prefix)
        for number in _permutation(self.count_up_to(state, most), generator):
            yield prefix + self.continuation(state, most, number)

    def _next(self, state: int, length: int) -> tuple[tuple[int, int, int], ...]:
        """First actions of the continuations of this length: index, state after it, number of continuations."""
        key = (state, length)
        if key not in self._steps:
            after = [(index, self.grounding.successor(state, index)) for index in self.grounding.applicable(state)]
            steps = ((index, reached, self.count(reached, length - 1)) for index, reached in after)
            self._steps[key] = tuple(step for step in steps if step[2])
        return self._steps[key]


def scene_symbols(scene: Scene) -> Symbols:
    """The symbols of a scene, shared by all scenes whose objects and goal object have the same names."""
    return _symbols(tuple(item.name for item in scene.objects), scene.goal.object)


@functools.lru_cache(maxsize=64)
def _symbols(names: tuple[str, ...], goal_object: str) -> Symbols:
    return Symbols(ground_actions(names, goal_object))


def _permutation(number: int, generator: random.Random) -> Iterator[int]:
    """A random permutation of 0 .. number - 1, lazily: Fisher and Yates' shuffle of a list that is never built."""
    moved: dict[int, int] = {}
    for place in range(number):
        chosen = generator.randrange(place, number)
        yield moved.get(chosen, chosen)
        moved[chosen] = moved.pop(place, place)
