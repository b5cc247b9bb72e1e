"""Distances of slices, and what they add to the Gauss-Newton matrix."""

from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import numpy as np
import pytest

from dvr_jax.geometry.capsule_prism import capsule_prism
from dvr_jax.nlp.collision_distances import FAR, NEAR
from dvr_jax.nlp.collision_rows import arm_row_signs
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.slices import ACTIVE_ROWS, Slices, distance_jacobian, measure, reduce_slices
from dvr_jax.runtime import batch_sizes as batch_sizes
from dvr_jax.runtime.batch_sizes import ACCELERATOR, CPU, BatchSizes
from dvr_jax.runtime.compilation import CPU_OPTIONS


def compiled(function: Any) -> Any:
    """For the sizes of passes that a test has set: `jax.jit` of the same function would share its traces."""
    return compiled_for(function, batch_sizes.CPU)


@cache
def compiled_for(function: Any, sizes: BatchSizes) -> Any:
    return jax.jit(partial(function), compiler_options=CPU_OPTIONS)


@pytest.fixture(scope="module", params=["keyframes", "fixed_bodies"])
def crowd(request: pytest.FixtureRequest) -> tuple[Any, Slices]:
    """A case's slices of which some have an object a metre large, which the capsules of both arms are in or near."""
    evaluated = request.getfixturevalue(request.param)
    slices = jax.tree.map(np.asarray, lay_out(evaluated.case.problems, evaluated.case.x))
    prism = slices.prism.copy()
    prism[:3, 0, ::3] = 0.5
    return evaluated.model, slices._replace(prism=prism)


