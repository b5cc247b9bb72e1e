"""Turn a solved path into a motion of the whole scene: fast, within the limits of the arms, sampled evenly in time.

Notation: a path of K actions has T slices and S = T / K slices in each phase. It begins at home.

- In each phase the arms move along a smooth curve (`dvr_jax.motion.joint_curve`) from rest to rest, as fast as the
  limits of joint velocity, acceleration, jerk and torque allow (`dvr_jax.motion.retiming`). The torques include the
  weight of the objects that are held. Hands have limits of their own (`dvr_jax.planning.hand_limits`).
- Then all arms rest while the fingers move. In a handover the fingers of the taking arm close first, and those of the
  giving arm open afterwards. The object changes its holder between the two, or else when the fingers have moved.
- At the end the hand that has released the last object retreats (`dvr_jax.planning.retreat`).
- At each switch the arm that acts is exactly where the object has one pose (`dvr_jax.planning.exact_switches`).
- The pose of a held object follows from the pose of its gripper, which is computed by MuJoCo's forward kinematics, and
  from the mode parameters of the NLP.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.modes.mode import ModeKind
from dvr_jax.motion.dynamics import arm_dynamics
from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.motion.retiming import TIME_STEP, MotionLimits, Torques, time_optimal
from dvr_jax.nlp.problem import Problem
from dvr_jax.planning.carried_objects import carry_objects
from dvr_jax.planning.exact_switches import exact_switches
from dvr_jax.planning.hand_limits import hand_accelerations, hand_positions, shortest_times
from dvr_jax.planning.retreat import retreat
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.solver.continuous_collision import straight_intervals
from dvr_jax.workcell.model import workcell_model
from dvr_jax.workcell.robot import Robot

CURVE_POINTS = 12
"""Number of points of the curve in each interval between two slices from which the motion is timed."""

FINGER_SPEED_FRACTION = 0.9
"""Fraction of the limit of finger speed that a motion may use."""

FINGER_RAMP = 0.15
"""Fraction of the duration of a motion of the fingers in which they gain speed, and in which they lose it."""

SHORTEST_PAUSE = 0.1
"""Shortest time for which the arms rest at a switch [s]."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of a motion: some samples of joints and fingers, without the one before the first."""

    joints: Float[np.ndarray, "samples joints"]
    """Joint angles of all arms [rad]."""

    fingers: Float[np.ndarray, "samples arms"]
    """Opening of each arm's fingers [m]."""

    phase: Int[np.ndarray, " samples"]
    """Number of actions that have taken effect at each sample."""


def interpolate(
    scene: Scene,
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    m: Float[np.ndarray, "actions parameters"],
) -> Motion:
    """Return the motion of the whole scene along a solved path.

    Args:
        scene: Scene of the path.
        problem: NLP of the path's sequence, without batch axes.
        q: (T, joints) joint angles of all arms in the slices [rad].
        m: (K, 4) mode parameters [m or rad].

    Returns:
        The motion of the whole scene.
    """
    K = m.shape[0]
    S = q.shape[0] // K
    home = np.asarray(problem.home)
    opening = np.asarray(problem.finger_opening)
    q = _at_rest(problem, exact_switches(scene, problem, q, m))
    limits = scene.workcell.robot.joint_limits
    curve = joint_curve(home, q, straight_intervals(problem, len(q)), limits)

    parts = [_Part(home[None], opening[:1], np.zeros(1, int))]
    for k in range(K):
        # The last interval of a phase is a pause, which has its own duration.
        points = curve(np.linspace(k * S, (k + 1) * S - 1, CURVE_POINTS * (S - 1) + 1))
        parts.append(_moving_part(_timed(scene, problem, m, points, k)[1:], opening[k], k))
        parts.append(_pause(scene.workcell.robot, q[(k + 1) * S - 1], opening[k : k + 2], k))

    parts += _retreat_part(scene, problem, q, m)
    joints = np.concatenate([part.joints for part in parts])
    fingers = np.concatenate([part.fingers for part in parts])
    phase = np.concatenate([part.phase for part in parts])

    # The objects follow from the arms.
    layout = qpos_layout(scene)
    qpos = np.zeros((len(joints), layout.size))
    qpos[:, layout.arm_joints.reshape(-1)] = joints
    qpos[:, layout.fingers.reshape(-1)] = np.repeat(fingers, 2, axis=1)
    carry_objects(scene, problem, m, phase, qpos)
    return make_motion(
        TIME_STEP * np.arange(len(qpos)), qpos, np.searchsorted(phase, np.arange(1, K + 1))
    )


def _at_rest(
    problem: Problem, q: Float[np.ndarray, "slices joints"]
) -> Float[np.ndarray, "slices joints"]:
    """Let arms rest exactly where the NLP lets them rest within its tolerance.

    Args:
        problem: NLP of the path.
        q: Joint angles in the slices [rad].

    Returns:
        Joint angles [rad], with equal postures at both ends of the intervals in which an arm rests.
    """
    K = len(problem.switched_object)
    S = len(q) // K
    arms = problem.still_arm.shape[-1]
    rested = np.array(q).reshape(K, S, arms, -1)
    rested[:, S - 2] = rested[:, S - 1]
    leaves, comes = np.moveaxis(np.asarray(problem.still_arm) > 0, 1, 0)
    rested[1:, 0][leaves[1:]] = rested[:-1, S - 1][leaves[1:]]
    rested[:, S - 3][comes] = rested[:, S - 2][comes]
    return rested.reshape(q.shape)


def _limits(robot: Robot, arms: int) -> MotionLimits:
    """Return the limits of the joints of all arms."""
    return MotionLimits(
        velocity=np.tile(robot.joint_velocity, arms),
        acceleration=np.tile(robot.joint_acceleration, arms),
        jerk=np.tile(robot.joint_jerk, arms),
        torque=np.tile(robot.joint_torque, arms),
    )


