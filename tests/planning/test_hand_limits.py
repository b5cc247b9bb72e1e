"""Limits of hands: the largest speed near a switch by hand, and the accelerations of hands in a planned motion."""

import numpy as np
import pytest

from dvr_jax import sample_scenes
from dvr_jax.planning.carried_objects import gripper_frames
from dvr_jax.planning.hand_limits import (
    HELD_ACCELERATION,
    NEAR_ACCELERATION,
    NEAR_DISTANCE,
    NEAR_SPEED,
    SLOW_DISTANCE,
    near_speed,
)
from dvr_jax.planning.planner import plan

RATE = 1000.0


def test_a_hand_is_slow_near_a_switch_alone() -> None:
    """A hand that decelerates from the speed at 4 cm has the slow speed where the slow part begins."""
    distance = np.array([0.0, NEAR_DISTANCE, 0.04, SLOW_DISTANCE + 1e-3])
    speed = near_speed(distance)
    np.testing.assert_allclose(speed[:2], NEAR_SPEED)
    braked = np.sqrt(speed[2] ** 2 - 2 * NEAR_ACCELERATION * (0.04 - NEAR_DISTANCE))
    assert braked == pytest.approx(NEAR_SPEED)
    assert np.isinf(speed[3])


def test_hands_of_a_plan_are_slow_at_their_grasps_and_gentle_while_they_hold() -> None:
    [scene] = sample_scenes(1, objects=2, seed=12)
    found = plan(scene, "mbts")
    assert found.motion is not None
    motion = found.motion.sample(RATE)
    hands, _ = gripper_frames(scene, motion.qpos)
    velocity = np.gradient(hands, 1 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1 / RATE, axis=0)

    held_by: int | None = None
    grasps = 0
    switches = [*motion.switch.tolist(), len(motion.time) - 1]
    for action, start, end in zip(found.actions, switches[:-1], switches[1:], strict=True):
        arm = scene.workcell.arm_index(action.arguments[0])
        if action.operator == "grasp":
            # Before the switch, within the slow part.
            near = np.linalg.norm(hands[: start + 1, arm] - hands[start, arm], axis=1)
            slow = np.flatnonzero(near > NEAR_DISTANCE)[-1] + 1
            speed = np.linalg.norm(velocity[slow:start, arm], axis=1)
            assert 0.5 * NEAR_SPEED < speed.max() < 1.03 * NEAR_SPEED
            held_by = arm
            grasps += 1
        elif action.operator == "place":
            held_by = None
        if held_by is not None and action.operator == "grasp":
            of_hand = np.abs(acceleration[start:end, held_by])
            assert 0.3 * HELD_ACCELERATION < of_hand.max() < 1.03 * HELD_ACCELERATION
    assert grasps
