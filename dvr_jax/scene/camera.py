"""The sensor: depth of the initial scene, and one mask for each object and for the goal region, without OpenGL.

Rays are cast by `mujoco.mj_multiRay` against what is visible: table, objects, fixed bodies and the arms' looks, but
neither their collision capsules nor the goal region, which has no height. Depth is measured along the optical axis.

An object's mask holds the pixels that show the object. The goal's mask holds the pixels whose ray would meet the goal
region on the table's plane if nothing stood in between: an occupied or hidden part would vanish from a mask of visible
pixels, and the place of the goal is part of the task, not something to be seen.
"""

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.scene.mjcf import (
    LOOKS_GROUP,
    SOLID_GROUP,
    build_home_data,
    build_model,
    object_body_name,
)
from dvr_jax.scene.pinhole import SCENE_CAMERA, Pinhole
from dvr_jax.scene.types import FixedBody, OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.workcell import Workcell

FARTHEST_DEPTH = 3.0
"""Depth of a pixel whose ray meets nothing, and the largest depth that is reported [m]."""

SMALLEST_IMAGE = 8
"""Least width and height of an image [pixels]."""

LARGEST_IMAGE = 4096
"""Largest width and height of an image [pixels]."""

_LONGEST_RAY = 1e9
"""Distance within which `mj_multiRay` looks, in multiples of a ray's length."""


@dataclass(frozen=True, slots=True)
class DepthImage:
    """What the sensor sees of a scene."""

    depth: Float32[np.ndarray, "height width"]
    """Depth along the optical axis [m], at most `FARTHEST_DEPTH`."""

    object_masks: Bool[np.ndarray, "objects height width"]
    """Where each object is seen, in the scene's order."""

    goal_mask: Bool[np.ndarray, "height width"]
    """Where the goal region lies, hidden or not."""


@dataclass(frozen=True, slots=True)
class RayHits:
    """What rays meet first."""

    distance: Float[np.ndarray, "..."]
    """Distance in multiples of each ray's length; infinite where a ray meets nothing."""

    geom: Int32[np.ndarray, "..."]
    """Index of the geom; -1 where a ray meets nothing."""

    normal: Float[np.ndarray, "... 3"]
    """Outward unit normal of the surface; zero where a ray meets nothing."""


def render_depth(scene: Scene, width: int = 64, height: int = 64) -> DepthImage:
    """Depth and masks of a scene's initial state, seen by `SCENE_CAMERA`.

    Args:
        scene: The scene.
        width: Width of the image [pixels].
        height: Height of the image [pixels].

    Returns:
        The image, with the same values as `render_depth_of_state` has for the initial state.

    Raises:
        SceneError: The image is too small or too large.
    """
    rays, empty = _empty_table(scene.workcell, width, height)
    depth = empty.copy()
    object_masks = np.zeros((len(scene.objects), height, width), np.bool_)

    # A ray that passes all bodies beside the table and the arms sees what it sees of the empty table. Casting only the
    # others saves most of the time.
    bodies: tuple[SceneObject | FixedBody, ...] = (*scene.objects, *scene.fixed)
    if bodies:
        model = build_model(scene)
        data = build_home_data(model)

    for body in bodies:
        center = scene.center_of(body) if isinstance(body, SceneObject) else body.position
        radius = float(np.linalg.norm(body.half_extents))
        window = SCENE_CAMERA.window(center, radius, width, height)
        depth[window], object_masks[:, *window] = _see(
            scene, model, data, SCENE_CAMERA, rays[window]
        )

    goal_mask = np.zeros((height, width), np.bool_)

    for region in scene.all_regions:
        area = region.footprint
        radius = float(np.linalg.norm(area.half))
        level = scene.height_of_top(region.support)
        window = SCENE_CAMERA.window((*area.center, level), radius, width, height)
        goal_mask[window] |= _project_rectangle(area, level, SCENE_CAMERA, rays[window])

    return DepthImage(depth, object_masks, goal_mask)


def empty_depth(workcell: Workcell, width: int, height: int) -> Float32[np.ndarray, "height width"]:
    """Depth of the table and the arms at home alone, without objects and fixed bodies.

    Args:
        workcell: Arms and table.
        width: Width of the image [pixels].
        height: Height of the image [pixels].

    Returns:
        Depth along the optical axis of `SCENE_CAMERA` [m]; read-only.

    Raises:
        SceneError: The image is too small or too large.
    """
    _, depth = _empty_table(workcell, width, height)
    return depth