def _torques(scene: Scene, problem: Problem, phase: int) -> Torques:
    """Return the inverse dynamics of all arms with what they hold in a phase."""
    dynamics = arm_dynamics(scene.workcell.robot)
    joints = scene.workcell.robot.number_of_joints
    loads = np.zeros(scene.workcell.number_of_arms)
    for item, body in enumerate(scene.objects):
        if int(problem.mode_kind[phase, item]) == ModeKind.HELD:
            loads[int(problem.mode_parent[phase, item])] += body.mass

    def torques(q: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Torques of all arms [N m]."""
        each = [slice(arm * joints, (arm + 1) * joints) for arm in range(len(loads))]
        return np.concatenate(
            [
                dynamics.torques(q[:, own], velocity[:, own], acceleration[:, own], float(load))
                for own, load in zip(each, loads, strict=True)
            ],
            axis=1,
        )

    return torques


def _timed(
    scene: Scene,
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    points: Float[np.ndarray, "points joints"],
    phase: int,
) -> Float[np.ndarray, "samples joints"]:
    """Return the samples of a fast motion along a phase, within the limits of its joints and its hands.

    Args:
        scene: Scene of the path.
        problem: NLP of the path.
        m: Mode parameters [m or rad].
        points: Joint angles along the phase [rad].
        phase: Number of the phase; that of the retreat is the number of actions.
    """
    joints = points.shape[1]
    limits = _limits(scene.workcell.robot, scene.workcell.number_of_arms)
    hands = hand_positions(scene, points)
    times = shortest_times(scene, problem, hands, phase)
    accelerations = hand_accelerations(scene, problem, m, phase)

    # To the timing, the coordinates of the hands are further joints, which only have limits of acceleration.
    limited = np.isfinite(accelerations)
    coordinates = hands[:, limited].reshape(len(points), -1)
    none = np.full(coordinates.shape[1], np.inf)
    extended = MotionLimits(
        velocity=np.append(limits.velocity, none),
        acceleration=np.append(limits.acceleration, np.repeat(accelerations[limited], 3)),
        jerk=np.append(limits.jerk, none),
        torque=np.append(limits.torque, none),
    )
    of_arms = _torques(scene, problem, phase)

    def torques(q: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Torques of all arms [N m], and zeros for the coordinates of hands."""
        found = of_arms(q[:, :joints], velocity[:, :joints], acceleration[:, :joints])
        return np.pad(found, ((0, 0), (0, len(none))))

    timed = time_optimal(np.concatenate([points, coordinates], axis=1), extended, torques, times)
    return timed[:, :joints]


def _moving_part(
    joints: Float[np.ndarray, "samples joints"], opening: Float[np.ndarray, " arms"], phase: int
) -> _Part:
    """Return samples in which arms move and fingers do not."""
    samples = len(joints)
    return _Part(joints, np.tile(opening, (samples, 1)), np.full(samples, phase))


def _pause(
    robot: Robot,
    posture: Float[np.ndarray, " joints"],
    opening: Float[np.ndarray, "2 arms"],
    phase: int,
) -> _Part:
    """Return samples in which the arms rest and the fingers move.

    Args:
        robot: The robot that all arms are.
        posture: Joint angles of all arms [rad].
        opening: Opening of each arm's fingers before and after [m].
        phase: Number of actions that have taken effect before.
    """
    before, after = opening
    closing = np.minimum(after, before)
    steps = [
        _finger_samples(robot, start, end)
        for start, end in ((before, closing), (closing, after))
        if np.abs(end - start).max() > 0
    ]
    least = math.ceil(SHORTEST_PAUSE / TIME_STEP)
    fingers = np.concatenate([*steps, after[None]])
    fingers = np.concatenate([fingers, np.tile(after, (max(least - len(fingers), 0), 1))])

    # In a handover the object changes hands when the taking fingers have closed.
    phases = np.full(len(fingers), phase)
    phases[(len(steps[0]) if len(steps) > 1 else len(fingers)) - 1 :] = phase + 1
    return _Part(np.tile(posture, (len(fingers), 1)), fingers, phases)


def _finger_samples(
    robot: Robot, start: Float[np.ndarray, " arms"], end: Float[np.ndarray, " arms"]
) -> Float[np.ndarray, "samples arms"]:
    """Return samples of fingers that move at a constant speed, but for a steady start and end.

    With the fraction r of the duration for the start and as much for the end, the travel is ``top speed * (1 - r)``.
    """
    r = FINGER_RAMP
    fastest = FINGER_SPEED_FRACTION * robot.finger_speed
    duration = float(np.abs(end - start).max()) / fastest / (1 - r)
    samples = math.ceil(duration / TIME_STEP)
    tau = (np.arange(1, samples + 1) / samples)[:, None]
    inner = np.clip(tau, r, 1 - r)
    gaining = np.where(tau < r, tau**2 / (2 * r), inner - r / 2)
    travelled = np.where(tau > 1 - r, 1 - r - (1 - tau) ** 2 / (2 * r), gaining)
    law = travelled / (1 - r)
    return start + (end - start) * law


def _retreat_part(
    scene: Scene,
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    m: Float[np.ndarray, "actions parameters"],
) -> list[_Part]:
    """Return the samples of the retreat after the last action, if there is one."""
    K = len(m)
    distance = scene.workcell.clearances.approach
    away = retreat(workcell_model(scene.workcell), problem, q, m, distance)
    if len(away) < 2:
        return []
    points = np.concatenate([q[-1:], away])
    moving = _timed(scene, problem, m, points, K)[1:]
    return [_moving_part(moving, np.asarray(problem.finger_opening)[-1], K)]
