"""Random postures of all arms of a workcell, in a MuJoCo model of the arms alone and as the library takes them."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.workcell.kinematics import BasePoses
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell, base_positions, base_rotations

Floats = NDArray[np.float64]

POSTURES = 64


def build_arms(workcell: Workcell) -> mujoco.MjModel:
    """The robots of a workcell where their bases stand; names begin with the arm's and a slash."""
    spec = mujoco.MjSpec()
    for arm in workcell.arms:
        half = arm.yaw / 2
        frame = spec.worldbody.add_frame(
            pos=[*arm.position, 0.0], quat=[np.cos(half), 0.0, 0.0, np.sin(half)]
        )
        spec.attach(
            mujoco.MjSpec.from_string(workcell.robot.mjcf), prefix=f"{arm.name}/", frame=frame
        )
    return spec.compile()


def sample_postures(
    n: int = POSTURES, seed: int = 0, workcell: Workcell = DEFAULT_WORKCELL
) -> tuple[Floats, Floats]:
    """Joint angles (n, A, J) within the limits and finger travels (n, A)."""
    generator = np.random.default_rng(seed)
    lower, upper = workcell.robot.joint_limits
    shape = (n, workcell.number_of_arms)
    return generator.uniform(lower, upper, (*shape, len(lower))), generator.uniform(0, 0.04, shape)


class Simulated:
    """The MuJoCo model of a workcell's arms."""

    def __init__(self, workcell: Workcell = DEFAULT_WORKCELL) -> None:
        self.workcell = workcell
        self.model: mujoco.MjModel = build_arms(workcell)
        names = [f"joint{i + 1}" for i in range(workcell.robot.number_of_joints)]
        self.arm_joints = self._addresses(names)
        self.fingers = self._addresses([f"finger_joint_{side}" for side in ("left", "right")])

    def _addresses(self, joints: list[str]) -> NDArray[np.int64]:
        """Where joints of each arm lie in `qpos` (A, ...)."""
        arms = self.workcell.arm_names
        return np.array(
            [[self.model.joint(f"{arm}/{name}").qposadr[0] for name in joints] for arm in arms]
        )

    def states(self, q: Floats, openings: Floats) -> Iterator[mujoco.MjData]:
        """The model's state in each posture, with kinematics and what Jacobians need."""
        data = mujoco.MjData(self.model)
        for angles, travel in zip(q, openings, strict=True):
            data.qpos[self.arm_joints] = angles
            data.qpos[self.fingers] = travel[:, None]
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            yield data


def as_arms(q: Floats) -> Floats:
    """(n, A, J) to the library's (J, A, n)."""
    return q.transpose(2, 1, 0)


def bases_of(workcell: Workcell, n: int) -> BasePoses:
    """The bases as every one of n slices has them."""
    R, p = base_rotations(workcell), base_positions(workcell)
    return BasePoses(
        np.repeat(R.transpose(2, 1, 0)[..., None], n, -1), np.repeat(p.T[..., None], n, -1)
    )


def matrices(R: Floats) -> Floats:
    """Columns first (3, 3, ...) to (..., 3, 3)."""
    return np.moveaxis(np.asarray(R), (0, 1), (-1, -2))


def vectors(p: Floats) -> Floats:
    """(3, ...) to (..., 3)."""
    return np.moveaxis(np.asarray(p), 0, -1)
