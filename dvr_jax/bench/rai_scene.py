"""Our scenes as scenes of `robotic` (rai): its Panda model with our collision capsules, the table and the objects.

Its own Panda model gives the kinematics. Our collision capsules sit on its links, so that both solvers see the same
arms. Boxes have edges rounded by `ROUNDING`, and fingers stay open while they hold.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import tempfile
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.workcell.robot import Robot
from dvr_jax.workcell.workcell import Arm, base_rotation

Floats = NDArray[np.float64]

ROUNDING = 0.005
"""Radius of the objects' edges [m].

The deepest penetration that `robotic` sees is the sum of both shapes' radii, and a rounded edge lies 0.4 radii inside
the sharp one. Of 73 keyframe problems that we find feasible it finds 60, 61 and 63 with 5, 10 and 15 mm; of these
solutions 50, 49 and 48 are within our tolerances.
"""

LARGEST_ROUNDING = 0.45
"""Largest radius of an object's edges as a fraction of its smallest extent."""

TABLE_ROUNDING = 0.015
"""Radius of the table's edges [m], which nothing reaches."""

CLEARANCE = 5e-4
"""The table's collision body lies so much below its top [m], so that what stands on it does not count as a contact."""

TABLE_BODY = 0.2
"""Thickness of that body [m]."""

SUPPORT_THICKNESS = 0.02
"""Thickness of the rectangles that objects are placed on [m]."""

_LEVELS = (1, -1, -2, -3, -4, -2, -3, -1)
"""Of each link of the Panda: -n if its capsules do not meet those of the n links before it; the base meets all others.

This leaves the pairs of `Robot.self_collision_pairs`, and those of the hand with the elbow, which are far apart in all
but tightly folded arms.
"""


@cache
def load_robotic() -> Any:
    """Import the module `robotic`.

    Raises:
        DvrError: It is missing; the message says how to get it.
    """
    try:
        # It opens a log file in the current folder as it is imported.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            return importlib.import_module("robotic")
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())
        raise DvrError(
            f"this benchmark needs the package `robotic` ({reason}): pip install '.[peers]' in the repository, "
            "and on Debian apt-get install liblapack3."
        ) from None


@dataclass(frozen=True, slots=True)
class PeerScene:
    """A scene in `robotic`."""

    scene: Scene
    """Our scene."""
    config: Any
    """Its `Config`."""
    joints: tuple[tuple[str, ...], ...]
    """Names of each arm's joints."""


def object_frame(n: int) -> str:
    """Name the n-th object's frame."""
    return f"object{n}"


def gripper_frame(arm: int) -> str:
    """Name an arm's gripper frame, whose axes and origin are those of our own model."""
    return f"arm{arm}_gripper"


def build_peer_scene(scene: Scene) -> PeerScene:
    """Load the robots, and put the scene's table, objects and home posture beside them.

    Raises:
        DvrError: An object is not a box, or `robotic` is missing.
    """
    if any(item.shape != "box" for item in scene.objects):
        raise DvrError("scenes with cylinders are not translated to `robotic`; valid are boxes.")

    ry = load_robotic()
    config = ry.Config()
    half_x, half_y = scene.workcell.table.half_extents
    table_size = (2 * half_x, 2 * half_y)
    table = config.addFrame("table")
    table.setPosition([0.0, 0.0, -CLEARANCE - TABLE_BODY / 2])
    table.setShape(ry.ST.ssBox, [*table_size, TABLE_BODY, TABLE_ROUNDING]).setContact(1)

    robot = scene.workcell.robot
    joints = tuple(
        _add_arm(ry, config, robot, index, arm) for index, arm in enumerate(scene.workcell.arms)
    )

    region = scene.paper_goal.region
    _add_support(ry, config, "support_table", (0.0, 0.0, 0.0), table_size)
    _add_support(ry, config, "support_goal", (*region.position, region.yaw), region.size)
    for n, item in enumerate(scene.objects):
        _add_object(ry, config, n, item)

    config.setJointState(np.array(scene.home, dtype=float).reshape(-1))
    return PeerScene(scene, config, joints)


