"""Slices of many lanes are measured in chunks."""

import jax
import numpy as np
import pytest

from dvr_jax.modes.mode import Attachment
from dvr_jax.nlp.slices import Slices
from dvr_jax.runtime.batch_sizes import CPU
from dvr_jax.solver.iteration import cut_into_chunks


@pytest.mark.parametrize("number", [1, 60, 61, 150, 180, 181, 210, 430])
def test_chunks_hold_all_slices_in_their_order(number: int) -> None:
    index = np.arange(float(number))

    def of_shape(*shape: int) -> np.ndarray:
        return np.broadcast_to(index, (*shape, number))

    count = np.broadcast_to(np.arange(number), (3, number))
    slices = Slices(
        q=of_shape(7, 2),
        finger_opening=of_shape(2),
        base_poses=of_shape(4, 3, 2),
        attached=Attachment(count, count, of_shape(4, 3), of_shape(3), of_shape(4, 3), of_shape(3)),
        prism=of_shape(4, 4),
        clearance=of_shape(5),
        fixed_pose=of_shape(4, 1),
    )
    chunks = cut_into_chunks(slices)
    sizes = {leaf.shape[-1] for leaf in jax.tree.leaves(chunks)}
    assert len(sizes) == 1 and len(chunks) == -(-number // CPU.largest_chunk)
    assert sizes.pop() in range(CPU.chunk, CPU.largest_chunk + 1, CPU.chunk)
    for leaves in zip(*map(jax.tree.leaves, chunks), strict=True):
        joined = np.concatenate(leaves, axis=-1)
        np.testing.assert_array_equal(
            joined[..., :number], np.broadcast_to(index, (*joined.shape[:-1], number))
        )
