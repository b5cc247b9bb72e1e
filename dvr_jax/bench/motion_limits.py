"""How much of the limits of the joints a motion uses, at 1 kHz.

Velocities, accelerations and jerks are finite differences of consecutive samples at the step h = 1 ms:

    v_i = (q_i+1 - q_i) / h,    a_i = (q_i+1 - 2 q_i + q_i-1) / h^2,    j_i = (q_i+2 - 3 q_i+1 + 3 q_i - q_i-1) / h^3.

Each is a mean of the derivative over the samples that it is made of. Before its first sample and after its last one a
motion rests, so a jump of the acceleration at either end counts as a jerk.

Torques are MuJoCo's inverse dynamics `mj_inverse` of a model of one arm that carries the held object as a rigid body,
where it lies in the hand, with its mass and its inertia. The planner's timing takes the load for a point mass at the
gripper center instead. Friction in the joints and the inertia of the drives are not included in either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.bench.motion_states import MotionStates
from dvr_jax.checker.loaded_arm import Load, LoadedArm
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import object_body_name
from dvr_jax.scene.types import Scene

RATE = 1000.0
"""Rate at which limits are looked at [1/s]; that of Franka's control interface."""

REST_SAMPLES = 3
"""Number of samples at rest that are put before and after a motion."""


@dataclass(frozen=True, slots=True)
class LimitUse:
    """The largest ratio of a quantity to its limit."""

    ratio: float
    """Largest value over its limit; more than 1 exceeds the limit."""

    joint: str
    """Where, as in "left/joint4"."""

    time: float
    """When [s]."""


def limit_uses(states: MotionStates) -> dict[str, LimitUse]:
    """Measure how much of the limits of velocity, acceleration, jerk, torque and finger speed a motion uses.

    Args:
        states: The motion with the poses of its bodies, at any rate.

    Returns:
        The largest ratios by quantity.
    """
    scene = states.scene
    layout = qpos_layout(scene)
    robot = scene.workcell.robot
    sampled = states.motion.sample(RATE)
    found: list[tuple[str, LimitUse]] = []
    for arm, name in enumerate(scene.workcell.arm_names):
        q = sampled.qpos[:, layout.arm_joints[arm]]
        limits = (robot.joint_velocity, robot.joint_acceleration, robot.joint_jerk)
        quantities = zip(("velocity", "acceleration", "jerk"), limits, strict=True)
        for order, (quantity, limit) in enumerate(quantities, start=1):
            used = _largest(finite_differences(q, order), limit, f"{name}/joint")
            found.append((quantity, used))

        torque = arm_torques(states, sampled, arm)
        found.append(("torque", _largest(torque, robot.joint_torque, f"{name}/joint")))
        fingers = finite_differences(sampled.qpos[:, layout.fingers[arm]], 1)
        speeds = np.full(2, robot.finger_speed)
        found.append(("finger speed", _largest(fingers, speeds, f"{name}/finger")))

    worst: dict[str, LimitUse] = {}
    for quantity, use in found:
        if quantity not in worst or use.ratio > worst[quantity].ratio:
            worst[quantity] = use
    return worst


def finite_differences(
    q: Float[np.ndarray, "samples joints"], order: int
) -> Float[np.ndarray, "differences joints"]:
    """Return finite differences of samples at 1 kHz, with rest before and after them.

    Args:
        q: The samples [rad or m].
        order: 1 for velocities, 2 for accelerations, 3 for jerks.

    Returns:
        The differences; number i begins at sample ``i - REST_SAMPLES``.
    """
    padded = np.pad(q, ((REST_SAMPLES, REST_SAMPLES), (0, 0)), mode="edge")
    return np.diff(padded, order, axis=0) * RATE**order


def _largest(
    values: Float[np.ndarray, "samples joints"], limit: Float[np.ndarray, " joints"], prefix: str
) -> LimitUse:
    """Return the largest ratio of some values to their limits.

    Args:
        values: The values; the first is one of `REST_SAMPLES` before the motion.
        limit: Limit of each joint.
        prefix: Name of a joint without its number.
    """
    ratio = np.abs(values) / limit
    sample, joint = np.unravel_index(int(ratio.argmax()), ratio.shape)
    time = max(int(sample) - REST_SAMPLES, 0) / RATE
    return LimitUse(float(ratio.max()), f"{prefix}{joint + 1}", time)


def arm_torques(
    states: MotionStates, sampled: Motion, arm: int
) -> Float[np.ndarray, "samples joints"]:
    """Compute the torques of an arm along a motion, with what it holds.

    Args:
        states: The motion with the poses of its bodies, at any rate.
        sampled: The same motion at 1 kHz.
        arm: Number of the arm.

    Returns:
        Torques [N m], also for samples at rest before and after the motion.
    """
    layout = qpos_layout(states.scene)
    q = sampled.qpos[:, layout.arm_joints[arm]]
    padded = np.pad(q, ((REST_SAMPLES, REST_SAMPLES), (0, 0)), mode="edge")
    velocity = np.gradient(padded, 1 / RATE, axis=0)
    acceleration = np.pad(np.diff(padded, 2, axis=0) * RATE**2, ((1, 1), (0, 0)))
    fingers = np.pad(
        sampled.qpos[:, layout.fingers[arm]], ((REST_SAMPLES, REST_SAMPLES), (0, 0)), mode="edge"
    )

    # The arm without a load, then anew where it holds something.
    robot = states.scene.workcell.robot
    torques = LoadedArm(robot).torques(padded, velocity, acceleration, fingers)
    start = sampled.time[0]
    for interval in states.holds(arm):
        ends = [
            states.motion.time[min(edge, len(states.motion.time) - 1)] - start
            for edge in (interval.start, interval.end)
        ]
        first, last = (round(float(end) * RATE) + REST_SAMPLES for end in ends)
        part = slice(first, last + 1)
        loaded = LoadedArm(robot, load_in_hand(states, arm, interval.object, interval.start))
        torques[part] = loaded.torques(
            padded[part], velocity[part], acceleration[part], fingers[part]
        )
    return torques


def load_in_hand(states: MotionStates, arm: int, item: int, sample: int) -> Load:
    """Return an object as its hand holds it.

    Args:
        states: The motion with the poses of its bodies.
        arm: Number of the arm.
        item: Number of the object.
        sample: Sample at which the hand holds it.
    """
    scene: Scene = states.scene
    held = scene.objects[item]
    hand = f"{scene.workcell.arm_names[arm]}/hand"
    position, rotation = states.pose_in(object_body_name(held.name), hand)
    return Load(held, position[sample], rotation[sample])
