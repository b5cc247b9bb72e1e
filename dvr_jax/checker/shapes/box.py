"""The check of a box: size = full extents (x, y, z) in its own frame [m]."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from dvr_jax.checker.shapes.shape import (
    FACE_NORMALS,
    Outline,
    ShapeCheck,
    Size,
    register_shape_check,
)


def _half_extents(size: Size) -> Float[np.ndarray, " 3"]:
    return np.array(size) / 2


def _lowest_point(
    size: Size,
    position: Float[np.ndarray, " 3"],
    rotation: Float[np.ndarray, "3 3"],
) -> float:
    return float(position[2] - np.abs(rotation[2]) @ _half_extents(size))


def _bottom_outline(
    size: Size,
    position: Float[np.ndarray, " 3"],
    rotation: Float[np.ndarray, "3 3"],
) -> Outline:
    signs = np.array([[-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0]])
    corners = position + (signs * _half_extents(size)) @ rotation.T
    return Outline(corners[:, :2], 0.0)


def _half_width(size: Size, face: str) -> float:
    return float(np.abs(FACE_NORMALS[face]) @ _half_extents(size))


def _distance_outside(size: Size, point: Float[np.ndarray, " 3"]) -> float:
    excess = np.abs(point) - _half_extents(size)
    return float(np.linalg.norm(np.maximum(excess, 0.0)))


def _closing_deviation(size: Size, face: str, closing: Float[np.ndarray, " 3"]) -> float:
    normal = np.array(FACE_NORMALS[face])
    return float(np.arctan2(np.linalg.norm(np.cross(normal, closing)), normal @ closing))


def _closing_offset(
    size: Size, center: Float[np.ndarray, " 3"], closing: Float[np.ndarray, " 3"]
) -> float:
    return 0.0


BOX_CHECK = register_shape_check(
    ShapeCheck(
        name="box",
        lowest_point=_lowest_point,
        bottom_outline=_bottom_outline,
        half_width=_half_width,
        distance_outside=_distance_outside,
        closing_deviation=_closing_deviation,
        closing_offset=_closing_offset,
    )
)
"""The check of a box."""
