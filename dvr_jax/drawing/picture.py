"""Pictures for people: a shaded color image of any state of a scene, cast by rays, without OpenGL.

Light: a key lamp with hard shadows, a weak fill light from the camera, a sky that is brighter above than below, and a
small highlight. A surface of color ``a`` with unit normal n, direction l to the lamp and v to the camera has the color

    a (KEY lit max(n.l, 0) + FILL max(n.v, 0) + GROUND + (SKY - GROUND) (n_z + 1) / 2) + GLOSS lit max(n.h, 0)^40

with ``h = (l + v) / |l + v|`` (J. F. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH
1977). The lamp is a point, so all shadow rays start there and one call of `mj_multiRay` tests them all.

Only edges are smoothed: pixels beside a change of color are cast again with four rays each.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from jaxtyping import Bool, Float, UInt8

from dvr_jax.scene.camera import cast_rays
from dvr_jax.scene.mjcf import GOAL_GROUP, LOOKS_GROUP, SOLID_GROUP
from dvr_jax.scene.pinhole import Pinhole

PICTURE_CAMERA = Pinhole(
    position=(0.0, -2.38, 1.91),
    target=(0.0, -0.34, 0.20),
    field_of_view=math.radians(35.0),
)
"""Shows all arms and the whole table, seen from the long side, in images 1.6 times as wide as high."""

LAMP = (-0.7, -2.2, 3.0)
"""Position of the key lamp in the world [m]."""

KEY = 0.58
"""Strength of the key lamp."""

FILL = 0.20
"""Strength of the fill light from the camera."""

SKY = 0.34
"""Strength of the ambient light on a surface that faces upwards."""

GROUND = 0.20
"""Strength of the ambient light on a surface that faces downwards."""

GLOSS = 0.10
"""Strength of the highlight."""

GLOSS_EXPONENT = 40
"""Sharpness of the highlight."""

BACKGROUND_TOP = np.array([0.90, 0.92, 0.94])
"""Color behind everything at the image's upper border."""

BACKGROUND_BOTTOM = np.array([0.76, 0.79, 0.82])
"""Color behind everything at the image's lower border; between the two the color changes linearly."""

SHADOW_SLACK = 2e-3
"""A shadow ray that ends this much before its point is blocked [m]; a shorter gap is the point's own surface."""

EDGE_THRESHOLD = 0.06
"""Neighboring pixels that differ by more than this in any color channel are cast again."""

EDGE_SHIFTS = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))
"""Offsets of the rays of an edge pixel from its center [pixels]: a rotated grid."""

VISIBLE_GROUPS = (GOAL_GROUP, SOLID_GROUP, LOOKS_GROUP)
"""Groups of the geoms that are drawn."""


def render_picture(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    width: int = 640,
    height: int = 400,
    camera: Pinhole = PICTURE_CAMERA,
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw a state of a scene's model.

    Args:
        model: The model.
        data: Its state, with the poses of the geoms computed.
        width: Width of the image [pixels].
        height: Height of the image [pixels].
        camera: The camera.

    Returns:
        Colors, RGB from 0 to 255.
    """
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    image = _shade(model, data, camera, camera.rays(columns, rows, width, height), rows / height)

    edges = _find_edges(image)
    color = np.zeros((int(edges.sum()), 3))

    for shift_x, shift_y in EDGE_SHIFTS:
        rays = camera.rays(columns[edges] + shift_x, rows[edges] + shift_y, width, height)
        color += _shade(model, data, camera, rays, rows[edges] / height) / len(EDGE_SHIFTS)

    image[edges] = color

    return np.asarray(np.round(255 * image), dtype=np.uint8)


def render_states(
    model: mujoco.MjModel,
    states: Float[np.ndarray, "states nq"],
    width: int,
    height: int,
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Draw several states of a scene's model.

    Args:
        model: The model.
        states: The states, in the layout of `dvr_jax.scene.layout`.
        width: Width of each image [pixels].
        height: Height of each image [pixels].

    Returns:
        One image for each state, RGB from 0 to 255.
    """

    def render(qpos: Float[np.ndarray, " nq"]) -> UInt8[np.ndarray, "height width 3"]:
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)

        return render_picture(model, data, width, height)

    # MuJoCo casts rays without holding Python's lock, so threads draw in parallel.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(render, states))


def _shade(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: Pinhole,
    rays: Float[np.ndarray, "*rays 3"],
    heights: Float[np.ndarray, "*rays"],
) -> Float[np.ndarray, "*rays 3"]:
    """Colors from 0 to 1 along rays; `heights` is 0 at the image's upper border and 1 at its lower one."""
    image = np.asarray(BACKGROUND_TOP + heights[..., None] * (BACKGROUND_BOTTOM - BACKGROUND_TOP))
    hits = cast_rays(model, data, camera.position, rays, VISIBLE_GROUPS)
    hit = hits.geom >= 0
    rays = rays[hit]
    normals = hits.normal[hit]
    points = np.asarray(camera.position) + rays * hits.distance[hit][:, None]

    # Directions from the points to lamp and camera, and whether anything stands between point and lamp.
    to_lamp = np.asarray(LAMP) - points
    lamp_distance = np.linalg.norm(to_lamp, axis=1)
    to_lamp /= lamp_distance[:, None]
    to_camera = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    shadow = cast_rays(model, data, LAMP, -to_lamp, VISIBLE_GROUPS)
    lit = shadow.distance > lamp_distance - SHADOW_SLACK

    # The terms of the formula in the module's docstring.
    facing_lamp = _dot(normals, to_lamp)
    key = KEY * np.maximum(facing_lamp, 0.0) * lit
    fill = FILL * np.maximum(_dot(normals, to_camera), 0.0)
    ambient = GROUND + (SKY - GROUND) * (normals[:, 2] + 1) / 2
    halfway = to_lamp + to_camera
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    gloss = (
        GLOSS * np.maximum(_dot(normals, halfway), 0.0) ** GLOSS_EXPONENT * lit * (facing_lamp > 0)
    )

    own_color = model.geom_rgba[hits.geom[hit], :3].astype(float)
    image[hit] = np.clip(own_color * (key + fill + ambient)[:, None] + gloss[:, None], 0.0, 1.0)

    return image


def _dot(
    first: Float[np.ndarray, "points 3"], second: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Scalar products, row by row."""
    return np.asarray(np.einsum("ij,ij->i", first, second))


def _find_edges(
    image: Float[np.ndarray, "height width 3"],
) -> Bool[np.ndarray, "height width"]:
    """Pixels beside a jump in color."""
    edges = np.zeros(image.shape[:2], dtype=bool)
    across = np.abs(np.diff(image, axis=1)).max(axis=2) > EDGE_THRESHOLD
    down = np.abs(np.diff(image, axis=0)).max(axis=2) > EDGE_THRESHOLD
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down

    return edges