def render_depth_of_state(
    scene: Scene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    width: int = 64,
    height: int = 64,
    camera: Pinhole = SCENE_CAMERA,
) -> DepthImage:
    """Depth and masks of any state of a scene's model, seen by any camera.

    Args:
        scene: The scene.
        model: Its model.
        data: A state of the model, with the poses of its geoms computed.
        width: Width of the image [pixels].
        height: Height of the image [pixels].
        camera: The camera.

    Returns:
        The image.

    Raises:
        SceneError: The image is too small or too large.
    """
    _require_size(width, height)
    rays = camera.pixel_rays(width, height)
    depth, object_masks = _see(scene, model, data, camera, rays)
    goal_mask = np.zeros((height, width), np.bool_)

    for region in scene.all_regions:
        level = scene.height_of_top(region.support)
        goal_mask |= _project_rectangle(region.footprint, level, camera, rays)

    return DepthImage(depth, object_masks, goal_mask)


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origin: tuple[float, float, float],
    rays: Float[np.ndarray, "... 3"],
    groups: tuple[int, ...],
) -> RayHits:
    """Find the nearest geoms along rays from one point.

    Args:
        model: The model.
        data: Its state, with the poses of the geoms computed.
        origin: Point in the world where all rays start [m].
        rays: Vectors of the rays in the world [m].
        groups: Groups of the geoms that can be met.

    Returns:
        What each ray meets first.
    """
    shape = rays.shape[:-1]
    count = int(np.prod(shape))
    enabled = np.zeros(6, dtype=np.uint8)
    enabled[list(groups)] = 1

    geoms = np.full(count, -1, dtype=np.int32)
    distances = np.full(count, -1.0)
    normals = np.zeros(3 * count)
    include_static_geoms = True
    excluded_body = -1
    mujoco.mj_multiRay(
        model,
        data,
        np.asarray(origin, dtype=float),
        np.ascontiguousarray(rays, dtype=float).ravel(),
        enabled,
        include_static_geoms,
        excluded_body,
        geoms,
        distances,
        normals,
        count,
        _LONGEST_RAY,
    )
    distances[geoms < 0] = np.inf

    return RayHits(distances.reshape(shape), geoms.reshape(shape), normals.reshape(*shape, 3))


@lru_cache(maxsize=4)
def _empty_table(
    workcell: Workcell,
    width: int,
    height: int,
) -> tuple[Float[np.ndarray, "height width 3"], Float32[np.ndarray, "height width"]]:
    """Rays of `SCENE_CAMERA`, and their depth where nothing but the arms stands on the table."""
    _require_size(width, height)
    rays = SCENE_CAMERA.pixel_rays(width, height)
    # The goal region of this scene is never seen; a scene cannot be without one.
    scene = Scene((), OnRegion("", Region((0.0, 0.0), 0.0, (0.1, 0.1))), workcell)
    model = build_model(scene)
    depth, _ = _see(scene, model, build_home_data(model), SCENE_CAMERA, rays)
    depth.setflags(write=False)

    return rays, depth


def _require_size(width: int, height: int) -> None:
    for name, pixels in (("width", width), ("height", height)):
        if not SMALLEST_IMAGE <= pixels <= LARGEST_IMAGE:
            raise SceneError(
                f"the image's {name} is {pixels} pixels; valid are {SMALLEST_IMAGE} to {LARGEST_IMAGE}."
            )


def _see(
    scene: Scene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: Pinhole,
    rays: Float[np.ndarray, "height width 3"],
) -> tuple[Float32[np.ndarray, "height width"], Bool[np.ndarray, "objects height width"]]:
    """Depth [m] and masks of the objects along rays of a camera."""
    hits = cast_rays(model, data, camera.position, rays, groups=(SOLID_GROUP, LOOKS_GROUP))
    object_geoms = np.array(
        [model.geom(object_body_name(name)).id for name in scene.object_names], np.int32
    )
    depth = np.minimum(hits.distance, FARTHEST_DEPTH)

    return depth.astype(np.float32), hits.geom[None] == object_geoms[:, None, None]


def _project_rectangle(
    rectangle: Rectangle,
    level: float,
    camera: Pinhole,
    rays: Float[np.ndarray, "height width 3"],
) -> Bool[np.ndarray, "height width"]:
    """Pixels whose ray meets a rectangle on the plane z = level, whatever stands in between."""
    descent = np.minimum(rays[..., 2], -1e-9)  # a ray towards the sky never meets the plane
    drop = level - camera.position[2]
    points = np.asarray(camera.position)[:2] + rays[..., :2] * (drop / descent)[..., None]
    local = (points - np.asarray(rectangle.center)) @ rectangle.axes().T
    within = np.all(np.abs(local) <= np.asarray(rectangle.half), axis=-1)

    return np.asarray(within & (rays[..., 2] < 0))
