"""Continuations by number against the enumeration of all sequences."""

import random
from collections import Counter
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvr_jax.dataset.sequence_index import SequenceIndex
from dvr_jax.errors import DvrError
from dvr_jax.logic import count_sequences, enumerate_sequences, ground_actions
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL

ARMS = DEFAULT_WORKCELL.arm_names
INDEX = SequenceIndex(ground_actions(("yellow", "blue"), "blue", ARMS))
UP_TO_4 = [
    sequence for length in range(1, 5) for sequence in enumerate_sequences(INDEX.grounding, length)
]


def test_numbers_are_the_enumeration() -> None:
    start = INDEX.grounding.initial_state
    assert INDEX.count_up_to(start, 4) == len(UP_TO_4)
    assert [INDEX.continuation(start, 4, number) for number in range(len(UP_TO_4))] == UP_TO_4


@pytest.mark.parametrize("objects", [1, 3, 5])
def test_counts_are_those_of_table_one(objects: int) -> None:
    index = SequenceIndex(ground_actions([f"object {i}" for i in range(objects)], "object 0", ARMS))
    start = index.grounding.initial_state
    assert {length: index.count(start, length) for length in range(1, 7)} == count_sequences(
        index.grounding, 6
    )


@given(st.sampled_from(UP_TO_4), st.integers(0, 4), st.integers(0, 2**32))
def test_draw_gives_every_continuation_once(
    sequence: tuple[int, ...], length: int, seed: int
) -> None:
    prefix = sequence[:length]
    drawn = list(INDEX.draw(prefix, 4, random.Random(seed)))
    assert sorted(drawn) == sorted(other for other in UP_TO_4 if other[: len(prefix)] == prefix)


def test_draw_is_uniform() -> None:
    """48 continuations, each expected 125 times among the first three drawn: none is off by more than 5 sigma."""
    prefix = UP_TO_4[-1][:2]
    all_of_them = list(INDEX.draw(prefix, 4, random.Random(0)))
    draws, taken = 125 * len(all_of_them) // 3, 3
    hits = Counter(
        s
        for seed in range(draws)
        for s in islice(INDEX.draw(prefix, 4, random.Random(seed)), taken)
    )
    expected = draws * taken / len(all_of_them)
    assert set(hits) == set(all_of_them)
    assert max(abs(number - expected) for number in hits.values()) < 5 * expected**0.5


def test_nothing_follows_what_is_too_long_or_done() -> None:
    assert list(INDEX.draw(UP_TO_4[-1][:3], 2, random.Random(0))) == []
    assert list(INDEX.draw(UP_TO_4[0], 6, random.Random(0))) == [UP_TO_4[0]]


def test_unknown_and_late_actions_are_refused() -> None:
    with pytest.raises(DvrError, match=r"no action 'push\(left\)'; valid: grasp"):
        INDEX.indices(["push(left)"])
    with pytest.raises(DvrError, match=r"the goal holds after 2 of 3 actions"):
        INDEX.state_after((*UP_TO_4[0], 0))
