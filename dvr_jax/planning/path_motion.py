"""From the slices of a solved path to a motion of the whole scene at ten times their rate.

Notation: a path has T slices for K actions, S = T / K slices an action; each interval between slices gets R samples.

- Joints run through the slices as monotone cubics (F. Fritsch and J. Butland, "A method for constructing local monotone
  piecewise cubic interpolants", 1984), which keep an arm at rest that rests between two slices.
- Fingers move in the interval before a switch. At a handover the fingers that take close in the first half of this
  interval, and the fingers that give open in its second half.
- One slice lasts as long as the limits of joint speed, joint acceleration and finger speed ask for. With positions
  q_i at the rate R a slice, a slice of h seconds has the speeds (q_{i+1} - q_i) R / h and the accelerations
  (q_{i+1} - 2 q_i + q_{i-1}) R^2 / h^2.
- Held objects are carried rigidly by the mode transforms of the NLP, placed with MuJoCo's own kinematics.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from dvr_jax.modes import fixed, held, placed
from dvr_jax.modes.mode import ModeKind
from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.nlp.problem import Problem
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene
from dvr_jax.solver.continuous_collision import SAMPLES_PER_SLICE
from dvr_jax.workcell.robot import Robot

SHORTEST_SLICE = 0.1
"""Shortest duration of a slice [s]."""

LIMIT_FRACTION = 0.9
"""Fraction of the limits of joint speed, joint acceleration and finger speed that a motion may use."""


def interpolate(
    scene: Scene,
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    m: Float[np.ndarray, "actions parameters"],
) -> Motion:
    """Return the motion of a solved path.

    Args:
        scene: Scene of the path.
        problem: NLP of the path's sequence, without batch axes.
        q: (T, joints) joint angles of all arms in the slices [rad].
        m: (K, 4) mode parameters.

    Returns:
        The motion of the whole scene, with T * 10 + 1 samples.
    """
    T = q.shape[0]
    K = m.shape[0]
    S = T // K
    R = SAMPLES_PER_SLICE

    # Slice number and phase of each sample. From the switch on, an object moves as after the action.
    sampled = np.arange(T * R + 1) / R
    phase = np.minimum((sampled / S).astype(int), K - 1)
    phase_after = np.where(np.arange(T * R + 1) == T * R, K, phase)

    # Joints and fingers determine the state of the arms; the objects follow from them.
    joints = joint_curve(np.asarray(problem.home), q)(sampled)
    slices_after_rest = sampled - ((phase + 1) * S - 1)
    fingers = _finger_travels(problem, slices_after_rest, phase)

    layout = qpos_layout(scene)
    qpos = np.zeros((len(sampled), layout.size))
    qpos[:, layout.arm_joints.reshape(-1)] = joints
    qpos[:, layout.fingers.reshape(-1)] = np.repeat(fingers, 2, axis=1)
    _carry_objects(scene, problem, m, phase_after, qpos)

    time = sampled * _slice_duration(scene.workcell.robot, joints, fingers)
    switch = (np.arange(K) + 1) * S * R
    return make_motion(time, qpos, switch)


def _finger_travels(
    problem: Problem,
    fraction: Float[np.ndarray, " samples"],
    phase: Int[np.ndarray, " samples"],
) -> Float[np.ndarray, "samples arms"]:
    """Return the travel of each arm's fingers [m].

    Args:
        problem: NLP of the sequence.
        fraction: Fraction of the interval before the phase's switch that has passed; negative before the interval.
        phase: Phase of each sample.

    Returns:
        Distance of each finger from its hand's middle plane [m].
    """
    opening = np.asarray(problem.finger_opening)
    before = opening[phase]
    after = opening[phase + 1]

    # Where both hands move, the closing one has the first half of the interval and the opening one the second.
    is_moving = before != after
    both_move = is_moving.sum(axis=1, keepdims=True) > 1
    half = np.where(after < before, 2 * fraction[:, None], 2 * fraction[:, None] - 1)
    moved = np.clip(np.where(both_move, half, fraction[:, None]), 0, 1)

    return (1 - moved) * before + moved * after


def _slice_duration(
    robot: Robot,
    joints: Float[np.ndarray, "samples joints"],
    fingers: Float[np.ndarray, "samples arms"],
) -> float:
    """Return the shortest duration of a slice that keeps all limits [s].

    Args:
        robot: Robot that all arms are.
        joints: Joint angles of all arms at the motion's rate [rad].
        fingers: Travel of each arm's fingers [m].

    Returns:
        Duration of a slice [s].
    """
    arms = fingers.shape[1]
    joint_velocity = np.tile(robot.joint_velocity, arms)
    joint_acceleration = np.tile(robot.joint_acceleration, arms)

    # First and second differences in units of a slice. The motion starts and ends at rest.
    velocity = np.diff(joints, axis=0) * SAMPLES_PER_SLICE
    change = np.diff(velocity, axis=0, prepend=0.0, append=0.0) * SAMPLES_PER_SLICE

    by_velocity = np.abs(velocity / joint_velocity).max() / LIMIT_FRACTION
    by_acceleration = np.abs(change / joint_acceleration).max() / LIMIT_FRACTION
    finger_velocity = np.abs(np.diff(fingers, axis=0)).max() * SAMPLES_PER_SLICE
    by_fingers = finger_velocity / robot.finger_speed / LIMIT_FRACTION

    return max(
        SHORTEST_SLICE, float(by_velocity), math.sqrt(float(by_acceleration)), float(by_fingers)
    )


def _carry_objects(
    scene: Scene,
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    phase: Int[np.ndarray, " samples"],
    qpos: Float[np.ndarray, "samples states"],
) -> None:
    """Write the poses of the objects into `qpos`, whose joints are complete."""
    columns = qpos_layout(scene).objects
    hand_position, hand_rotation = _gripper_frames(scene, qpos)

    for k in np.unique(phase):
        samples = phase == k
        for n, indices in enumerate(columns):
            position, rotation = _object_pose(
                problem,
                m,
                int(k),
                n,
                hand_position[samples],
                hand_rotation[samples],
            )
            qpos[np.ix_(samples, indices[:3])] = position
            qpos[np.ix_(samples, indices[3:])] = rotation.as_quat(scalar_first=True)

    _align_quaternion_signs(qpos, columns[:, 3:])


def _gripper_frames(
    scene: Scene,
    qpos: Float[np.ndarray, "samples states"],
) -> tuple[Float[np.ndarray, "samples arms 3"], Float[np.ndarray, "samples arms 9"]]:
    """Return positions [m] and row-major rotation matrices of the arms' gripper centers in the world."""
    model = build_model(scene)
    data = mujoco.MjData(model)
    sites = [model.site(f"{arm}/gripper").id for arm in scene.workcell.arm_names]

    # The views are taken once, because MuJoCo's arrays stay where they are from one sample to the next.
    state = data.qpos
    site_positions = data.site_xpos
    site_rotations = data.site_xmat

    positions = np.empty((len(qpos), *site_positions.shape))
    rotations = np.empty((len(qpos), *site_rotations.shape))
    for sample, values in enumerate(qpos):
        state[:] = values
        mujoco.mj_kinematics(model, data)
        positions[sample] = site_positions
        rotations[sample] = site_rotations

    return positions[:, sites], rotations[:, sites]


