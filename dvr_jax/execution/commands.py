"""Targets of the servos in each time step, from the samples of a motion.

With a servo of the gains kp and kv, and with the reference q(t), the target

    u = q + (kv / kp) dq/dt        makes the torque        kp (q - position) + kv (dq/dt - speed).

The reference is the cubic spline through the samples, at rest at both ends. While a gripper holds an object, the
targets of its fingers lie inside the object by so much that they press with the grip force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.motion.interpolation import spline_of
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import Layout, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import FINGERS

SAME_TRAVEL = 1e-4
"""A finger rests on its object while its travel differs from that at the switch by no more than this [m]."""


@dataclass(frozen=True, slots=True)
class GripInterval:
    """Samples in which an arm's gripper is closed on an object."""

    arm: int
    """Number of the arm."""

    object: int
    """Number of the object."""

    first: int
    """Sample at which the fingers have closed; it may lie before the switch."""

    last: int
    """Last sample before the fingers open."""


def grip_intervals(motion: Motion, timeline: Timeline, layout: Layout) -> tuple[GripInterval, ...]:
    """Find when each gripper is closed on an object: around each interval in which it holds it, while its travel stays.

    Args:
        motion: The motion.
        timeline: Intervals in which objects keep their attachments.
        layout: Where the fingers' travels lie in the states.
    """
    found = []
    for interval in timeline.intervals:
        if interval.holder is None:
            continue
        travel = motion.qpos[:, layout.fingers[interval.holder]].mean(axis=1)
        rests = np.abs(travel - travel[interval.start]) <= SAME_TRAVEL
        moving = np.flatnonzero(~rests)
        before = moving[moving < interval.start]
        after = moving[moving > interval.start]
        first = int(before[-1]) + 1 if len(before) else 0
        last = int(after[0]) - 1 if len(after) else len(travel) - 1
        found.append(GripInterval(interval.holder, interval.object, first, min(last, interval.end)))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class ServoCommands:
    """Targets of all servos in each time step."""

    time: Float[np.ndarray, " steps"]
    """Times of the steps, from the start of the motion to the end of the settling [s]."""

    targets: Float[np.ndarray, "steps actuators"]
    """Targets, in the order of the model's actuators [rad or m]."""


def servo_commands(
    model: mujoco.MjModel,
    scene: Scene,
    motion: Motion,
    grips: Sequence[GripInterval],
    conditions: ExecutionConditions,
    duration: float,
) -> ServoCommands:
    """Compute the targets of all servos.

    Args:
        model: The model in which the motion is executed.
        scene: The scene.
        motion: The motion.
        grips: When each gripper is closed on an object.
        conditions: The grip force.
        duration: Time of the last step [s]; after the motion its last targets are held.
    """
    # The reference of all joints and fingers in each step; after the motion it stays at its last point.
    layout = qpos_layout(scene)
    time = model.opt.timestep * np.arange(round(duration / model.opt.timestep) + 1)
    moving = np.minimum(time, motion.time[-1] - motion.time[0])
    driven = np.concatenate([layout.arm_joints, layout.fingers], axis=1)
    reference = spline_of(motion)
    columns = driven.reshape(-1)
    position = reference(moving)[:, columns].reshape(len(time), *driven.shape)
    speed = reference(moving, 1)[:, columns].reshape(len(time), *driven.shape)

    # The target of each servo, by its own gains.
    targets = np.zeros((len(time), model.nu))
    joints = layout.arm_joints.shape[1]
    for arm, name in enumerate(scene.workcell.arm_names):
        names = [f"{name}/joint{i + 1}" for i in range(joints)]
        names += [f"{name}/{finger.replace('finger', 'finger_joint')}" for finger in FINGERS]
        is_gripping = _is_gripping(motion, grips, arm, moving)
        for column, joint in enumerate(names):
            actuator = _servo_of(model, joint)
            kp = float(model.actuator_gainprm[actuator, 0])
            kv = -float(model.actuator_biasprm[actuator, 2])
            targets[:, actuator] = position[:, arm, column] + kv / kp * speed[:, arm, column]
            if column >= joints:
                targets[:, actuator] -= np.where(is_gripping, conditions.grip_force / kp, 0.0)
    return ServoCommands(time, targets)


def _servo_of(model: mujoco.MjModel, joint: str) -> int:
    """Return the number of the actuator that drives a joint."""
    return int(np.flatnonzero(model.actuator_trnid[:, 0] == model.joint(joint).id)[0])


def _is_gripping(
    motion: Motion,
    grips: Sequence[GripInterval],
    arm: int,
    time: Float[np.ndarray, " steps"],
) -> Bool[np.ndarray, " steps"]:
    """Tell in which steps the gripper of an arm presses on an object."""
    sample = time / motion.step
    gripping = np.zeros(len(time), bool)
    for grip in grips:
        if grip.arm == arm:
            gripping |= (sample >= grip.first) & (sample <= grip.last)
    return gripping
