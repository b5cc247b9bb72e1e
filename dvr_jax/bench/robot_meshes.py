"""The bodies of a scene for the library `coal`: the meshes of the Panda's maker, boxes and cylinders.

The wheel `example-robot-data` brings the collision meshes of the Panda. They are convex: each fills at least 99.96 % of
its convex hull. The convex hulls are therefore used as the bodies, and `coal` finds their signed distances by the
algorithms GJK and EPA. Both wheels belong to the optional extra `meshes`.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

from dvr_jax.errors import DvrError
from dvr_jax.scene.types import FixedBody, SceneObject
from dvr_jax.workcell.robot import Robot

INSTALL = "install them with: pip install 'dvr_jax[meshes]'"
"""How a user gets what is missing."""

MESH_FOLDER = Path(
    "cmeel.prefix/share/example-robot-data/robots/panda_description/meshes/collision"
)
"""Folder of the meshes beside the installed package."""

PANDA_MESHES: dict[str, str] = {
    "base": "link0",
    **{f"link{number}": f"link{number}" for number in range(1, 8)},
    "hand": "hand",
    "finger_left": "finger",
    "finger_right": "finger",
}
"""Mesh of each body of a Panda."""

HALF_TURN = np.array([-1.0, -1.0, 1.0])
"""Factors of the coordinates of the right finger's mesh, which is the left one after half a turn about the hand's
axis."""


def require_meshes(robot: Robot) -> None:
    """Refuse to go on where distances of meshes cannot be computed.

    Args:
        robot: The robot of the workcell.

    Raises:
        DvrError: A wheel is missing, or there are no meshes of this robot.
    """
    if util.find_spec("coal") is None:
        raise DvrError(
            f"distances of meshes need the wheels coal and example-robot-data; {INSTALL}"
        )
    if robot.name != "panda":
        raise DvrError(f"there are no meshes of the robot '{robot.name}'; valid is panda.")
    find_mesh_folder()


def find_mesh_folder() -> Path:
    """Return the folder of the Panda's collision meshes.

    Raises:
        DvrError: The wheel `example-robot-data` is not installed.
    """
    for package in ("cmeel", "example_robot_data"):
        found = util.find_spec(package)
        for location in (found.submodule_search_locations or []) if found else []:
            folder = Path(location).parent / MESH_FOLDER
            if folder.is_dir():
                return folder
    raise DvrError(f"distances of meshes need the wheels coal and example-robot-data; {INSTALL}")


@lru_cache(maxsize=1)
def panda_bodies() -> dict[str, Any]:
    """Load the convex bodies of a Panda by the names of the bodies in its MJCF, each in the frame of its body.

    Raises:
        DvrError: A wheel is missing.
    """
    import coal

    folder = find_mesh_folder()
    loader = coal.MeshLoader()
    bodies: dict[str, Any] = {}
    for body, mesh in PANDA_MESHES.items():
        scale = HALF_TURN if body == "finger_right" else np.ones(3)
        loaded = loader.load(str(folder / f"{mesh}.stl"), scale)
        loaded.buildConvexHull(True, "Qt")
        bodies[body] = loaded.convex
    return bodies


def coal_shape(body: SceneObject | FixedBody) -> Any:
    """Return the shape of an object or a fixed body, centered in its frame.

    Raises:
        DvrError: The body is neither a box nor a cylinder.
    """
    import coal

    if body.shape == "box":
        return coal.Box(*body.size)
    if body.shape == "cylinder":
        return coal.Cylinder(*body.size)
    raise DvrError(f"distances of meshes know no shape '{body.shape}'; valid are box and cylinder.")
