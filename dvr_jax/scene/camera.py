"""The sensor: depth of the initial scene and one mask for each object and for the goal region, without OpenGL.

Rays are cast by `mujoco.mj_multiRay` against what is visible: table, objects and the arms' looks (not their collision
capsules, not the goal's spot, which has no height). Depth is measured along the optical axis, in metres.

An object's mask holds the pixels that show it. The goal's mask holds the pixels whose ray would meet the goal's
rectangle on the table's plane if nothing stood in between: what is occupied or hidden would vanish from a mask of
visible pixels, and the place of the goal is part of the task, not something to be seen.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.scene.mjcf import (
    LOOKS_GROUP,
    SOLID_GROUP,
    build_home_data,
    build_model,
    object_body_name,
)
from dvr_jax.scene.pinhole import SCENE_CAMERA, Pinhole
from dvr_jax.scene.types import Region, Scene

FARTHEST_DEPTH = 3.0
"""Depth (m) of a pixel whose ray meets nothing, and the largest depth that is reported."""

SMALLEST_IMAGE = 8
LARGEST_IMAGE = 4096


@dataclass(frozen=True, slots=True)
class DepthImage:
    """What the sensor sees of a scene."""

    depth: NDArray[np.float32]
    """Depth along the optical axis (H, W), m; at most FARTHEST_DEPTH."""
    object_masks: NDArray[np.bool_]
    """Where each object is seen (N, H, W), in the scene's order."""
    goal_mask: NDArray[np.bool_]
    """Where the goal region lies (H, W), hidden or not."""


def render_depth(scene: Scene, width: int = 64, height: int = 64) -> DepthImage:
    """Depth and masks of the scene's initial state, seen by SCENE_CAMERA."""
    model = build_model(scene)
    return render_depth_of_state(scene, model, build_home_data(model), width, height)


def render_depth_of_state(
    scene: Scene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    width: int = 64,
    height: int = 64,
    camera: Pinhole = SCENE_CAMERA,
) -> DepthImage:
    """The same for any state of the scene's model; `data` has its geoms' poses computed."""
    for name, pixels in (("width", width), ("height", height)):
        if not SMALLEST_IMAGE <= pixels <= LARGEST_IMAGE:
            raise DvrError(f"the image's {name} is {pixels} pixels; valid are {SMALLEST_IMAGE} to {LARGEST_IMAGE}.")
    rays = camera.pixel_rays(width, height)
    depth, geoms, _ = cast_rays(model, data, camera.position, rays, groups=(SOLID_GROUP, LOOKS_GROUP))
    depth = np.where(np.isfinite(depth), depth, FARTHEST_DEPTH)
    object_geoms = np.array([model.geom(object_body_name(item.name)).id for item in scene.objects])
    return DepthImage(
        depth=np.minimum(depth, FARTHEST_DEPTH).astype(np.float32),
        object_masks=geoms[None] == object_geoms[:, None, None],
        goal_mask=_project_region(scene.goal.region, camera, rays),
    )


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origin: tuple[float, float, float] | NDArray[np.float64],
    rays: NDArray[np.float64],
    groups: tuple[int, ...],
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Nearest geoms of the given groups along rays (..., 3) from one origin.

    Returns the distance in multiples of each ray's length (...), inf where nothing is met; the geom's id (...), -1
    there; the surface's outward unit normal (..., 3), zero there.
    """
    shape = rays.shape[:-1]
    count = int(np.prod(shape))
    enabled = np.zeros(6, dtype=np.uint8)
    enabled[list(groups)] = 1
    geoms = np.full(count, -1, dtype=np.int32)
    distances = np.full(count, -1.0)
    normals = np.zeros(3 * count)
    mujoco.mj_multiRay(
        model,
        data,
        np.asarray(origin, dtype=float),
        np.ascontiguousarray(rays, dtype=float).ravel(),
        enabled,
        True,  # static geoms too
        -1,  # exclude no body
        geoms,
        distances,
        normals,
        count,
        1e9,
    )
    distances[geoms < 0] = np.inf
    return distances.reshape(shape), geoms.reshape(shape), normals.reshape(*shape, 3)


def _project_region(region: Region, camera: Pinhole, rays: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Pixels whose ray meets the region on the plane z = 0, whatever stands in between (H, W)."""
    descent = np.minimum(rays[..., 2], -1e-9)  # rays towards the sky never meet the table
    points = np.asarray(camera.position)[:2] + rays[..., :2] * (-camera.position[2] / descent)[..., None]
    local = (points - np.asarray(region.position)) @ region.footprint.axes().T
    within = np.all(np.abs(local) <= np.asarray(region.size) / 2, axis=-1)
    return np.asarray(within & (rays[..., 2] < 0))
