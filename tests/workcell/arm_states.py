"""Random postures of all arms of a workcell, in a scene's MuJoCo model and as the library takes them."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.scene.layout import Layout, qpos_layout
from dvr_jax.scene.mjcf import build_home_data, build_model
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.kinematics import BasePoses
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell, base_positions, base_rotations

Floats = NDArray[np.float64]

POSTURES = 64


def scene_of(workcell: Workcell = DEFAULT_WORKCELL) -> Scene:
    """A scene with one box."""
    item = SceneObject("box", "box", (0.05, 0.1, 0.1), (0.0, 0.3), 0.3)
    return Scene((item,), OnRegion("box", Region((0, 0), 0, (0.2, 0.2))), workcell)


def sample_postures(n: int = POSTURES, seed: int = 0, workcell: Workcell = DEFAULT_WORKCELL) -> tuple[Floats, Floats]:
    """Joint angles (n, A, J) within the limits and finger travels (n, A)."""
    generator = np.random.default_rng(seed)
    lower, upper = workcell.robot.joint_limits
    shape = (n, workcell.number_of_arms)
    return generator.uniform(lower, upper, (*shape, len(lower))), generator.uniform(0, 0.04, shape)


class Simulated:
    """The MuJoCo model of a workcell's scene."""

    def __init__(self, workcell: Workcell = DEFAULT_WORKCELL) -> None:
        self.workcell = workcell
        self.scene = scene_of(workcell)
        self.model: mujoco.MjModel = build_model(self.scene)
        self.layout: Layout = qpos_layout(self.scene)

    def states(self, q: Floats, openings: Floats) -> Iterator[mujoco.MjData]:
        """The model's state in each posture, with kinematics and what Jacobians need."""
        data = build_home_data(self.model)
        for angles, travel in zip(q, openings, strict=True):
            data.qpos[self.layout.arm_joints] = angles
            data.qpos[self.layout.fingers] = travel[:, None]
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            yield data


def as_arms(q: Floats) -> Floats:
    """(n, A, J) to the library's (J, A, n)."""
    return q.transpose(2, 1, 0)


def bases_of(workcell: Workcell, n: int) -> BasePoses:
    """The bases as every one of n slices has them."""
    R, p = base_rotations(workcell), base_positions(workcell)
    return BasePoses(np.repeat(R.transpose(2, 1, 0)[..., None], n, -1), np.repeat(p.T[..., None], n, -1))


def matrices(R: Floats) -> Floats:
    """Columns first (3, 3, ...) to (..., 3, 3)."""
    return np.moveaxis(np.asarray(R), (0, 1), (-1, -2))


def vectors(p: Floats) -> Floats:
    """(3, ...) to (..., 3)."""
    return np.moveaxis(np.asarray(p), 0, -1)
