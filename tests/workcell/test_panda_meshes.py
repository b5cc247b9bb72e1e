"""The Panda's collision capsules against the meshes of its maker, which the wheel `example-robot-data` brings."""

from importlib import util
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from dvr_jax.workcell.panda import PANDA

Floats = NDArray[np.float64]

OUTSTANDING = 5e-4
"""How far a point of a mesh may stand out of all capsules [m]."""

POSTURES = 20
SURFACE_POINTS = 2000
"""Random points on the surface of each mesh, beside its vertices."""


def mesh_folder() -> Path:
    """Folder of the collision meshes."""
    found = util.find_spec("cmeel") or util.find_spec("example_robot_data")
    for root in map(Path, found.submodule_search_locations or []) if found else ():
        folder = (
            root.parent
            / "cmeel.prefix/share/example-robot-data/robots/panda_description/meshes/collision"
        )
        if folder.is_dir():
            return folder
    pytest.skip("needs the wheel example-robot-data (pip install 'dvr_jax[meshes]')")


def read_points(path: Path, generator: np.random.Generator) -> Floats:
    """Vertices of a binary STL file and random points on its triangles [m]."""
    content = path.read_bytes()
    number = int.from_bytes(content[80:84], "little")
    record = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])
    corners = np.frombuffer(content[84 : 84 + 50 * number], record)["corners"]
    triangles = corners.reshape(-1, 3, 3).astype(float)

    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    chosen = generator.choice(len(triangles), SURFACE_POINTS, p=areas / areas.sum())
    cuts = np.sort(generator.random((SURFACE_POINTS, 2)), axis=1)
    weights = np.stack([cuts[:, 0], cuts[:, 1] - cuts[:, 0], 1 - cuts[:, 1]], axis=1)
    inner = np.einsum("ni,nij->nj", weights, triangles[chosen])
    return np.concatenate([triangles.reshape(-1, 3), inner])


MESHES = {
    "base": "link0",
    **{f"link{i}": f"link{i}" for i in range(1, 8)},
    "hand": "hand",
    "finger_left": "finger",
    "finger_right": "finger",
}
"""Mesh of each body."""


def test_no_point_of_a_mesh_stands_out_of_the_capsules() -> None:
    """In random postures, with the fingers anywhere: capsules of a neighboring link cover what turns about its
    joint."""
    folder = mesh_folder()
    generator = np.random.default_rng(0)
    points = {body: read_points(folder / f"{mesh}.stl", generator) for body, mesh in MESHES.items()}
    # The right finger is the left one, turned by half a turn about the hand's axis.
    points["finger_right"] = points["finger_right"] * [-1, -1, 1]

    model = PANDA.model
    data = mujoco.MjData(model)
    capsules = [model.geom(f"{name}_collision").id for name in PANDA.capsules.names]
    radius, half_length = model.geom_size[capsules, :2].T
    lower, upper = model.jnt_range.T
    for _ in range(POSTURES):
        data.qpos[:] = generator.uniform(lower, upper)
        mujoco.mj_kinematics(model, data)
        center = data.geom_xpos[capsules]
        axis = data.geom_xmat[capsules].reshape(-1, 3, 3)[:, :, 2]
        for body, local in points.items():
            frame = data.body(body)
            world = local @ frame.xmat.reshape(3, 3).T + frame.xpos
            offset = world[:, None] - center
            along = np.clip(np.einsum("pci,ci->pc", offset, axis), -half_length, half_length)
            distance = np.linalg.norm(offset - along[..., None] * axis, axis=2) - radius
            worst = distance.min(axis=1).max()
            assert worst <= OUTSTANDING, f"{body} stands out by {1e3 * worst:.2f} mm"


def test_the_capsules_are_no_blunt_ones() -> None:
    """Of the fingers, whose room between objects is scarce: 1 mm beyond the pads, 6.5 mm beyond the tips."""
    folder = mesh_folder()
    finger = read_points(folder / "finger.stl", np.random.default_rng(0))
    assert PANDA.pad_overhang == pytest.approx(1e-3, abs=2e-4)
    capsules = PANDA.capsules
    of_left = [i for i, name in enumerate(capsules.names) if name.startswith("finger_left")]
    height = max(
        max(capsules.starts[i, 2], capsules.ends[i, 2]) + capsules.radii[i] for i in of_left
    )
    tip = finger[:, 2].max() + 0.0584 + 0.107
    assert height - tip == pytest.approx(6.5e-3, abs=5e-4)
