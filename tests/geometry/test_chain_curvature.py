"""Second derivatives along a chain of joints against second differences of poses composed by SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dvr_jax.geometry.chain_curvature import point_curvature, turn_curvature

JOINTS = 5
STEP = 1e-4


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(0)


def _pose(
    axes: np.ndarray, centers: np.ndarray, angles: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, Rotation]:
    """Turn a point about fixed axes in the world, the last joint first."""
    turned = Rotation.identity()
    for axis, center, angle in zip(axes[::-1], centers[::-1], angles[::-1], strict=True):
        turn = Rotation.from_rotvec(angle * axis)
        point = center + turn.apply(point - center)
        turned = turn * turned
    return point, turned


def _second_differences(value, directions: np.ndarray) -> np.ndarray:
    return np.array(
        [(value(STEP * d) - 2 * value(0 * d) + value(-STEP * d)) / STEP**2 for d in directions]
    )


def test_curvature_is_that_of_second_differences(generator: np.random.Generator) -> None:
    axes = generator.normal(size=(JOINTS, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    centers, point = generator.normal(size=(JOINTS, 3)), generator.normal(size=3)
    force, moment = generator.normal(size=(2, 3))
    columns = np.concatenate([axes.T, np.cross(centers, axes).T])
    is_before = np.triu(np.ones((JOINTS, JOINTS), bool))
    directions = generator.normal(size=(6, JOINTS))

    H = np.asarray(point_curvature(columns, force, point, is_before))
    np.testing.assert_array_equal(H, H.T)
    expected = _second_differences(
        lambda angles: force @ _pose(axes, centers, angles, point)[0], directions
    )
    np.testing.assert_allclose(
        np.einsum("ni,ij,nj->n", directions, H, directions), expected, rtol=1e-5
    )

    H = np.asarray(turn_curvature(columns, moment, is_before))
    np.testing.assert_array_equal(H, H.T)
    expected = _second_differences(
        lambda angles: moment @ _pose(axes, centers, angles, point)[1].as_rotvec(), directions
    )
    np.testing.assert_allclose(
        np.einsum("ni,ij,nj->n", directions, H, directions), expected, rtol=1e-5
    )


def test_the_order_of_the_chain_is_given(generator: np.random.Generator) -> None:
    """Joints in the reverse order with the reverse order of the chain."""
    columns = generator.normal(size=(6, JOINTS))
    force, point = generator.normal(size=(2, 3))
    in_order = np.triu(np.ones((JOINTS, JOINTS), bool))
    H = np.asarray(point_curvature(columns, force, point, in_order))
    reverse = np.asarray(point_curvature(columns[:, ::-1], force, point, in_order.T))
    np.testing.assert_allclose(reverse[::-1, ::-1], H)
