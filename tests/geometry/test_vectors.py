"""Vectors and rotations against NumPy and `scipy.spatial.transform.Rotation`."""

import jax.numpy as jnp
import numpy as np
import pytest
from convex_pairs import columns, components
from scipy.spatial.transform import Rotation

from dvr_jax.geometry import vectors

N = 200
TIGHT = {"rtol": 1e-13, "atol": 1e-14}


@pytest.fixture
def turns() -> tuple[Rotation, Rotation]:
    return Rotation.random(N, random_state=0), Rotation.random(N, random_state=1)


@pytest.fixture
def arrows() -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(2)
    return generator.normal(size=(N, 3)), generator.normal(size=(N, 3))


def stacked(v: vectors.Vector) -> np.ndarray:
    return np.stack([np.asarray(x) for x in v], axis=-1)


def matrices(R: vectors.Rotation) -> np.ndarray:
    return np.stack([stacked(column) for column in R], axis=-1)


def test_vector_algebra(arrows: tuple[np.ndarray, np.ndarray]) -> None:
    a, b = arrows
    u = components(a)
    v = components(b)
    np.testing.assert_allclose(vectors.dot(u, v), np.einsum("ni,ni->n", a, b), **TIGHT)
    np.testing.assert_allclose(stacked(vectors.cross(u, v)), np.cross(a, b), **TIGHT)
    np.testing.assert_allclose(
        stacked(vectors.normalize(u)), a / np.linalg.norm(a, axis=1)[:, None], **TIGHT
    )


def test_normalize_keeps_zero() -> None:
    assert not stacked(vectors.normalize(components(jnp.zeros((1, 3))))).any()


def test_rotations(turns: tuple[Rotation, Rotation], arrows: tuple[np.ndarray, np.ndarray]) -> None:
    first, second = turns
    a, _ = arrows
    R = columns(first.as_matrix())
    Q = columns(second.as_matrix())
    v = components(a)
    np.testing.assert_allclose(stacked(vectors.rotate(R, v)), first.apply(a), **TIGHT)
    np.testing.assert_allclose(stacked(vectors.rotate_back(R, v)), first.inv().apply(a), **TIGHT)
    np.testing.assert_allclose(
        matrices(vectors.compose(R, Q)), (first * second).as_matrix(), **TIGHT
    )
    np.testing.assert_allclose(matrices(vectors.transpose(R)), first.inv().as_matrix(), **TIGHT)


def test_rotation_about_z() -> None:
    angle = np.linspace(-4, 4, N)
    ours = matrices(vectors.rotation_about_z(jnp.cos(angle), jnp.sin(angle)))
    np.testing.assert_allclose(ours, Rotation.from_euler("z", angle[:, None]).as_matrix(), **TIGHT)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.3, 1.5, 3.0, np.pi - 1e-5, np.pi])
def test_rotation_angle(angle: float) -> None:
    axis = np.random.default_rng(3).normal(size=(N, 3))
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis, axis=1)[:, None])
    np.testing.assert_allclose(
        vectors.rotation_angle(columns(turn.as_matrix())), angle, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.3, 1.5, 2.9])
def test_half_rotation_vector(angle: float) -> None:
    """Up to 2.94 rad (w >= 0.1 / 2), where the helper's documented bound on w sets in."""
    axis = np.random.default_rng(4).normal(size=(N, 3))
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis, axis=1)[:, None])
    w, v = vectors.half_rotation_vector(columns(turn.as_matrix()))
    expected = turn.as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(w, expected[:, 0], rtol=1e-12)
    np.testing.assert_allclose(stacked(v), expected[:, 1:], rtol=1e-10, atol=1e-14)
    # Twice v is the rotation vector to third order.
    np.testing.assert_allclose(2 * stacked(v), turn.as_rotvec(), atol=angle**3 / 20 + 1e-14)


def test_half_rotation_vector_of_half_a_turn_is_finite_but_blind() -> None:
    """At exactly half a turn v vanishes; that is why the verdict takes `rotation_angle`."""
    turn = Rotation.from_rotvec([[0, 0, np.pi], [np.pi, 0, 0]])
    _, v = vectors.half_rotation_vector(columns(turn.as_matrix()))
    np.testing.assert_allclose(stacked(v), 0, atol=1e-14)
    np.testing.assert_allclose(vectors.rotation_angle(columns(turn.as_matrix())), np.pi)
