"""Table I of the paper: the number of goal-reaching sequences, counted and written out."""

import time

import pytest

from dvr_jax.logic import (
    Grounding,
    LogicError,
    count_sequences,
    enumerate_sequences,
    ground_actions,
)

TABLE_ONE = {
    1: (8, 32, 192, 1024, 5632),
    2: (8, 96, 704, 6400, 51200),
    3: (8, 160, 1216, 15872, 145920),
    4: (8, 224, 1728, 29440, 289792),
    5: (8, 288, 2240, 47104, 482816),
}
"""Objects to sequences of length 2 to 6."""

ARMS = ("left", "right")
OBJECTS = ("yellow", "red", "can", "green", "blue")


def ground(number: int) -> Grounding:
    return ground_actions(OBJECTS[:number], "yellow", ARMS)


@pytest.mark.parametrize("number", TABLE_ONE)
def test_counting_gives_table_one(number: int) -> None:
    counts = count_sequences(ground(number), 6)
    assert counts == {1: 0} | dict(zip(range(2, 7), TABLE_ONE[number], strict=True))


@pytest.mark.parametrize("length", range(1, 6))
@pytest.mark.parametrize("number", (1, 2, 3))
def test_enumerating_gives_table_one(number: int, length: int) -> None:
    grounding = ground(number)
    sequences = list(enumerate_sequences(grounding, length))
    assert len(sequences) == (0, *TABLE_ONE[number])[length - 1]
    assert sequences == sorted(set(sequences))
    for sequence in sequences[:: max(1, len(sequences) // 50)]:
        grounding.check_sequence([grounding.actions[index] for index in sequence])


def test_all_482816_sequences_take_seconds() -> None:
    start = time.perf_counter()
    assert sum(1 for _ in enumerate_sequences(ground(5), 6)) == 482_816
    assert time.perf_counter() - start < 10  # 0.6 s measured; the rest is room for a busy machine


def test_enumeration_is_lazy() -> None:
    grounding = ground(5)
    first = next(enumerate_sequences(grounding, 12))  # about 10**10 sequences
    assert len(first) == 12
    grounding.check_sequence([grounding.actions[index] for index in first])


def test_the_goal_object_decides_nothing_but_names() -> None:
    assert count_sequences(ground_actions(OBJECTS[:3], "can", ARMS), 5) == count_sequences(
        ground(3), 5
    )


def test_lengths_at_the_edge() -> None:
    grounding = ground(1)
    assert count_sequences(grounding, 0) == {}
    assert list(enumerate_sequences(grounding, 0)) == []
    assert list(enumerate_sequences(grounding, 1)) == []
    with pytest.raises(LogicError, match="-1"):
        count_sequences(grounding, -1)
    with pytest.raises(LogicError, match="-2"):
        enumerate_sequences(grounding, -2)
