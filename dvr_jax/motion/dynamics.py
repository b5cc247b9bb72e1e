"""Inverse dynamics of an arm with a load in its gripper, by MuJoCo's recursive Newton-Euler algorithm.

The load is a point mass at the gripper center. Friction in the joints and the inertia of the drives are not included.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.workcell.robot import Robot

LOAD = "load"
"""Name of the body that is added to the hand for what the gripper holds."""


class ArmDynamics:
    """Torques of one arm whose base stands upright."""

    def __init__(self, robot: Robot) -> None:
        """Compile a model of the arm with a body for the load.

        Args:
            robot: The robot.
        """
        spec = mujoco.MjSpec.from_string(robot.mjcf)
        hand = spec.body("hand")
        center = spec.site("gripper").pos
        load = hand.add_body(name=LOAD, pos=center)
        load.mass = 1.0
        load.inertia = [1.0, 1.0, 1.0]
        load.explicitinertial = True
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._joints = robot.number_of_joints
        self._load = self._model.body(LOAD).id
        self._result = np.zeros(self._model.nv)

    def torques(
        self,
        q: Float[np.ndarray, "samples joints"],
        velocity: Float[np.ndarray, "samples joints"],
        acceleration: Float[np.ndarray, "samples joints"],
        mass: float,
    ) -> Float[np.ndarray, "samples joints"]:
        """Compute the torques that a motion takes [N m].

        Args:
            q: Joint angles [rad].
            velocity: Joint velocities [rad/s].
            acceleration: Joint accelerations [rad/s^2].
            mass: Mass of the load, as a point at the gripper center [kg].
        """
        model = self._model
        data = self._data
        joints = self._joints
        model.body_mass[self._load] = mass
        model.body_inertia[self._load] = 0.0

        found = np.empty(q.shape)
        positions = data.qpos
        velocities = data.qvel
        accelerations = data.qacc
        for sample in range(len(q)):
            positions[:joints] = q[sample]
            velocities[:joints] = velocity[sample]
            accelerations[:joints] = acceleration[sample]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, self._result)
            found[sample] = self._result[:joints]
        return found


@lru_cache(maxsize=8)
def arm_dynamics(robot: Robot) -> ArmDynamics:
    """Return the dynamics of an arm, which are kept."""
    return ArmDynamics(robot)
