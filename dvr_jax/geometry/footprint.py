"""Footprints of upright bodies in the horizontal plane: rotated rectangles and circles, and exact tests between them.

All lengths are in meters and all angles in radians. Two bodies that stand on one plane overlap exactly when their
footprints do. Signed distances are exact: positive apart, zero touching, and for overlapping footprints minus the
length of the shortest translation that separates them.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

BORDER_TOLERANCE = 1e-9
"""A footprint that reaches over a border by no more counts as inside [m]: rounding must not decide."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle that is turned counterclockwise."""

    center: tuple[float, float]
    """Center (x, y) in the world [m]."""

    half: tuple[float, float]
    """Half extents along the rectangle's own x and y [m]."""

    yaw: float
    """Turn about the vertical axis [rad]."""

    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Unit vectors along the rectangle's own x and y, one in each row."""
        cosine = np.cos(self.yaw)
        sine = np.sin(self.yaw)

        return np.array([[cosine, sine], [-sine, cosine]])

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """The four corners in the world, counterclockwise [m]."""
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        return np.asarray(np.asarray(self.center) + (signs * np.asarray(self.half)) @ self.axes())


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc."""

    center: tuple[float, float]
    """Center (x, y) in the world [m]."""

    radius: float
    """Radius [m]."""


Footprint = Rectangle | Circle


def signed_distance(first: Footprint, second: Footprint) -> float:
    """Signed distance of two footprints.

    Args:
        first: One footprint.
        second: The other one; their order does not matter.

    Returns:
        The distance [m]: positive apart, zero touching, negative overlapping.
    """
    if isinstance(first, Circle) and isinstance(second, Circle):
        gap = np.subtract(first.center, second.center)
        return float(np.hypot(gap[0], gap[1])) - first.radius - second.radius
    if isinstance(first, Circle) and isinstance(second, Rectangle):
        return _distance_to_rectangle(first.center, second) - first.radius
    if isinstance(first, Rectangle) and isinstance(second, Circle):
        return _distance_to_rectangle(second.center, first) - second.radius

    assert isinstance(first, Rectangle) and isinstance(second, Rectangle)

    return _rectangle_distance(first, second)


def inside(inner: Footprint, outer: Rectangle, tolerance: float = BORDER_TOLERANCE) -> bool:
    """Whether a footprint lies fully within a rectangle; touching the border counts as inside.

    Args:
        inner: The footprint.
        outer: The rectangle.
        tolerance: Distance by which the footprint may reach over the border [m].
    """
    half = np.asarray(outer.half) + tolerance
    if isinstance(inner, Circle):
        local = _to_local(inner.center, outer)
        return bool(np.all(np.abs(local) + inner.radius <= half))

    return bool(np.all(np.abs(_to_local(inner.corners(), outer)) <= half))


def covers(outer: Footprint, inner: Footprint, tolerance: float = BORDER_TOLERANCE) -> bool:
    """Whether a footprint covers another one fully; touching the border counts as covered.

    Args:
        outer: The footprint that covers.
        inner: The footprint that is covered.
        tolerance: Distance by which the inner one may reach over the border [m].
    """
    if isinstance(outer, Rectangle):
        return inside(inner, outer, tolerance)

    if isinstance(inner, Circle):
        return math.dist(inner.center, outer.center) + inner.radius <= outer.radius + tolerance

    distances = np.linalg.norm(inner.corners() - np.asarray(outer.center), axis=1)

    return bool(np.all(distances <= outer.radius + tolerance))


def fits(inner: Footprint, sides: tuple[float, float]) -> bool:
    """Whether a footprint fits into a rectangle if both may be turned and shifted freely.

    A rectangle of sides p >= q fits into one of sides a >= b if p <= a and q <= b, or if p > a, q <= b and

        b (p^2 + q^2) >= 2 p q a + (p^2 - q^2) sqrt(p^2 + q^2 - a^2).

    Source: W. B. Carver, "Solution to problem E 1225", American Mathematical Monthly 64 (1957).

    Args:
        inner: The footprint; its position and turn do not matter.
        sides: Full extents of the rectangle [m].
    """
    long_side = max(sides)
    short_side = min(sides)
    if isinstance(inner, Circle):
        return 2 * inner.radius <= short_side

    p = 2 * max(inner.half)
    q = 2 * min(inner.half)
    if p <= long_side:
        return q <= short_side

    diagonal = p * p + q * q
    if q > short_side or diagonal < long_side * long_side:
        return False

    root = math.sqrt(diagonal - long_side * long_side)

    return short_side * diagonal >= (2 * p * q * long_side + (p * p - q * q) * root)


def contains_point(point: tuple[float, float], outer: Rectangle) -> bool:
    """Whether a point lies within a rectangle, the border included.

    Args:
        point: The point (x, y) in the world [m].
        outer: The rectangle.
    """
    return bool(np.all(np.abs(_to_local(point, outer)) <= np.asarray(outer.half)))


def _to_local(
    points: tuple[float, float] | Float[np.ndarray, "... 2"],
    rectangle: Rectangle,
) -> Float[np.ndarray, "... 2"]:
    """World points in the rectangle's own frame."""
    offsets = np.asarray(points, dtype=float) - np.asarray(rectangle.center)
    return np.asarray(offsets @ rectangle.axes().T)


def _distance_to_rectangle(point: tuple[float, float], rectangle: Rectangle) -> float:
    """Signed distance of a point from a rectangle's border, negative inside."""
    excess = np.abs(_to_local(point, rectangle)) - np.asarray(rectangle.half)
    outside = np.maximum(excess, 0.0)

    return float(np.hypot(outside[0], outside[1]) + min(float(excess.max()), 0.0))


def _rectangle_distance(first: Rectangle, second: Rectangle) -> float:
    """Signed distance of two rectangles by the separating axis theorem.

    Overlapping rectangles are separated fastest along one of the four face normals. Of two convex polygons that are
    apart, the nearest pair of points always contains a corner.
    """
    axes = np.concatenate([first.axes(), second.axes()])  # (4, 2)
    offset = np.subtract(second.center, first.center)
    reach_of_first = np.abs(axes @ first.axes().T) @ np.asarray(first.half)
    reach_of_second = np.abs(axes @ second.axes().T) @ np.asarray(second.half)
    gap = float((np.abs(axes @ offset) - (reach_of_first + reach_of_second)).max())
    if gap <= 0.0:
        return gap

    from_first = [_distance_to_rectangle((x, y), second) for x, y in first.corners()]
    from_second = [_distance_to_rectangle((x, y), first) for x, y in second.corners()]

    return min(from_first + from_second)
