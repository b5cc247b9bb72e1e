"""The state of a scene's MuJoCo model: where each quantity lies in `qpos`, and the initial state.

Order of `qpos`: arm after arm its joints and then its two fingers, then 7 numbers for each object: the position of its
center in the world and a unit quaternion w x y z. Fixed bodies have no state.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import FINGERS


@dataclass(frozen=True, slots=True)
class Layout:
    """Where each quantity lies in `qpos`; the same for all scenes with as many arms, joints and objects."""

    arm_joints: Int[np.ndarray, "arms joints"]
    """Indices of the revolute joints."""

    fingers: Int[np.ndarray, "arms 2"]
    """Indices of the finger joints: travel of finger_left and finger_right [m]."""

    objects: Int[np.ndarray, "objects 7"]
    """Indices of the objects' free joints: position x y z [m], then quaternion w x y z."""

    @property
    def size(self) -> int:
        """Length nq of `qpos`."""
        return int(self.arm_joints.size + self.fingers.size + self.objects.size)


def qpos_layout(scene: Scene) -> Layout:
    """Layout of the state of a scene's model."""
    arms = scene.workcell.number_of_arms
    joints = scene.workcell.robot.number_of_joints
    stride = joints + len(FINGERS)
    starts = np.arange(arms)[:, None] * stride
    number_of_objects = len(scene.objects)

    return Layout(
        arm_joints=starts + np.arange(joints),
        fingers=starts + joints + np.arange(len(FINGERS)),
        objects=arms * stride + np.arange(7 * number_of_objects).reshape(number_of_objects, 7),
    )


def home_qpos(scene: Scene, finger_travel: float | None = None) -> Float[np.ndarray, " nq"]:
    """Initial state of a scene: arms at home, objects upright where they stand.

    Args:
        scene: The scene.
        finger_travel: Travel of all fingers from closed [m]; None opens the grippers fully.

    Returns:
        The state in the layout of `qpos_layout`.
    """
    layout = qpos_layout(scene)
    qpos = np.zeros(layout.size)
    qpos[layout.arm_joints] = scene.home
    qpos[layout.fingers] = (
        scene.workcell.robot.finger_travel if finger_travel is None else finger_travel
    )

    for indices, item in zip(layout.objects, scene.objects, strict=True):
        qpos[indices] = [*scene.center_of(item), *yaw_quaternion(item.yaw)]

    return qpos


def yaw_quaternion(yaw: float) -> list[float]:
    """Unit quaternion w x y z of a turn about the world's z axis [rad]."""
    return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]
