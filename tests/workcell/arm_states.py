"""Random postures of both arms, in a scene's MuJoCo model and as the library takes them."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.scene.mjcf import build_home_data, qpos_layout
from dvr_jax.workcell.constants import JOINT_LOWER, JOINT_UPPER

Floats = NDArray[np.float64]

POSTURES = 64


def sample_postures(n: int = POSTURES, seed: int = 0) -> tuple[Floats, Floats]:
    """Joint angles (n, 2, 7) within the limits and finger travels (n, 2)."""
    generator = np.random.default_rng(seed)
    return generator.uniform(JOINT_LOWER, JOINT_UPPER, (n, 2, 7)), generator.uniform(0, 0.04, (n, 2))


def set_postures(model: mujoco.MjModel, q: Floats, openings: Floats) -> Iterator[mujoco.MjData]:
    """The model's state in each posture, with kinematics and what Jacobians need."""
    layout, data = qpos_layout((model.nq - 18) // 7), build_home_data(model)
    for angles, travel in zip(q, openings, strict=True):
        data.qpos[layout.arm_joints] = angles
        data.qpos[layout.fingers] = travel[:, None]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield data


def as_arms(q: Floats) -> Floats:
    """(n, 2, 7) to the library's (7, 2, n)."""
    return q.transpose(2, 1, 0)


def matrices(R: tuple[tuple[Floats, ...], ...]) -> Floats:
    """Columns of components to (..., 3, 3)."""
    return np.stack([np.stack([np.asarray(x) for x in column], axis=-1) for column in R], axis=-1)


def vectors(p: tuple[Floats, ...]) -> Floats:
    """Components to (..., 3)."""
    return np.stack([np.asarray(x) for x in p], axis=-1)
