"""The targets against the paper's equation, read word for word."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvr_jax.dataset import targets
from dvr_jax.errors import DvrError

SEQUENCES = st.lists(
    st.tuples(st.lists(st.integers(0, 2), min_size=1, max_size=4).map(tuple), st.booleans()), max_size=12
)
"""Few actions and short sequences, so that prefixes are shared and some sequences occur twice."""


@given(SEQUENCES)
def test_equals_the_equation(rows: list[tuple[tuple[int, ...], bool]]) -> None:
    sequences, feasible = [row[0] for row in rows], [row[1] for row in rows]
    expected = [
        [float(verdict or any(other and a_l[:j] == a_i[:j] and len(a_l) >= j for a_l, other in rows)) for j in steps]
        for a_i, verdict in rows
        for steps in [range(1, len(a_i) + 1)]
    ]
    found = targets(sequences, feasible)
    assert [list(f) for f in found] == expected
    assert all(f.dtype == np.float32 for f in found)


@given(SEQUENCES)
def test_ones_come_first(rows: list[tuple[tuple[int, ...], bool]]) -> None:
    for f in targets([row[0] for row in rows], [row[1] for row in rows]):
        assert np.all(np.diff(f) <= 0)


def test_by_hand() -> None:
    found = targets([(1, 2), (1, 3, 4), (2, 2), (1, 2, 5)], [False, True, False, False])
    assert [list(f) for f in found] == [[1, 0], [1, 1, 1], [0, 0], [1, 0, 0]]


def test_one_verdict_for_each_sequence() -> None:
    with pytest.raises(DvrError, match="2 sequences and 1 verdicts"):
        targets([(1,), (2,)], [True])
