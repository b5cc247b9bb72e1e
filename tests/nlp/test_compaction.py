"""Visits of the active rows against NumPy's list of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.nlp.compaction import count_active, gather_chunk, number_of_groups, slot


@pytest.mark.parametrize("number", [1, 5])
@pytest.mark.parametrize("size", [1, 3])
@settings(deadline=None, max_examples=20)
@given(share=st.sampled_from([0.0, 0.1, 0.5, 1.0]), seed=st.integers(0, 1000))
def test_visits_are_all_active_rows_in_order(
    number: int, size: int, share: float, seed: int
) -> None:
    P, L = 11, 7
    mask = np.random.default_rng(seed).random((P, L)) < share
    active = count_active(mask, size)
    groups = int(number_of_groups(active))
    assert groups == sum(-(-int(rows) // size) for rows in mask.sum(0))
    found = []
    for first in range(0, groups, number):
        slices, rows, valid = map(
            np.asarray, gather_chunk(active, np.array(first, np.float32), number)
        )
        assert (slices < L).sum() == min(number, groups - first)
        for group in range(number):
            assert len(set(rows[valid[:, group], group])) == valid[:, group].sum() <= size
            found += [(slices[group], row) for row in rows[valid[:, group], group]]
    assert found == [(index, row) for index in range(L) for row in np.flatnonzero(mask[:, index])]


def test_slot_is_where_a_row_is_visited() -> None:
    mask = np.random.default_rng(0).random((11, 7)) < 0.4
    active = count_active(mask, 1)
    slots = np.asarray(slot(active))
    slices, rows, _ = map(
        np.asarray, gather_chunk(active, np.array(0, np.float32), int(mask.sum()))
    )
    np.testing.assert_array_equal(slots[rows[0], slices], np.arange(mask.sum()))