def quaternion_of(R: Floats) -> Floats:
    """Turn a rotation matrix (3, 3) into a quaternion w x y z."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).reshape(-1))
    return quaternion


def rotation_of(quaternion: Floats) -> Floats:
    """Turn a quaternion w x y z of any length into a rotation matrix (3, 3)."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.asarray(quaternion, float) / np.linalg.norm(quaternion))
    return R.reshape(3, 3)


def _yaw_quaternion(yaw: float) -> list[float]:
    return [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]


def _add_arm(ry: Any, config: Any, robot: Robot, index: int, arm: Arm) -> tuple[str, ...]:
    """Add a Panda with our capsules, and give the names of its joints."""
    prefix = f"arm{index}_"
    config.addFile(ry.raiPath("panda/panda_arm_hand_conv.yml"), prefix)
    frames = [frame for frame in config.getFrames() if frame.name.startswith(prefix)]
    for frame in reversed(frames):
        # Our capsules stand for the fingers. A mesh is a look only, but one that every slice would copy.
        if "finger" in frame.name:
            config.delFrame(frame)
        elif frame.getShapeType() == ry.ST.mesh:
            frame.setShape(ry.ST.marker, [0.01])

    # With the table as its parent the column does not meet it.
    base = config.getFrame(f"{prefix}panda_link0")
    base.setParent(config.getFrame("table"))
    base.setPose([*arm.position, 0.0, *quaternion_of(base_rotation(arm))])

    joints = [f"{prefix}panda_joint{i + 1}" for i in range(robot.number_of_joints)]
    links = [f"{prefix}panda_link0", *joints]
    _add_capsules(ry, config, robot, prefix, links)

    gripper = config.addFrame(gripper_frame(index), links[-1])
    gripper.setRelativePose([*robot.gripper_center, *quaternion_of(robot.hand_rotation)])
    return tuple(joints)


def _add_capsules(ry: Any, config: Any, robot: Robot, prefix: str, links: list[str]) -> None:
    """Add our collision capsules to the links of an arm, with open fingers."""
    capsules = robot.capsules
    for c, name in enumerate(capsules.names):
        start = capsules.starts[c]
        end = capsules.ends[c]
        offset = capsules.finger_directions[c] * robot.finger_travel
        length = float(np.linalg.norm(end - start))
        capsule = config.addFrame(prefix + name, links[capsules.links[c]])
        capsule.setRelativePose([*((start + end) / 2 + offset), *_along(end - start)])
        capsule.setShape(ry.ST.capsule, [length, float(capsules.radii[c])])
        capsule.setContact(_LEVELS[capsules.links[c]])


def _along(direction: Floats) -> Floats:
    """A quaternion that turns z along a direction."""
    z = direction / np.linalg.norm(direction)

    # The axis that is most nearly at right angles to z gives a well-conditioned x.
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return quaternion_of(np.stack([x, np.cross(z, x), z], axis=1))


def _add_support(
    ry: Any,
    config: Any,
    name: str,
    pose: tuple[float, float, float],
    size: tuple[float, float],
) -> None:
    """Add a rectangle on the table's top that objects are placed on and nothing collides with."""
    x, y, yaw = pose
    support = config.addFrame(name)
    support.setPose([x, y, -SUPPORT_THICKNESS / 2, *_yaw_quaternion(yaw)])
    support.setShape(ry.ST.ssBox, [*size, SUPPORT_THICKNESS, 0.001]).setContact(0)


def _add_object(ry: Any, config: Any, n: int, item: SceneObject) -> None:
    """Add a box with a frame at each corner of its footprint, at the height of its center."""
    rounding = min(ROUNDING, LARGEST_ROUNDING * min(item.size))
    body = config.addFrame(object_frame(n))
    body.setPose([*item.position, item.half_extents[2], *_yaw_quaternion(item.yaw)])
    body.setShape(ry.ST.ssBox, [*item.size, rounding]).setContact(1)

    hx, hy, _ = item.half_extents
    for i, (x, y) in enumerate(((hx, hy), (hx, -hy), (-hx, -hy), (-hx, hy))):
        corner = config.addFrame(f"{object_frame(n)}_corner{i}", object_frame(n))
        corner.setRelativePosition([x, y, 0.0])
