"""Poses of the objects in the states of a motion, from the motion of the arms and the modes of the objects.

The pose of a held object follows from the pose of its gripper, which is computed by MuJoCo's forward kinematics, and
from the mode parameters of the NLP. A standing object keeps its pose.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from dvr_jax.modes import fixed, held, placed
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene


def carry_objects(
    scene: Scene,
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    phase: Int[np.ndarray, " samples"],
    qpos: Float[np.ndarray, "samples states"],
) -> None:
    """Write the poses of the objects into states in which joints and fingers have been written already.

    Args:
        scene: Scene of the motion.
        problem: NLP of the sequence, without batch axes.
        m: Mode parameters of each action [m or rad].
        phase: Number of actions that have taken effect in each state.
        qpos: The states, which are changed in place.
    """
    columns = qpos_layout(scene).objects
    hand_position, hand_rotation = gripper_frames(scene, qpos)

    for k in np.unique(phase):
        samples = phase == k
        for n, indices in enumerate(columns):
            position, rotation = object_pose(
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


def gripper_frames(
    scene: Scene,
    qpos: Float[np.ndarray, "samples states"],
) -> tuple[Float[np.ndarray, "samples arms 3"], Float[np.ndarray, "samples arms 9"]]:
    """Compute the poses of the grippers by MuJoCo's forward kinematics.

    Args:
        scene: Scene of the motion.
        qpos: States of the scene.

    Returns:
        Positions of the gripper centers [m] and row-major rotation matrices, in the world.
    """
    model = build_model(scene)
    data = mujoco.MjData(model)
    sites = [model.site(f"{arm}/gripper").id for arm in scene.workcell.arm_names]

    # MuJoCo reuses the same arrays for every sample, so the attributes are looked up only once.
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


def object_pose(
    problem: Problem,
    m: Float[np.ndarray, "actions parameters"],
    phase: int,
    item: int,
    hand_position: Float[np.ndarray, "samples arms 3"],
    hand_rotation: Float[np.ndarray, "samples arms 9"],
) -> tuple[Float[np.ndarray, "..."], Rotation]:
    """Return the poses of an object at the samples of one phase; a standing object has one pose.

    Args:
        problem: NLP of the sequence, without batch axes.
        m: Mode parameters of each action [m or rad].
        phase: Number of actions that have taken effect.
        item: Index of the object.
        hand_position: Positions of the gripper centers [m].
        hand_rotation: Row-major rotation matrices of the grippers.

    Returns:
        Positions [m] and rotations.
    """
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

    Both signs describe the same rotation, but programs that interpolate between two samples need equal signs.
    """
    for indices in columns:
        flips = np.sum(qpos[1:, indices] * qpos[:-1, indices], axis=1) < 0
        signs = np.where(np.cumsum(flips) % 2, -1.0, 1.0)
        qpos[1:, indices] *= signs[:, None]
