"""Motions at other rates, and the spline between their samples."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from dvr_jax.errors import OptionError
from dvr_jax.motion.interpolation import spline_of
from dvr_jax.motion.motion import Motion, make_motion


@pytest.fixture
def motion() -> Motion:
    """Half a period of a cosine, which is at rest at both ends."""
    time = np.linspace(2.0, 3.0, 51)
    qpos = np.stack([np.cos(np.pi * (time - 2)), 0.1 * time], axis=1)
    return make_motion(time, qpos, [20, 41])


def test_samples_lie_on_the_clamped_spline(motion: Motion) -> None:
    """Against SciPy's other construction of the same spline, by B-splines."""
    rest = [(1, np.zeros(2))]
    expected = make_interp_spline(motion.time, motion.qpos, bc_type=(rest, rest))
    fine = motion.sample(1000.0)
    np.testing.assert_allclose(np.diff(fine.time), 1e-3, atol=1e-12)
    np.testing.assert_allclose(fine.qpos, expected(fine.time), atol=1e-12)
    np.testing.assert_allclose(fine.qpos[:, 0], np.cos(np.pi * (fine.time - 2)), atol=1e-7)


def test_the_given_samples_are_kept(motion: Motion) -> None:
    fine = motion.sample(500.0)
    np.testing.assert_allclose(fine.qpos[::10], motion.qpos, atol=1e-12)
    assert fine.switch.tolist() == [200, 410]
    assert fine.time[0] == motion.time[0] and fine.time[-1] == pytest.approx(motion.time[-1])


def test_a_rate_that_does_not_divide_the_duration_ends_at_the_last_state(motion: Motion) -> None:
    coarse = motion.sample(7.0)
    assert motion.time[-1] <= coarse.time[-1] < motion.time[-1] + 1 / 7
    np.testing.assert_allclose(coarse.qpos[-1], motion.qpos[-1], atol=1e-12)
    # Actions at 0.4 s and 0.82 s take effect at the next seventh of a second.
    assert coarse.switch.tolist() == [3, 6]


def test_the_motion_rests_at_both_ends(motion: Motion) -> None:
    spline = spline_of(motion)
    np.testing.assert_allclose(spline([0.0, 1.0], 1), 0, atol=1e-12)


@pytest.mark.parametrize("rate", [0.0, -5.0, 0.5, 10_001.0, np.nan, np.inf])
def test_a_rate_that_makes_no_sense_is_refused(motion: Motion, rate: float) -> None:
    with pytest.raises(OptionError, match="valid is 1 to 10000"):
        motion.sample(rate)
