"""Slices in chunks, and what their distances add to the Gauss-Newton matrix."""

from typing import Any

import jax
import numpy as np
import pytest

from dvr_jax.komo.modes import Attachment
from dvr_jax.komo.slices import FEW_PUSHING, Slices, reduce_path_slices, reduce_slices
from dvr_jax.komo.solver import CHUNK, LARGEST_CHUNK, cut_into_chunks


@pytest.mark.parametrize("number", [1, 60, 61, 150, 180, 181, 210, 430])
def test_chunks_hold_all_slices_in_their_order(number: int) -> None:
    index = np.arange(float(number))
    attached = Attachment(*(index[None],) * len(Attachment._fields))
    chunks = cut_into_chunks(Slices(np.tile(index, (7, 2, 1)), np.tile(index, (2, 1)), attached, index[None, None]))
    sizes = {leaf.shape[-1] for leaf in jax.tree.leaves(chunks)}
    assert len(sizes) == 1 and len(chunks) == -(-number // LARGEST_CHUNK)
    assert sizes.pop() in range(CHUNK, LARGEST_CHUNK + 1, CHUNK)
    for leaves in zip(*map(jax.tree.leaves, chunks), strict=True):
        joined = np.concatenate(leaves, axis=-1)
        np.testing.assert_array_equal(joined[..., :number], np.broadcast_to(index, (*joined.shape[:-1], number)))


@pytest.mark.parametrize("pushing", [0, FEW_PUSHING, FEW_PUSHING + 1, 3 * FEW_PUSHING])
def test_few_rows_give_the_same_as_many(path: Any, pushing: int) -> None:
    """Of one slice so many rows push, of the others fewer."""
    measured = path.results[2]
    L, P = measured.distance.shape
    generator = np.random.default_rng(0)
    force, curvature = np.zeros((L, P)), np.zeros((L, P))
    for index in range(L):
        number = pushing if index == L // 2 else generator.integers(min(pushing, FEW_PUSHING) + 1)
        rows = generator.permutation(P)[:number]
        force[index, rows], curvature[index, rows] = generator.uniform(0.1, 10, (2, len(rows)))
    ours, expected = (jax.jit(reduce)(measured, force, curvature) for reduce in (reduce_path_slices, reduce_slices))
    assert (np.abs(expected.gradient).max() > 0) == (pushing > 0)
    np.testing.assert_allclose(ours.matrix, expected.matrix, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.gradient, expected.gradient, rtol=1e-12, atol=1e-12)
