"""From the slices of a solved path to a motion of the whole scene at ten times their rate.

Joints run through the slices as monotone cubics, which keep an arm that rests between two slices at rest, so fingers
open and close in that interval. Held objects are carried rigidly by the mode transforms of the NLP, placed with
MuJoCo's own kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dvr_jax.check.motion import Motion, make_motion
from dvr_jax.komo.between import SAMPLES_PER_SLICE, joint_curve
from dvr_jax.komo.problem import HELD_LEFT, PLACED, Problem
from dvr_jax.scene.mjcf import build_model, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.scene.workspace import ARM_NAMES, JOINT_VELOCITY

SHORTEST_SLICE = 0.1
"""Shortest duration of a slice [s]; longer where a joint would exceed its velocity limit."""

VELOCITY_SHARE = 0.9
"""Share of Franka's joint velocity limits that a motion may use."""

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
    joints = joint_curve(problem.home, q)(sampled)
    fastest = (np.abs(np.diff(joints, axis=0)) * R / np.tile(JOINT_VELOCITY, 2)).max()
    duration = max(SHORTEST_SLICE, float(fastest) / VELOCITY_SHARE)

    phase = np.minimum((sampled / S).astype(int), K - 1)
    phase_after = np.where(np.arange(T * R + 1) == T * R, K, phase)
    layout = qpos_layout(len(scene.objects))
    qpos = np.zeros((len(sampled), layout.size))
    qpos[:, layout.arm_joints.reshape(-1)] = joints
    # Fingers move while the arm rests: in the last interval before its switch.
    share = np.clip(sampled - ((phase + 1) * S - 1), 0, 1)[:, None]
    opening = (1 - share) * problem.opening[phase] + share * problem.opening[phase + 1]
    qpos[:, layout.fingers.reshape(-1)] = np.repeat(opening, 2, axis=1)
    _carry_objects(scene, problem, m, phase_after, qpos)
    return make_motion(sampled * duration, qpos, (np.arange(K) + 1) * S * R)


def _carry_objects(scene: Scene, problem: Problem, m: Floats, phase: NDArray[np.int64], qpos: Floats) -> None:
    """Write the objects' poses into ``qpos``, whose joints are complete."""
    model = build_model(scene)
    data = mujoco.MjData(model)
    sites = [model.site(f"{arm}/gripper").id for arm in ARM_NAMES]
    hand_p, hand_R = np.zeros((len(qpos), 2, 3)), np.zeros((len(qpos), 2, 9))
    for sample, values in enumerate(qpos):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        hand_p[sample], hand_R[sample] = data.site_xpos[sites], data.site_xmat[sites]
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


def grasp_transform(face_yaw: float, m: Floats) -> tuple[Floats, Floats]:
    """Gripper in the object's frame, rotation (3, 3) and centre (3,), as `dvr_jax.komo.modes.grasp_frame`."""
    c, s = np.cos(face_yaw + m[3]), np.sin(face_yaw + m[3])
    n, u, up = np.array([c, s, 0.0]), np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])
    approach = np.sin(m[2]) * u - np.cos(m[2]) * up
    return np.stack([np.cross(n, approach), n, approach], axis=1), m[0] * u + m[1] * up
