"""From the slices of a solved path to a motion of the whole scene at ten times their rate.

Joints run through the slices as monotone cubics, which keep an arm that rests between two slices at rest. In that
interval before a switch fingers move: at a handover those that take close in its first half, those that give open in
the second. A slice lasts as long as Franka's limits of joint speed, joint acceleration and finger speed ask for. Held
objects are carried rigidly by the mode transforms of the NLP, placed with MuJoCo's own kinematics."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.nlp.problem import HELD_LEFT, PLACED, Problem
from dvr_jax.scene.mjcf import build_model, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.solver.continuous_collision import SAMPLES_PER_SLICE, joint_curve
from dvr_jax.workcell.constants import ARM_NAMES, FINGER_SPEED, JOINT_ACCELERATION, JOINT_VELOCITY

SHORTEST_SLICE = 0.1
"""Shortest duration of a slice [s]."""

LIMIT_SHARE = 0.9
"""Share of Franka's limits of joint speed and acceleration, and of finger speed, that a motion may use."""

Floats = NDArray[np.float64]


def interpolate(scene: Scene, problem: Problem, q: Floats, m: Floats) -> Motion:
    """Motion of a solved path.

    Args:
        problem: of the path's sequence (no batch axes).
        q: (T, 14) joint angles [rad].
        m: (K, 4) mode parameters.
    """
    T, K = q.shape[0], m.shape[0]
    S, R = T // K, SAMPLES_PER_SLICE
    sampled = np.arange(T * R + 1) / R
    phase = np.minimum((sampled / S).astype(int), K - 1)
    phase_after = np.where(np.arange(T * R + 1) == T * R, K, phase)
    layout = qpos_layout(len(scene.objects))
    qpos = np.zeros((len(sampled), layout.size))
    joints = joint_curve(problem.home, q)(sampled)
    qpos[:, layout.arm_joints.reshape(-1)] = joints
    fingers = _finger_travels(problem, sampled - ((phase + 1) * S - 1), phase)
    qpos[:, layout.fingers.reshape(-1)] = np.repeat(fingers, 2, axis=1)
    _carry_objects(scene, problem, m, phase_after, qpos)
    return make_motion(sampled * _slice_duration(joints, fingers), qpos, (np.arange(K) + 1) * S * R)


def _finger_travels(problem: Problem, share: Floats, phase: NDArray[np.int64]) -> Floats:
    """Travel of both arms' fingers (L, 2) [m] in samples of these phases (L,), at this share (L,) of the interval
    before their switch, negative earlier."""
    before, after = problem.opening[phase], problem.opening[phase + 1]
    both = (before != after).all(axis=1, keepdims=True)
    half = np.where(after < before, 2 * share[:, None], 2 * share[:, None] - 1)
    moved = np.clip(np.where(both, half, share[:, None]), 0, 1)
    return (1 - moved) * before + moved * after


def _slice_duration(joints: Floats, fingers: Floats) -> float:
    """Duration of a slice [s] within all limits, of angles (L, 14) and travels (L, 2) at the motion's rate."""
    steps = np.diff(joints, axis=0) * SAMPLES_PER_SLICE
    changes = np.diff(steps, axis=0, prepend=0.0, append=0.0) * SAMPLES_PER_SLICE
    speed = np.abs(steps / np.tile(JOINT_VELOCITY, 2)).max() / LIMIT_SHARE
    acceleration = np.abs(changes / np.tile(JOINT_ACCELERATION, 2)).max() / LIMIT_SHARE
    closing = np.abs(np.diff(fingers, axis=0)).max() * SAMPLES_PER_SLICE / FINGER_SPEED / LIMIT_SHARE
    return max(SHORTEST_SLICE, float(speed), math.sqrt(float(acceleration)), float(closing))


def _carry_objects(scene: Scene, problem: Problem, m: Floats, phase: NDArray[np.int64], qpos: Floats) -> None:
    """Write the objects' poses into ``qpos``, whose joints are complete."""
    model = build_model(scene)
    data = mujoco.MjData(model)
    sites = [model.site(f"{arm}/gripper").id for arm in ARM_NAMES]
    # The arrays stay where they are from one sample to the next.
    state, positions, rotations = data.qpos, data.site_xpos, data.site_xmat
    all_p, all_R = np.empty((len(qpos), *positions.shape)), np.empty((len(qpos), *rotations.shape))
    for sample, values in enumerate(qpos):
        state[:] = values
        mujoco.mj_kinematics(model, data)
        all_p[sample], all_R[sample] = positions, rotations
    hand_p, hand_R = all_p[:, sites], all_R[:, sites]
    for k in np.unique(phase):
        samples = phase == k
        for n, columns in enumerate(qpos_layout(len(scene.objects)).objects):
            kind, action = int(problem.attachment[k, n]), int(problem.attached_by[k, n])
            if kind >= HELD_LEFT:
                R_object_hand, p_object_hand = grasp_transform(float(problem.face_yaw[action]), m[action])
                R = hand_R[samples, kind - HELD_LEFT].reshape(-1, 3, 3) @ R_object_hand.T
                p, rotation = hand_p[samples, kind - HELD_LEFT] - R @ p_object_hand, Rotation.from_matrix(R)
            elif kind == PLACED:
                p, rotation = np.array([*m[action, :2], problem.half[n, 2]]), Rotation.from_euler("z", m[action, 2])
            else:
                p, rotation = problem.initial_pose[n, :3], Rotation.from_euler("z", problem.initial_pose[n, 3])
            qpos[np.ix_(samples, columns[:3])] = p
            qpos[np.ix_(samples, columns[3:])] = rotation.as_quat(scalar_first=True)
    # Both signs are the same rotation; between samples that are alike a reader may take a mean.
    for columns in qpos_layout(len(scene.objects)).objects[:, 3:]:
        flips = np.sum(qpos[1:, columns] * qpos[:-1, columns], axis=1) < 0
        qpos[1:, columns] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]


def grasp_transform(face_yaw: float, m: Floats) -> tuple[Floats, Floats]:
    """Gripper in the object's frame, rotation (3, 3) and centre (3,), as `dvr_jax.modes.poses.grasp_frame`."""
    c, s = np.cos(face_yaw + m[3]), np.sin(face_yaw + m[3])
    n, u, up = np.array([c, s, 0.0]), np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])
    approach = np.sin(m[2]) * u - np.cos(m[2]) * up
    return np.stack([np.cross(n, approach), n, approach], axis=1), m[0] * u + m[1] * up
