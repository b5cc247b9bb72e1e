"""The shape "tile", defined only in tests: a square prism given by its side and height; and its half in the check."""

from __future__ import annotations

import numpy as np

from dvr_jax.checker.shapes import BOX_CHECK, ShapeCheck
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.shapes import Shape, Size

TILE = Shape(
    name="tile",
    size_names=("side", "height"),
    half_extents=lambda size: (size[0] / 2, size[0] / 2, size[1] / 2),
    prism=lambda size: (size[0] / 2, size[0] / 2, size[1] / 2, 0.0),
    footprint=lambda size, position, yaw: Rectangle(position, (size[0] / 2, size[0] / 2), yaw),
    grip_width=lambda size, face: size[0],
    tangent_half_extent=lambda size, face: size[0] / 2,
    has_faces=True,
    mujoco_geom=lambda size: ("box", [size[0] / 2, size[0] / 2, size[1] / 2]),
)


def as_box(size: Size) -> Size:
    """Full extents of a tile."""
    side, height = size
    return (side, side, height)


TILE_CHECK = ShapeCheck(
    name="tile",
    lowest_point=lambda size, position, rotation: float(
        position[2] - np.abs(rotation[2]) @ (size[0] / 2, size[0] / 2, size[1] / 2)
    ),
    bottom_outline=lambda size, position, rotation: BOX_CHECK.bottom_outline(
        as_box(size), position, rotation
    ),
    half_width=lambda size, face: size[0] / 2,
    distance_outside=lambda size, point: BOX_CHECK.distance_outside(as_box(size), point),
    closing_deviation=lambda size, face, closing: BOX_CHECK.closing_deviation(
        as_box(size), face, closing
    ),
    closing_offset=lambda size, center, closing: 0.0,
)
