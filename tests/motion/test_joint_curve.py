"""The curve of joint angles through a path's slices."""

import numpy as np
import pytest

from dvr_jax.motion.joint_curve import joint_curve


@pytest.mark.parametrize("joints", [1, 6, 14])
def test_passes_through_home_and_all_slices_from_rest(joints: int) -> None:
    generator = np.random.default_rng(joints)
    home = generator.normal(size=joints)
    q = generator.normal(size=(8, joints))
    curve = joint_curve(home, q)
    np.testing.assert_allclose(curve(np.arange(9)), [home, *q], atol=1e-14)
    np.testing.assert_allclose(curve(0.0, 1), 0.0, atol=1e-14)


def test_stays_between_the_angles_at_both_ends_of_each_interval() -> None:
    generator = np.random.default_rng(0)
    home = generator.normal(size=3)
    q = generator.normal(size=(12, 3))
    ends = np.concatenate([home[None], q])
    times = np.arange(12)[:, None] + np.linspace(0.0, 1.0, 21)
    angles = joint_curve(home, q)(times)
    lower = np.minimum(ends[:-1], ends[1:])[:, None]
    upper = np.maximum(ends[:-1], ends[1:])[:, None]
    assert np.all(angles >= lower - 1e-12)
    assert np.all(angles <= upper + 1e-12)


def test_rests_where_two_slices_agree() -> None:
    q = np.array([[0.1], [0.4], [0.4], [0.9]])
    angles = joint_curve(np.zeros(1), q)(np.linspace(2.0, 3.0, 11))
    np.testing.assert_allclose(angles, 0.4, atol=1e-14)


def test_follows_fritsch_and_butland() -> None:
    """The slope at an inner slice is the harmonic mean of the slopes beside it, or zero at an extremum."""
    curve = joint_curve(np.zeros(1), np.array([[1.0], [4.0], [3.0]]))
    np.testing.assert_allclose(curve([1.0, 2.0], 1)[:, 0], [2 * 1 * 3 / (1 + 3), 0.0], atol=1e-12)


def _turning_joint() -> tuple[np.ndarray, np.ndarray]:
    """Return slices of two joints and where they move straight: the second one turns around at 1 rad, its limit."""
    q = np.array([[0.0, 0.4], [0.5, 1.0], [1.1, 0.7], [1.1, 0.7]])
    straight = np.array([[False], [False], [True], [False]])
    return q, straight


def test_a_joint_that_turns_around_before_a_straight_interval_stays_within_its_range() -> None:
    q, straight = _turning_joint()
    limits = np.array([[-3.0, -3.0], [3.0, 1.0]])
    times = np.linspace(0.0, 4.0, 801)
    free = joint_curve(np.zeros(2), q, straight)(times)
    assert free[:, 1].max() > 1.005

    curve = joint_curve(np.zeros(2), q, straight, limits)
    assert curve(times)[:, 1].max() <= 1.0 + 1e-3
    # The arm still moves straight, and the second derivative is continuous.
    inside = curve(np.linspace(2.0, 3.0, 21)) - q[1]
    np.testing.assert_allclose(inside[:, 0] * -0.3, inside[:, 1] * 0.6, atol=1e-12)
    np.testing.assert_allclose(
        curve(np.arange(1.0, 4.0) - 1e-9, 2), curve(np.arange(1.0, 4.0), 2), atol=1e-6
    )


def test_wide_limits_change_nothing() -> None:
    q, straight = _turning_joint()
    limits = np.array([[-3.0, -3.0], [3.0, 3.0]])
    times = np.linspace(0.0, 4.0, 81)
    expected = joint_curve(np.zeros(2), q, straight)(times)
    np.testing.assert_array_equal(joint_curve(np.zeros(2), q, straight, limits)(times), expected)
