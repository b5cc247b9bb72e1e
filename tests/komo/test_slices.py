"""Slices in chunks, and what their distances add to the Gauss-Newton matrix."""

from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import numpy as np
import pytest

from dvr_jax.geometry.capsule_prism import capsule_prism
from dvr_jax.modes.poses import Attachment
from dvr_jax.nlp.collision_distances import FAR, NEAR
from dvr_jax.nlp.collision_rows import arm_signs
from dvr_jax.nlp.constraints import lay_out
from dvr_jax.nlp.slices import PUSHING_ROWS, Slices, distance_jacobian, measure, reduce_slices
from dvr_jax.runtime import batch_sizes as batch_sizes
from dvr_jax.runtime.batch_sizes import ACCELERATOR, CPU, BatchSizes
from dvr_jax.solver.iteration import cut_into_chunks
from dvr_jax.workcell.kinematics import load_arm


@pytest.mark.parametrize("number", [1, 60, 61, 150, 180, 181, 210, 430])
def test_chunks_hold_all_slices_in_their_order(number: int) -> None:
    index = np.arange(float(number))
    attached = Attachment(*(index[None],) * len(Attachment._fields))
    chunks = cut_into_chunks(Slices(np.tile(index, (7, 2, 1)), np.tile(index, (2, 1)), attached, index[None, None]))
    sizes = {leaf.shape[-1] for leaf in jax.tree.leaves(chunks)}
    assert len(sizes) == 1 and len(chunks) == -(-number // CPU.largest_chunk)
    assert sizes.pop() in range(CPU.chunk, CPU.largest_chunk + 1, CPU.chunk)
    for leaves in zip(*map(jax.tree.leaves, chunks), strict=True):
        joined = np.concatenate(leaves, axis=-1)
        np.testing.assert_array_equal(joined[..., :number], np.broadcast_to(index, (*joined.shape[:-1], number)))


def compiled(function: Any) -> Any:
    """For the sizes of passes that a test has set: `jax.jit` of the same function would share its traces."""
    return compiled_for(function, batch_sizes.CPU)


@cache
def compiled_for(function: Any, sizes: BatchSizes) -> Any:
    return jax.jit(partial(function))


@pytest.fixture(scope="module")
def crowded(keyframes: Any) -> Slices:
    """Slices of which some have an object a metre large, which the capsules of both arms are in or near."""
    slices = jax.tree.map(np.asarray, lay_out(keyframes.case.problems, keyframes.case.x))
    half = slices.half.copy()
    half[:3, 0, ::3] = 0.5
    return slices._replace(half=half)


def near_and_exact(measured: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N, 2 C, L) of objects and capsules as measured, and those of all pairs one by one."""
    R, p, half = measured.contacts.objects
    a, b = measured.contacts.ends
    radii = np.tile(load_arm().capsule_radii, 2)[:, None]
    exact, _ = jax.jit(capsule_prism)(a[:, None], b[:, None], radii, R[:, :, :, None], p[:, :, None], half[:, :, None])
    first = arm_signs().shape[1]
    ours = np.asarray(measured.distance)[:, first : first + exact.shape[0] * exact.shape[1]]
    return ours.T.reshape(exact.shape), np.asarray(exact)


@pytest.mark.parametrize("near_pairs", [10, CPU.near_pairs, ACCELERATOR.near_pairs])
def test_near_capsules_have_their_distance_and_far_ones_a_bound(
    near_pairs: int, crowded: Slices, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, near_pairs=near_pairs))
    ours, exact = near_and_exact(compiled(measure)(crowded))
    counts = ours != FAR
    near = counts & (ours < NEAR)
    per_slice = near.sum((0, 1))
    assert per_slice.sum() > 20 and per_slice.max() > 8 and per_slice.min() < 4
    np.testing.assert_allclose(ours[near], exact[near], rtol=1e-12, atol=1e-12)
    assert (ours[counts] <= exact[counts] + 1e-12).all()
    assert not (counts & (exact < NEAR) & ~near).any()


def test_a_slices_distances_do_not_depend_on_its_neighbours(crowded: Slices) -> None:
    """Though they have other numbers of capsules near objects, so that its own are taken elsewhere in a pass."""
    together = np.asarray(compiled(measure)(crowded).distance)
    for index in (1, 2):
        alone = jax.tree.map(lambda leaf, i=index: np.repeat(leaf[..., [i]], leaf.shape[-1], axis=-1), crowded)
        np.testing.assert_array_equal(np.asarray(compiled(measure)(alone).distance)[index], together[index])


def pushes(measured: Any, number: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Forces and curvatures of so many rows of the slice in the middle, and of at most ``most`` of the others."""
    L, P = measured.distance.shape
    generator = np.random.default_rng(0)
    force, curvature = np.zeros((2, L, P))
    for index in range(L):
        others = generator.integers(most + 1)
        rows = generator.permutation(P)[: number if index == L // 2 else others]
        force[index, rows], curvature[index, rows] = generator.uniform(0.1, 10, (2, P))[:, rows]
    return force, curvature


@pytest.mark.parametrize("number", [0, 1, PUSHING_ROWS, PUSHING_ROWS + 1, 3 * PUSHING_ROWS, 40])
@pytest.mark.parametrize("parts", [3, CPU.pushing_parts, ACCELERATOR.pushing_parts])
def test_sums_are_those_of_all_rows(path: Any, number: int, parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, pushing_parts=parts))
    measured = path.results[2]
    L, P = measured.distance.shape
    force, curvature = pushes(measured, number, min(number, PUSHING_ROWS))
    ours = compiled(reduce_slices)(measured, force, curvature)
    J = np.asarray(jax.jit(distance_jacobian)(measured, np.tile(np.arange(P), (L, 1))))
    np.testing.assert_allclose(ours.matrix, np.einsum("lip,lp,ljp->lij", J, curvature, J), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(ours.gradient, -np.einsum("lip,lp->li", J, force), rtol=1e-10, atol=1e-10)
    assert (np.abs(ours.gradient).max() > 0) == (number > 0)


def test_a_slices_sums_do_not_depend_on_its_neighbours(path: Any) -> None:
    measured = path.results[2]
    middle = np.arange(len(measured.distance)) == len(measured.distance) // 2
    few, many = (compiled(reduce_slices)(measured, *pushes(measured, number, 3)) for number in (3, 40))
    for ours, theirs in zip(few, many, strict=True):
        np.testing.assert_array_equal(np.asarray(ours)[~middle], np.asarray(theirs)[~middle])
        assert (np.asarray(ours)[middle] != np.asarray(theirs)[middle]).any()
