"""The sensor: depth of the initial scene and one mask for each object and for the goal region, without OpenGL.

Rays are cast by `mujoco.mj_multiRay` against what is visible: table, objects and the arms' looks (not their collision
capsules, not the goal's spot, which has no height). Depth is measured along the optical axis, in metres.

An object's mask holds the pixels that show it. The goal's mask holds the pixels whose ray would meet the goal's
rectangle on the table's plane if nothing stood in between: what is occupied or hidden would vanish from a mask of
visible pixels, and the place of the goal is part of the task, not something to be seen.
"""

from dataclasses import dataclass
from functools import lru_cache

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
from dvr_jax.scene.types import Goal, Home, Region, Scene

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
    """Depth and masks of the scene's initial state, seen by SCENE_CAMERA.

    Rays that pass all objects see what they see of the empty table; only the others are cast."""
    rays, empty = _empty_table(scene.home, width, height)
    depth, object_masks = empty.copy(), np.zeros((len(scene.objects), height, width), np.bool_)
    if scene.objects:
        model = build_model(scene)
        data = build_home_data(model)
        for item in scene.objects:
            window = SCENE_CAMERA.window(item.center, float(np.linalg.norm(item.half_extents)), width, height)
            depth[window], object_masks[:, *window] = _see(scene, model, data, SCENE_CAMERA, rays[window])
    goal_mask = np.zeros((height, width), np.bool_)
    region = scene.goal.region
    center, radius = np.array([*region.position, 0.0]), float(np.linalg.norm(region.size)) / 2
    window = SCENE_CAMERA.window(center, radius, width, height)
    goal_mask[window] = _project_region(region, SCENE_CAMERA, rays[window])
    return DepthImage(depth, object_masks, goal_mask)


def empty_depth(home: Home, width: int, height: int) -> NDArray[np.float32]:
    """Depth (height, width), m, of the table and the arms at home alone; read-only."""
    return _empty_table(home, width, height)[1]


@lru_cache(maxsize=4)
def _empty_table(home: Home, width: int, height: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """SCENE_CAMERA's rays, and their depth where nothing stands on the table."""
    _require_size(width, height)
    rays = SCENE_CAMERA.pixel_rays(width, height)
    scene = Scene((), Goal("", Region((0.0, 0.0), 0.0, (0.1, 0.1))), home)
    model = build_model(scene)
    depth, _ = _see(scene, model, build_home_data(model), SCENE_CAMERA, rays)
    depth.setflags(write=False)
    return rays, depth


def render_depth_of_state(
    scene: Scene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    width: int = 64,
    height: int = 64,
    camera: Pinhole = SCENE_CAMERA,
) -> DepthImage:
    """The same for any state of the scene's model; `data` has its geoms' poses computed."""
    _require_size(width, height)
    rays = camera.pixel_rays(width, height)
    depth, object_masks = _see(scene, model, data, camera, rays)
    return DepthImage(depth, object_masks, _project_region(scene.goal.region, camera, rays))


def _require_size(width: int, height: int) -> None:
    for name, pixels in (("width", width), ("height", height)):
        if not SMALLEST_IMAGE <= pixels <= LARGEST_IMAGE:
            raise DvrError(f"the image's {name} is {pixels} pixels; valid are {SMALLEST_IMAGE} to {LARGEST_IMAGE}.")


def _see(
    scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, camera: Pinhole, rays: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Depth (H, W), m, and masks (N, H, W) of the objects along a camera's rays (H, W, 3)."""
    depth, geoms, _ = cast_rays(model, data, camera.position, rays, groups=(SOLID_GROUP, LOOKS_GROUP))
    object_geoms = np.array([model.geom(object_body_name(item.name)).id for item in scene.objects], np.int32)
    seen = np.minimum(np.where(np.isfinite(depth), depth, FARTHEST_DEPTH), FARTHEST_DEPTH)
    return seen.astype(np.float32), geoms[None] == object_geoms[:, None, None]


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
