"""Goal-reaching action sequences: how many there are of each length (Table I of the paper), and one after the other.

A sequence ends when the goal first holds. There are far fewer distinct states than sequences (304 states, 482,816
sequences of length 6 with five objects), so counts are carried from state to state and no sequence is written down.
"""

from collections import Counter
from collections.abc import Iterator

from dvr_jax.logic.errors import LogicError
from dvr_jax.logic.grounding import Grounding


def count_sequences(grounding: Grounding, k_max: int) -> dict[int, int]:
    """Number of goal-reaching sequences of each length 1 to k_max."""
    if k_max < 0:
        raise LogicError(f"the largest length is {k_max}; it must not be negative.")
    counts: dict[int, int] = {}
    ways = Counter({grounding.initial_state: 1})  # action sequences so far that lead to a state, none through the goal
    for length in range(1, k_max + 1):
        ways_after: Counter[int] = Counter()
        counts[length] = 0
        for state, number in ways.items():
            if grounding.is_goal(state):  # only ever the initial state: what reaches the goal later is not carried on
                continue
            for index in grounding.applicable(state):
                after = grounding.successor(state, index)
                if grounding.is_goal(after):
                    counts[length] += number
                else:
                    ways_after[after] += number
        ways = ways_after
    return counts


def enumerate_sequences(grounding: Grounding, length: int) -> Iterator[tuple[int, ...]]:
    """All goal-reaching sequences of exactly this length, as action indices in lexicographic order, lazily."""
    if length < 0:
        raise LogicError(f"the length is {length}; it must not be negative.")
    return _enumerate(grounding, length)


def _enumerate(grounding: Grounding, length: int) -> Iterator[tuple[int, ...]]:
    if length == 0:
        if grounding.is_goal(grounding.initial_state):
            yield ()
        return
    steps_from: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {}

    def steps(state: int, remaining: int) -> Iterator[tuple[int, int]]:
        """Actions that leave the goal reachable in exactly remaining - 1 more, with the states they lead to."""
        key = (state, remaining)
        if key not in steps_from:
            after = ((index, grounding.successor(state, index)) for index in grounding.applicable(state))
            open_state = not grounding.is_goal(state)
            steps_from[key] = tuple(s for s in after if open_state and grounding.reaches_goal_in(s[1], remaining - 1))
        return iter(steps_from[key])

    # A stack of iterators instead of nested generators: each sequence costs one step, whatever its length.
    prefix: list[int] = []
    stack = [steps(grounding.initial_state, length)]
    while stack:
        step = next(stack[-1], None)
        if step is None:
            stack.pop()
            if prefix:
                prefix.pop()
        elif len(stack) == length:
            yield (*prefix, step[0])
        else:
            prefix.append(step[0])
            stack.append(steps(step[1], length - len(stack)))