def near_and_exact(model: Any, slices: Slices, geometry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N + F, A C, L) of bodies and capsules less their clearances as measured, and those of all pairs one by
    one."""
    A, N = slices.finger_opening.shape[0], slices.attached.kind.shape[0]
    is_hand = np.zeros(model.structure.number_of_capsules, bool)
    is_hand[list(model.structure.holding_capsules)] = True
    of_hands = np.asarray(slices.clearance)[: A * N].reshape(A, N, -1)
    fixed = np.full((A, slices.prism.shape[1] - N, of_hands.shape[2]), model.hand_clearance)
    of_hands = np.concatenate([of_hands, fixed], axis=1).swapaxes(0, 1)[:, :, None]
    clearance = np.where(is_hand[:, None], of_hands, model.link_clearance)
    clearance = clearance.reshape(clearance.shape[0], -1, clearance.shape[3])
    R, p, prism = geometry.contacts.bodies
    segments = geometry.contacts.segments
    a, b, radii = (
        segments.start,
        segments.end,
        np.tile(model.capsule_radii, model.structure.number_of_arms)[:, None],
    )
    exact, _ = jax.jit(capsule_prism)(
        a[:, None], b[:, None], radii, R[:, :, :, None], p[:, :, None], prism[:, :, None]
    )
    exact = np.asarray(exact) - clearance
    first = arm_row_signs(model.structure).shape[1]
    ours = np.asarray(geometry.distance)[:, first : first + exact.shape[0] * exact.shape[1]]
    return ours.T.reshape(exact.shape), exact


@pytest.mark.parametrize("near_pairs", [10, CPU.near_pairs, ACCELERATOR.near_pairs])
def test_near_capsules_have_their_distance_and_far_ones_a_bound(
    near_pairs: int, crowd: tuple[Any, Slices], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, near_pairs=near_pairs))
    model, slices = crowd
    ours, exact = near_and_exact(model, slices, compiled(measure)(model, slices))
    counts = ours != FAR
    near = counts & (ours < NEAR)
    per_slice = near.sum((0, 1))
    assert per_slice.sum() > 20 and per_slice.max() > 8 and per_slice.min() < 4
    np.testing.assert_allclose(ours[near], exact[near], rtol=1e-12, atol=1e-12)
    assert (ours[counts] <= exact[counts] + 1e-12).all()
    assert not (counts & (exact < NEAR) & ~near).any()


def test_a_slices_distances_do_not_depend_on_its_neighbours(crowd: tuple[Any, Slices]) -> None:
    """Though they have other numbers of capsules near objects, so that its own are taken elsewhere in a pass."""
    model, slices = crowd
    together = np.asarray(compiled(measure)(model, slices).distance)
    for index in (1, 2):
        alone = jax.tree.map(
            lambda leaf, i=index: np.repeat(leaf[..., [i]], leaf.shape[-1], axis=-1), slices
        )
        np.testing.assert_array_equal(
            np.asarray(compiled(measure)(model, alone).distance)[index], together[index]
        )


def active_rows(geometry: Any, number: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Multiplier estimates and penalties of so many rows of the slice in the middle, and of at most ``most`` of the
    others."""
    L, P = geometry.distance.shape
    generator = np.random.default_rng(0)
    estimate, penalty = np.zeros((2, L, P))
    for index in range(L):
        others = generator.integers(most + 1)
        rows = generator.permutation(P)[: number if index == L // 2 else others]
        estimate[index, rows], penalty[index, rows] = generator.uniform(0.1, 10, (2, P))[:, rows]
    return estimate, penalty


@pytest.mark.parametrize("number", [0, 1, ACTIVE_ROWS, ACTIVE_ROWS + 1, 3 * ACTIVE_ROWS, 40])
@pytest.mark.parametrize("groups", [3, CPU.active_groups, ACCELERATOR.active_groups])
@pytest.mark.parametrize("name", ["path", "fixed_bodies", "single_arm"])
def test_sums_are_those_of_all_rows(
    name: str,
    number: int,
    groups: int,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if name != "path" and groups != CPU.active_groups:
        pytest.skip("other sizes of passes are compiled for one case only")
    evaluated = request.getfixturevalue(name)
    monkeypatch.setattr(batch_sizes, "CPU", replace(CPU, active_groups=groups))
    model, geometry = evaluated.model, evaluated.results.geometry
    L, P = geometry.distance.shape
    estimate, penalty = active_rows(geometry, number, min(number, ACTIVE_ROWS))
    ours = compiled(reduce_slices)(model, geometry, estimate, penalty)
    J = evaluated.results.distance_jacobian.reshape(L, -1, P)
    np.testing.assert_allclose(
        ours.matrix, np.einsum("lip,lp,ljp->lij", J, penalty, J), rtol=1e-10, atol=1e-10
    )
    np.testing.assert_allclose(
        ours.gradient, -np.einsum("lip,lp->li", J, estimate), rtol=1e-10, atol=1e-10
    )
    assert (np.abs(ours.gradient).max() > 0) == (number > 0)


def test_chosen_rows_have_the_derivatives_of_all_rows(path: Any) -> None:
    """Whatever rows are chosen in each slice, and in whatever order."""
    geometry = path.results.geometry
    L, P = geometry.distance.shape
    rows = np.random.default_rng(0).integers(P, size=(L, 7))
    chosen = compiled(distance_jacobian)(path.model, geometry, rows)
    J = path.results.distance_jacobian.reshape(L, -1, P)
    np.testing.assert_allclose(
        chosen, np.take_along_axis(J, rows[:, None], axis=2), rtol=1e-12, atol=1e-12
    )


def test_a_slices_sums_do_not_depend_on_its_neighbours(path: Any) -> None:
    geometry = path.results.geometry
    middle = np.arange(len(geometry.distance)) == len(geometry.distance) // 2
    few, many = (
        compiled(reduce_slices)(path.model, geometry, *active_rows(geometry, number, 3))
        for number in (3, 40)
    )
    for ours, theirs in zip(few, many, strict=True):
        np.testing.assert_array_equal(np.asarray(ours)[~middle], np.asarray(theirs)[~middle])
        assert (np.asarray(ours)[middle] != np.asarray(theirs)[middle]).any()
