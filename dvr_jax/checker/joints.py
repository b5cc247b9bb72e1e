"""The check of the arms' joints and fingers: limits, speeds, accelerations, the home posture, rest at switches."""

from __future__ import annotations

import numpy as np

from dvr_jax.checker.kinds import (
    FINGER_SPEED,
    FINGER_TRAVEL,
    HOME_FINGER,
    HOME_POSTURE,
    JOINT_ACCELERATION,
    JOINT_LIMIT,
    JOINT_SPEED,
    SWITCH_SPEED,
)
from dvr_jax.checker.operators.operator import AttachmentInterval, Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.tolerances import (
    FINGER_TOLERANCE,
    LIMIT_TOLERANCE,
    ROUNDING,
    SHIFT,
    SWITCH_JOINT_SPEED,
)
from dvr_jax.scene.mjcf import home_qpos, qpos_layout
from dvr_jax.workcell.robot import FINGERS


def check_joints(motion: ReplayedMotion, log: FindingLog) -> None:
    """Check every joint of every arm over the whole motion.

    Args:
        motion: The replayed motion.
        log: Takes the findings.
    """
    workcell = motion.scene.workcell
    robot = workcell.robot
    step = motion.motion.step

    for arm, arm_name in enumerate(workcell.arm_names):
        angles = motion.joint_angles(arm)
        names = [(f"{arm_name}/joint{joint + 1}",) for joint in range(robot.number_of_joints)]
        lower, upper = robot.joint_limits
        excess = np.maximum(lower - angles, angles - upper)

        # The arm rests before the motion and after it.
        speeds = np.diff(angles, axis=0) / step
        rest = np.zeros((1, robot.number_of_joints))
        accelerations = np.abs(np.diff(speeds, axis=0, prepend=rest, append=rest)) / step
        away = np.abs(angles[0] - workcell.home[arm])

        fastest = ROUNDING * robot.joint_velocity
        largest = ROUNDING * robot.joint_acceleration
        log.add_worst_of_each(JOINT_LIMIT, 0, names, excess, LIMIT_TOLERANCE)
        log.add_worst_of_each(JOINT_SPEED, 1, names, np.abs(speeds), fastest)
        log.add_worst_of_each(JOINT_ACCELERATION, 0, names, accelerations, largest)
        log.add_worst_of_each(HOME_POSTURE, 0, names, away[None], LIMIT_TOLERANCE)


def check_fingers(motion: ReplayedMotion, log: FindingLog) -> None:
    """Check both fingers of every arm over the whole motion.

    Args:
        motion: The replayed motion.
        log: Takes the findings.
    """
    workcell = motion.scene.workcell
    widest = workcell.robot.finger_travel
    fastest = ROUNDING * workcell.robot.finger_speed
    home = home_qpos(motion.scene)[qpos_layout(motion.scene).fingers]

    for arm, arm_name in enumerate(workcell.arm_names):
        for finger, travels in enumerate(motion.finger_travels(arm).T):
            names = (f"{arm_name}/{FINGERS[finger]}",)
            excess = np.maximum(-travels, travels - widest)
            log.add_worst(FINGER_TRAVEL, 0, names, excess, FINGER_TOLERANCE)

            away = float(abs(travels[0] - home[arm, finger]))
            log.add(HOME_FINGER, 0, names, away, SHIFT)

            speeds = np.abs(np.diff(travels)) / motion.motion.step
            log.add_worst(FINGER_SPEED, 1, names, speeds, fastest)


def check_rest_at_switches(motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that the arms that take or give an object rest at the switch.

    Args:
        motion: The replayed motion.
        timeline: Its intervals.
        log: Takes the findings.
    """
    for interval in timeline.intervals:
        sample = interval.start
        if sample == 0:
            continue
        for arm in _arms_at_switch(motion, timeline, interval):
            angles = motion.joint_angles(arm)
            speeds = np.abs(angles[sample] - angles[sample - 1]) / motion.motion.step
            fastest = int(speeds.argmax())
            names = (f"{motion.arm_name(arm)}/joint{fastest + 1}",)
            speed = float(speeds[fastest])
            log.add(SWITCH_SPEED, sample, names, speed, SWITCH_JOINT_SPEED)


def _arms_at_switch(
    motion: ReplayedMotion, timeline: Timeline, interval: AttachmentInterval
) -> set[int]:
    """The arm of the action that opened an interval, and the arm that held the object before."""
    arms = {motion.scene.workcell.arm_index(interval.arguments["arm"])}
    before = timeline.before(interval)
    if before is not None and before.holder is not None:
        arms.add(before.holder)
    return arms
