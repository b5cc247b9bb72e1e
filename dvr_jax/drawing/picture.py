"""Pictures for people: a shaded colour image of any state of a scene, cast by rays, without OpenGL.

Light: one key lamp with a hard shadow, a weak fill light from the camera, a sky that is brighter above than below, and
a small gloss. The key lamp is a point, so all shadow rays start there and one `mj_multiRay` call tests them all.
Edges are smoothed where they are: only pixels beside a change of geom, shadow or shade are cast again, four rays each.
"""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.scene.camera import cast_rays
from dvr_jax.scene.mjcf import GOAL_GROUP, LOOKS_GROUP, SOLID_GROUP
from dvr_jax.scene.pinhole import Pinhole

PICTURE_CAMERA = Pinhole(position=(0.0, -2.38, 1.91), target=(0.0, -0.34, 0.20), field_of_view=math.radians(35.0))
"""Shows both arms and the whole table, seen from the long side, in images 1.6 times as wide as high."""

LAMP = np.array([-0.7, -2.2, 3.0])
"""The key lamp's position in the world (m)."""

KEY, FILL, SKY, GROUND, GLOSS = 0.58, 0.20, 0.34, 0.20, 0.10
"""Strengths of key lamp, fill light, the ambient light from above and from below, and the highlight."""

BACKGROUND_TOP = np.array([0.90, 0.92, 0.94])
BACKGROUND_BOTTOM = np.array([0.76, 0.79, 0.82])
"""Colours behind everything, upper and lower border of the image (linear steps between)."""

SHADOW_SLACK = 2e-3
"""A shadow ray that ends this much (m) before the point is blocked; less is the point's own surface."""

EDGE_THRESHOLD = 0.06
"""Neighbouring pixels that differ by more than this in any colour channel are cast again."""

VISIBLE = (GOAL_GROUP, SOLID_GROUP, LOOKS_GROUP)


def render_picture(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    width: int = 640,
    height: int = 400,
    camera: Pinhole = PICTURE_CAMERA,
) -> NDArray[np.uint8]:
    """The state `data` (geoms' poses computed) as RGB (H, W, 3)."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    image = _shade(model, data, camera, camera.rays(columns, rows, width, height), rows / height)
    rough = _find_edges(image)
    colour = np.zeros((int(rough.sum()), 3))
    for shift_x, shift_y in ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)):
        rays = camera.rays(columns[rough] + shift_x, rows[rough] + shift_y, width, height)
        colour += _shade(model, data, camera, rays, rows[rough] / height) / 4
    image[rough] = colour
    return np.asarray(np.round(255 * image), dtype=np.uint8)


def _shade(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: Pinhole,
    rays: NDArray[np.float64],
    heights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Colours (..., 3) in 0 to 1 along rays (..., 3); `heights` (...) is 0 at the image's top and 1 at its bottom."""
    image = np.asarray(BACKGROUND_TOP + heights[..., None] * (BACKGROUND_BOTTOM - BACKGROUND_TOP))
    distances, geoms, normals = cast_rays(model, data, camera.position, rays, VISIBLE)
    hit = geoms >= 0
    rays, normals = rays[hit], normals[hit]
    points = np.asarray(camera.position) + rays * distances[hit][:, None]
    to_lamp = LAMP - points
    lamp_distance = np.linalg.norm(to_lamp, axis=1)
    to_lamp /= lamp_distance[:, None]
    view = -rays / np.linalg.norm(rays, axis=1, keepdims=True)

    reached, _, _ = cast_rays(model, data, LAMP, -to_lamp, VISIBLE)
    lit = reached > lamp_distance - SHADOW_SLACK
    cosine = np.einsum("ij,ij->i", normals, to_lamp)
    key = KEY * np.maximum(cosine, 0.0) * lit
    fill = FILL * np.maximum(np.einsum("ij,ij->i", normals, view), 0.0)
    ambient = GROUND + (SKY - GROUND) * (normals[:, 2] + 1) / 2
    halfway = to_lamp + view
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    gloss = GLOSS * np.maximum(np.einsum("ij,ij->i", normals, halfway), 0.0) ** 40 * lit * (cosine > 0)

    albedo = model.geom_rgba[geoms[hit], :3].astype(float)
    image[hit] = np.clip(albedo * (key + fill + ambient)[:, None] + gloss[:, None], 0.0, 1.0)
    return image


def _find_edges(image: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Pixels beside a jump in colour (H, W), from an image (H, W, 3)."""
    edges = np.zeros(image.shape[:2], dtype=bool)
    across = np.abs(np.diff(image, axis=1)).max(axis=2) > EDGE_THRESHOLD
    down = np.abs(np.diff(image, axis=0)).max(axis=2) > EDGE_THRESHOLD
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges
