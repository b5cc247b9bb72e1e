"""The largest speed of a hand near a switch, by hand. Planned motions are in `test_path_motion.py`."""

import numpy as np
import pytest

from dvr_jax.planning.hand_limits import (
    NEAR_ACCELERATION,
    NEAR_DISTANCE,
    NEAR_SPEED,
    SLOW_DISTANCE,
    near_speed,
)


def test_a_hand_is_slow_near_a_switch_alone() -> None:
    """A hand that decelerates from the speed at 4 cm has the slow speed where the slow part begins."""
    distance = np.array([0.0, NEAR_DISTANCE, 0.04, SLOW_DISTANCE + 1e-3])
    speed = near_speed(distance)
    np.testing.assert_allclose(speed[:2], NEAR_SPEED)
    braked = np.sqrt(speed[2] ** 2 - 2 * NEAR_ACCELERATION * (0.04 - NEAR_DISTANCE))
    assert braked == pytest.approx(NEAR_SPEED)
    assert np.isinf(speed[3])
