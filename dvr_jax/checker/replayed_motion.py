"""A motion after its replay: world poses of all objects and grippers at every sample, as MuJoCo computes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import Layout, qpos_layout
from dvr_jax.scene.types import Scene


def state_layout(scene: Scene) -> Layout:
    """Return where each quantity lies in the states of a scene's motion."""
    return qpos_layout(scene)


@dataclass(frozen=True, slots=True)
class ReplayedMotion:
    """A scene, its motion, and the poses that follow from it."""

    scene: Scene
    """The scene that the motion starts in."""

    motion: Motion
    """The motion."""

    object_positions: Float[np.ndarray, "samples objects 3"]
    """Centers of the objects in the world [m]."""

    object_rotations: Float[np.ndarray, "samples objects 3 3"]
    """Rotations of the objects in the world."""

    gripper_positions: Float[np.ndarray, "samples arms 3"]
    """Gripper centers in the world [m]."""

    gripper_rotations: Float[np.ndarray, "samples arms 3 3"]
    """Rotations of the grippers in the world: the closing axis is y, the approach is z."""

    @property
    def last_sample(self) -> int:
        """Number of the last sample."""
        return len(self.motion.time) - 1

    def object_label(self, index: int) -> str:
        """Return the name of an object in findings, as in "object/yellow"."""
        return f"object/{self.scene.objects[index].name}"

    def arm_name(self, arm: int) -> str:
        """Return the name of an arm."""
        return self.scene.workcell.arm_names[arm]

    def joint_angles(self, arm: int) -> Float[np.ndarray, "samples joints"]:
        """Return the joint angles of an arm [rad]."""
        return self.motion.qpos[:, state_layout(self.scene).arm_joints[arm]]

    def finger_travels(self, arm: int) -> Float[np.ndarray, "samples 2"]:
        """Return the travels of both fingers of an arm, from closed [m]."""
        return self.motion.qpos[:, state_layout(self.scene).fingers[arm]]

    def object_in_gripper(
        self, index: int, arm: int
    ) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3 3"]]:
        """Compute the poses of an object as its gripper sees them.

        Args:
            index: Number of the object.
            arm: Number of the arm.

        Returns:
            Positions [m] and rotations of the object in the gripper's frame.
        """
        to_gripper = self.gripper_rotations[:, arm].transpose(0, 2, 1)
        offset = self.object_positions[:, index] - self.gripper_positions[:, arm]
        positions = np.einsum("tij,tj->ti", to_gripper, offset)
        return positions, to_gripper @ self.object_rotations[:, index]


def angle_between(
    first: Float[np.ndarray, "*batch 3 3"], second: Float[np.ndarray, "*batch 3 3"]
) -> Float[np.ndarray, "*batch"]:
    """Compute the angle between rotations.

    With the Frobenius norm, ``|R - Q| = sqrt(8) sin(angle / 2)``. For small angles this is exact where the usual arc
    cosine of the trace loses half of the digits.

    Args:
        first: Rotation matrices.
        second: Rotation matrices that broadcast against the first ones.

    Returns:
        The angles in [0, pi] [rad].
    """
    distance = np.linalg.norm(first - second, axis=(-2, -1))
    return np.asarray(2 * np.arcsin(np.clip(distance / np.sqrt(8.0), 0.0, 1.0)))
