"""The largest speed of a hand near a switch, by hand. Planned motions are in `test_path_motion.py`."""

from types import SimpleNamespace

import numpy as np
import pytest

from dvr_jax import sample_scenes
from dvr_jax.planning.hand_limits import (
    LEAST_NEAR_ACCELERATION,
    NEAR_ACCELERATION,
    NEAR_DISTANCE,
    NEAR_SPEED,
    SLOW_DISTANCE,
    USUAL_ROOM,
    near_acceleration,
    near_speed,
    shortest_times,
)


def test_a_hand_is_slow_near_a_switch_alone() -> None:
    """A hand that decelerates from the speed at 4 cm has the slow speed where the slow part begins."""
    distance = np.array([0.0, NEAR_DISTANCE, 0.04, SLOW_DISTANCE + 1e-3])
    speed = near_speed(distance)
    np.testing.assert_allclose(speed[:2], NEAR_SPEED)
    braked = np.sqrt(speed[2] ** 2 - 2 * NEAR_ACCELERATION * (0.04 - NEAR_DISTANCE))
    assert braked == pytest.approx(NEAR_SPEED)
    assert np.isinf(speed[3])


def test_less_room_between_the_fingers_lowers_the_acceleration() -> None:
    """In proportion to the room, between the two ends of its range."""
    room = np.array([0.0, 0.4, 0.8, 3.0]) * USUAL_ROOM
    expected = [LEAST_NEAR_ACCELERATION, 0.4 * NEAR_ACCELERATION, 0.8 * NEAR_ACCELERATION]
    np.testing.assert_allclose(near_acceleration(room), [*expected, NEAR_ACCELERATION])
    slower = near_speed(np.array([0.05]), near_acceleration(room[1]))
    assert slower < near_speed(np.array([0.05]))


def test_a_hand_comes_to_a_wide_object_slowly_and_in_wide_curves() -> None:
    """On a path with a corner of 2 cm radius, 6 cm before a grasp of a box that leaves 1 mm on each side."""
    turn = np.linspace(np.pi / 2, np.pi, 200)
    corner = 0.02 * np.stack([1 + np.cos(turn), np.zeros(200), np.sin(turn)], axis=1)
    straight = np.linspace(0, 0.06, 300)[1:, None] * [0.0, 0.0, -1.0]
    path = np.concatenate([corner, straight])
    hands = np.stack([path, np.tile(path[-1], (len(path), 1))], axis=1)

    scene = next(iter(sample_scenes(1, seed=0)))
    problem = SimpleNamespace(
        arm_at_rest=np.array([[1.0, 0.0]]),
        finger_opening=np.array([[0.04, 0.04], [0.039, 0.04]]),
    )
    times = shortest_times(scene, problem, hands, 0)  # type: ignore[arg-type]
    travel = np.linalg.norm(np.diff(path, axis=0), axis=1)
    speed = travel / times

    # Across the path, v^2 / r; along it, the deceleration from the speed before.
    acceleration = near_acceleration(np.array(0.001))
    in_corner = speed[50:150] ** 2 / 0.02
    np.testing.assert_allclose(in_corner, acceleration, rtol=0.02)
    assert speed[-1] == pytest.approx(NEAR_SPEED)
