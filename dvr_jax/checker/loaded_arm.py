"""MuJoCo's inverse dynamics of one arm that holds a rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.scene.types import SceneObject
from dvr_jax.workcell.robot import Robot


@dataclass(frozen=True, slots=True)
class Load:
    """An object in a hand."""

    item: SceneObject
    """The object."""

    position: Float[np.ndarray, " 3"]
    """Its center in the frame of the hand [m]."""

    rotation: Float[np.ndarray, "3 3"]
    """Its rotation in the frame of the hand."""


class LoadedArm:
    """MuJoCo's inverse dynamics of one arm whose base stands upright, with a rigid body in its hand."""

    def __init__(self, robot: Robot, load: Load | None = None) -> None:
        """Compile the model.

        Args:
            robot: The robot.
            load: What the hand holds; None for an empty hand.
        """
        spec = mujoco.MjSpec.from_string(robot.mjcf)
        if load is not None:
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(load.rotation).ravel())
            body = spec.body("hand").add_body(pos=list(load.position), quat=quaternion)
            name, numbers = load.item.kind.mujoco_geom(load.item.size)
            body.add_geom(
                type=getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}"),
                size=numbers,
                density=load.item.density,
            )
        self._model = spec.compile()

        # Contacts, limits, servos and damping are no part of the dynamics of the arm.
        bits = mujoco.mjtDisableBit
        self._model.opt.disableflags |= bits.mjDSBL_CONSTRAINT | bits.mjDSBL_ACTUATION
        self._model.opt.disableflags |= bits.mjDSBL_DAMPER | bits.mjDSBL_SPRING
        self._model.dof_armature[:] = 0.0
        self._data = mujoco.MjData(self._model)
        self._joints = robot.number_of_joints

    def torques(
        self,
        q: Float[np.ndarray, "samples joints"],
        velocity: Float[np.ndarray, "samples joints"],
        acceleration: Float[np.ndarray, "samples joints"],
        fingers: Float[np.ndarray, "samples 2"] | None = None,
    ) -> Float[np.ndarray, "samples joints"]:
        """Compute the torques that a motion takes [N m].

        Args:
            q: Joint angles [rad].
            velocity: Joint velocities [rad/s].
            acceleration: Joint accelerations [rad/s^2].
            fingers: Travels of both fingers, which are taken to be at rest [m]; closed by default.
        """
        data = self._data
        joints = self._joints
        data.qpos[joints:] = 0.0
        found = np.empty(q.shape)
        for sample in range(len(q)):
            data.qpos[:joints] = q[sample]
            data.qvel[:joints] = velocity[sample]
            data.qacc[:joints] = acceleration[sample]
            if fingers is not None:
                data.qpos[joints:] = fingers[sample]
            mujoco.mj_inverse(self._model, data)
            found[sample] = data.qfrc_inverse[:joints]
        return found