def _object_pose(
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    phase: int,
    item: int,
    hand_position: Float[np.ndarray, "samples arms 3"],
    hand_rotation: Float[np.ndarray, "samples arms 9"],
) -> tuple[Float[np.ndarray, "..."], Rotation]:
    """Return position [m] and rotation of an object in the samples of one phase, one for all where it stands."""
    kind = int(problem.mode_kind[phase, item])
    action = int(problem.mode_action[phase, item])
    if kind == ModeKind.HELD:
        arm = int(problem.mode_parent[phase, item])
        R_world_hand = hand_rotation[:, arm].reshape(-1, 3, 3)
        rotation, position = held.pose_on_host(
            m[action],
            float(problem.closing_yaw[action]),
            R_world_hand,
            hand_position[:, arm],
        )
    elif kind == ModeKind.PLACED:
        half_height = float(np.asarray(problem.prism)[item, 2])
        rotation, position = placed.pose_on_host(m[action], half_height)
    else:
        rotation, position = fixed.pose_on_host(np.asarray(problem.initial_pose)[item])
    return position, rotation


def _align_quaternion_signs(
    qpos: Float[np.ndarray, "samples states"],
    columns: Int[np.ndarray, "objects 4"],
) -> None:
    """Give neighboring quaternions of each object the same sign, in place.

    Both signs are the same rotation, but a reader may take the mean of two neighboring samples.
    """
    for indices in columns:
        flips = np.sum(qpos[1:, indices] * qpos[:-1, indices], axis=1) < 0
        signs = np.where(np.cumsum(flips) % 2, -1.0, 1.0)
        qpos[1:, indices] *= signs[:, None]
