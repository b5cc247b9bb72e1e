"""The check of the jerks and torques of the arms' joints, which a report has only if it is asked for.

Both follow from finite differences of the samples at the motion's step h, with every arm at rest before and after:

    v_i = (q_i+1 - q_i-1) / 2h
    a_i = (q_i+1 - 2 q_i + q_i-1) / h^2
    j_i = (q_i+1 - 3 q_i + 3 q_i-1 - q_i-2) / h^3

The jerk j_i is a mean over three steps; a motion may exceed it for a shorter time. Torques are those of MuJoCo's
inverse dynamics of the arm, with the held object as a rigid body in its hand. Friction in the joints and the inertia of
the drives are not included.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from dvr_jax.checker.kinds import JOINT_JERK, JOINT_TORQUE
from dvr_jax.checker.loaded_arm import Load, LoadedArm
from dvr_jax.checker.operators.operator import AttachmentInterval, Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.tolerances import ROUNDING

REST_SAMPLES = 2
"""Number of samples at rest that are put before and after a motion."""


def check_jerks(motion: ReplayedMotion, log: FindingLog) -> None:
    """Check that no joint's acceleration changes faster than its robot can.

    Args:
        motion: The replayed motion.
        log: Takes the findings.
    """
    largest = ROUNDING * motion.scene.workcell.robot.joint_jerk
    for arm in range(motion.scene.workcell.number_of_arms):
        q = _with_rest(motion.joint_angles(arm))
        jerks = np.abs(np.diff(q, 3, axis=0)) / motion.motion.step**3

        # The last difference reaches two samples beyond the motion, and counts as one of the last sample.
        jerks[-2] = np.maximum(jerks[-2], jerks[-1])
        log.add_worst_of_each(JOINT_JERK, 0, _joint_names(motion, arm), jerks[:-1], largest)


def check_torques(motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that no joint needs more torque than its robot has.

    Args:
        motion: The replayed motion.
        timeline: Its intervals.
        log: Takes the findings.
    """
    workcell = motion.scene.workcell
    largest = ROUNDING * workcell.robot.joint_torque
    empty = LoadedArm(workcell.robot)
    for arm in range(workcell.number_of_arms):
        names = _joint_names(motion, arm)
        every = slice(0, len(motion.motion.time))
        torques = _torques(motion, arm, empty, every)

        # With a load where the arm holds an object.
        for interval in timeline.intervals:
            if interval.holder == arm:
                held = slice(interval.start, interval.end)
                loaded = LoadedArm(workcell.robot, _load(motion, arm, interval))
                torques[held] = _torques(motion, arm, loaded, held)
        log.add_worst_of_each(JOINT_TORQUE, 0, names, np.abs(torques), largest)


def _joint_names(motion: ReplayedMotion, arm: int) -> list[tuple[str, ...]]:
    """Names of the joints of an arm, as in "left/joint4"."""
    joints = range(1, motion.scene.workcell.robot.number_of_joints + 1)
    return [(f"{motion.arm_name(arm)}/joint{joint}",) for joint in joints]


def _with_rest(angles: Float[np.ndarray, "samples joints"]) -> Float[np.ndarray, "padded joints"]:
    """Samples of a motion with rest before and after it."""
    return np.pad(angles, ((REST_SAMPLES, REST_SAMPLES), (0, 0)), mode="edge")


def _torques(
    motion: ReplayedMotion, arm: int, dynamics: LoadedArm, part: slice
) -> Float[np.ndarray, "samples joints"]:
    """Compute the torques of an arm in a part of a motion.

    Args:
        motion: The replayed motion.
        arm: Number of the arm.
        dynamics: Its dynamics with what it holds.
        part: The samples.

    Returns:
        Torques [N m].
    """
    step = motion.motion.step
    angles = motion.joint_angles(arm)
    q = _with_rest(angles)
    velocity = (q[3:-1] - q[1:-3]) / (2 * step)
    acceleration = np.diff(q, 2, axis=0)[1:-1] / step**2
    fingers = motion.finger_travels(arm)
    return dynamics.torques(angles[part], velocity[part], acceleration[part], fingers[part])


def _load(motion: ReplayedMotion, arm: int, interval: AttachmentInterval) -> Load:
    """Return the object that an arm holds in an interval, as its hand holds it at the start.

    Args:
        motion: The replayed motion.
        arm: Number of the arm.
        interval: The interval.
    """
    positions, rotations = motion.object_in_gripper(interval.object, arm)

    # The axes of the gripper's site are those of the hand.
    center = motion.scene.workcell.robot.model.site("gripper").pos
    item = motion.scene.objects[interval.object]
    return Load(item, center + positions[interval.start], rotations[interval.start])
