"""Turn a solved path into a motion of the whole scene: fast, within the limits of the arms, sampled evenly in time.

Notation: a path of K actions has T slices and S = T / K slices in each phase. It begins at home.

- In each phase the arms move along a smooth curve (`dvr_jax.motion.joint_curve`) from rest to rest, as fast as the
  limits of joint velocity, acceleration, jerk and torque allow (`dvr_jax.motion.retiming`). The torques include the
  weight of the objects that are held.
- Then all arms rest while the fingers move. In a handover the fingers of the taking arm close first, and those of the
  giving arm open afterwards. The object changes its holder between the two, or else when the fingers have moved.
- At the end the hand that has released the last object retreats (`dvr_jax.planning.retreat`).
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
from dvr_jax.planning.carried_objects import carry_objects, gripper_frames
from dvr_jax.planning.retreat import RETREAT_STEPS, retreat
from dvr_jax.scene.layout import home_qpos, qpos_layout
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

NEAR_SPEED = 0.25
"""Largest speed of a hand near its pose at a switch in which it takes part [m/s]. Servos follow a slow hand closely,
where fingers pass an object at a distance of millimeters."""

NEAR_DISTANCE = 0.02
"""Distance up to which a hand is near [m]."""

NEAR_ACCELERATION = 3.0
"""Beyond this distance, the bound of the speed is that of a hand that comes there at this deceleration [m/s^2]."""

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
    q = _at_rest(problem, q)
    curve = joint_curve(home, q, straight_intervals(problem, len(q)))
    limits = _limits(scene.workcell.robot, scene.workcell.number_of_arms)

    parts = [_Part(home[None], opening[:1], np.zeros(1, int))]
    for k in range(K):
        # The last interval of a phase is a pause, which has its own duration.
        points = curve(np.linspace(k * S, (k + 1) * S - 1, CURVE_POINTS * (S - 1) + 1))
        times = _shortest_times(scene, problem, points, k)
        moving = time_optimal(points, _limits_of(limits, problem, k), _torques(scene, problem, k), times)[1:]
        parts.append(_moving_part(moving, opening[k], k))
        parts.append(_pause(scene.workcell.robot, q[(k + 1) * S - 1], opening[k : k + 2], k))

    parts += _retreat_part(scene, problem, q, m, limits)
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


def _shortest_times(
    scene: Scene, problem: Problem, points: Float[np.ndarray, "points joints"], phase: int
) -> Float[np.ndarray, " points-1"]:
    """Return the shortest time between points of a phase [s], so that hands are slow near what they grasp or release.

    Args:
        scene: Scene of the path.
        problem: NLP of the path.
        points: Joint angles along the phase [rad], `CURVE_POINTS` of them in each interval between two slices.
        phase: Number of the phase.
    """
    # The first interval leaves the last switch, and the last one comes to the next switch.
    arms = np.asarray(problem.arm_at_rest)
    leaving = arms[phase - 1] if phase else np.zeros_like(arms[0])
    times = np.zeros(len(points) - 1)
    for first, switch, own in (
        (0, 0, leaving),
        (len(times) - CURVE_POINTS, CURVE_POINTS, arms[phase]),
    ):
        if not own.any():
            continue
        hands = _hand_positions(scene, points[first : first + CURVE_POINTS + 1])[:, own > 0]
        travel = np.linalg.norm(np.diff(hands, axis=0), axis=2)
        distance = np.linalg.norm((hands[1:] + hands[:-1]) / 2 - hands[switch], axis=2)
        speed = near_speed(distance)
        holding = _holding(problem, phase, len(own))[own > 0]
        speed[:, holding] = near_speed_h(distance)[:, holding]
        times[first : first + CURVE_POINTS] = (travel / speed).max(axis=1)
    return times


def near_speed(distance: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the largest speed of a hand at some distances from its pose at a switch in which it takes part [m/s]."""
    beyond = np.maximum(distance - NEAR_DISTANCE, 0.0)
    return np.sqrt(NEAR_SPEED**2 + 2 * NEAR_ACCELERATION * beyond)


HELD_FRACTION = 1.0
HOLD = (0.25, 1.0, 3.0)


def near_speed_h(distance):
    return np.sqrt(HOLD[0] ** 2 + 2 * HOLD[2] * np.maximum(distance - HOLD[1], 0.0))


def _holding(problem, phase, arms):
    h = np.zeros(arms, bool)
    for kind, parent in zip(problem.mode_kind[phase], problem.mode_parent[phase]):
        if int(kind) == ModeKind.HELD:
            h[int(parent)] = True
    return h


def _limits_of(limits, problem, phase):
    from dataclasses import replace
    h = _holding(problem, phase, problem.still_arm.shape[-1])
    f = np.repeat(np.where(h, HELD_FRACTION, 1.0), len(limits.acceleration) // len(h))
    return replace(limits, acceleration=limits.acceleration * f)


def _hand_positions(
    scene: Scene, points: Float[np.ndarray, "points joints"]
) -> Float[np.ndarray, "points arms 3"]:
    """Return the gripper centers of all arms at some joint angles [m]."""
    layout = qpos_layout(scene)
    qpos = np.tile(home_qpos(scene), (len(points), 1))
    qpos[:, layout.arm_joints.reshape(-1)] = points
    return gripper_frames(scene, qpos)[0]


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
    limits: MotionLimits,
) -> list[_Part]:
    """Return the samples of the retreat after the last action, if there is one."""
    K = len(m)
    distance = scene.workcell.clearances.approach
    away = retreat(workcell_model(scene.workcell), problem, q, m, distance)
    if len(away) < 2:
        return []
    points = np.concatenate([q[-1:], away])
    step = distance / RETREAT_STEPS
    times = step / near_speed(step * (np.arange(len(away)) + 0.5))
    moving = time_optimal(points, limits, _torques(scene, problem, K), times)[1:]
    return [_moving_part(moving, np.asarray(problem.finger_opening)[-1], K)]
