"""Visits of the marked rows against NumPy's list of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.nlp.compaction import mark, number_of_parts, place, visit


@pytest.mark.parametrize("number", [1, 5])
@pytest.mark.parametrize("size", [1, 3])
@settings(deadline=None, max_examples=20)
@given(share=st.sampled_from([0.0, 0.1, 0.5, 1.0]), seed=st.integers(0, 1000))
def test_visits_are_all_marked_rows_in_order(number: int, size: int, share: float, seed: int) -> None:
    P, L = 11, 7
    mask = np.random.default_rng(seed).random((P, L)) < share
    marked = mark(mask, size)
    parts = int(number_of_parts(marked))
    assert parts == sum(-(-int(rows) // size) for rows in mask.sum(0))
    found = []
    for first in range(0, parts, number):
        slices, rows, there = map(np.asarray, visit(marked, np.float32(first), number))
        assert (slices < L).sum() == min(number, parts - first)
        for part in range(number):
            assert len(set(rows[there[:, part], part])) == there[:, part].sum() <= size
            found += [(slices[part], row) for row in rows[there[:, part], part]]
    assert found == [(index, row) for index in range(L) for row in np.flatnonzero(mask[:, index])]


def test_place_is_where_a_row_is_visited() -> None:
    mask = np.random.default_rng(0).random((11, 7)) < 0.4
    marked = mark(mask, 1)
    places = np.asarray(place(marked))
    slices, rows, _ = map(np.asarray, visit(marked, np.float32(0), int(mask.sum())))
    np.testing.assert_array_equal(places[rows[0], slices], np.arange(mask.sum()))
