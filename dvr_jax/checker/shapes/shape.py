"""What the check has to know of a shape, and the shapes that it knows.

The check measures objects by formulas of its own, apart from those of the planner. A further shape is one file with a
`ShapeCheck` that `register_shape_check` makes known under the shape's name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.errors import SceneError

Size = tuple[float, ...]
"""The numbers of an object's size [m], as the scene gives them."""

FACE_NORMALS: dict[str, tuple[float, float, float]] = {
    "+x": (1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
}
"""Outward normals of the faces at which an object is grasped, in its own frame."""


@dataclass(frozen=True, slots=True)
class Outline:
    """The outline of an object's bottom: all points within `radius` of the hull of `points`."""

    points: Float[np.ndarray, "points 2"]
    """Points (x, y) in the world [m]."""

    radius: float
    """Radius of the rounding around the points [m]."""


@dataclass(frozen=True)
class ShapeCheck:
    """How an object of one shape is measured."""

    name: str
    """Name of the shape in scenes."""

    lowest_point: Callable[[Size, Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]], float]
    """Height of the lowest point of an object at a position [m] and rotation in the world [m]."""

    bottom_outline: Callable[[Size, Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]], Outline]
    """Outline of the bottom of an object at a position [m] and rotation in the world."""

    half_width: Callable[[Size, str], float]
    """Half the width between the fingers of a gripper that grasps the object at a face [m]."""

    distance_outside: Callable[[Size, Float[np.ndarray, " 3"]], float]
    """Distance of a point in the object's frame from the object [m]; zero inside."""

    closing_deviation: Callable[[Size, str, Float[np.ndarray, " 3"]], float]
    """Angle between a closing axis in the object's frame and the normal of the grasped face [rad]."""

    closing_offset: Callable[[Size, Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]], float]
    """Distance by which the closing axis through a gripper center misses the object's own axis [m]; the center and the
    axis are in the object's frame. Zero for shapes that may be grasped anywhere along a face."""


_SHAPE_CHECKS: dict[str, ShapeCheck] = {}


def register_shape_check(shape: ShapeCheck) -> ShapeCheck:
    """Make the check of a shape known by the shape's name; returns it."""
    _SHAPE_CHECKS[shape.name] = shape
    return shape


def shape_check_named(name: str) -> ShapeCheck:
    """Return the check of the shape of this name.

    Raises:
        SceneError: There is none; the message lists the names that are known.
    """
    if name not in _SHAPE_CHECKS:
        known = ", ".join(map(repr, _SHAPE_CHECKS))
        raise SceneError(f"the check does not know the shape {name!r}; it knows {known}.")
    return _SHAPE_CHECKS[name]
