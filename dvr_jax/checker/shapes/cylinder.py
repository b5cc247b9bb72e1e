"""The check of an upright cylinder: size = (radius, height) [m].

Its side has a horizontal normal everywhere, so the name of the grasped face plays no part.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from dvr_jax.checker.shapes.shape import (
    Outline,
    ShapeCheck,
    Size,
    register_shape_check,
)


def _lowest_point(
    size: Size,
    position: Float[np.ndarray, " 3"],
    rotation: Float[np.ndarray, "3 3"],
) -> float:
    radius = size[0]
    half_height = size[1] / 2
    tilt = np.hypot(rotation[2, 0], rotation[2, 1])
    return float(position[2] - abs(rotation[2, 2]) * half_height - tilt * radius)


def _bottom_outline(
    size: Size,
    position: Float[np.ndarray, " 3"],
    rotation: Float[np.ndarray, "3 3"],
) -> Outline:
    middle = position - rotation[:, 2] * (size[1] / 2)
    return Outline(middle[None, :2], size[0])


def _half_width(size: Size, face: str) -> float:
    return size[0]


def _distance_outside(size: Size, point: Float[np.ndarray, " 3"]) -> float:
    beside = np.hypot(point[0], point[1]) - size[0]
    above = abs(point[2]) - size[1] / 2
    excess = np.array([beside, above])
    return float(np.linalg.norm(np.maximum(excess, 0.0)))


def _closing_deviation(size: Size, face: str, closing: Float[np.ndarray, " 3"]) -> float:
    return float(np.arctan2(abs(closing[2]), np.hypot(closing[0], closing[1])))


def _closing_offset(
    size: Size, center: Float[np.ndarray, " 3"], closing: Float[np.ndarray, " 3"]
) -> float:
    # The bound keeps a vertical closing axis from a division by zero.
    length = max(np.hypot(closing[0], closing[1]), 1e-9)
    return float(abs(center[0] * closing[1] - center[1] * closing[0]) / length)


CYLINDER_CHECK = register_shape_check(
    ShapeCheck(
        name="cylinder",
        lowest_point=_lowest_point,
        bottom_outline=_bottom_outline,
        half_width=_half_width,
        distance_outside=_distance_outside,
        closing_deviation=_closing_deviation,
        closing_offset=_closing_offset,
    )
)
"""The check of an upright cylinder."""
