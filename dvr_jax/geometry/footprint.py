"""Footprints of upright shapes on the table: rotated rectangles and circles, and exact tests between them.

All lengths in metres, angles in radians, in the world's horizontal plane. Everything stands upright on the table, so
two objects overlap exactly when their footprints do. Signed distances are positive apart and exact; overlapping, they
are minus the least translation that parts the two.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle with half extents `half` (2) at `center` (2), turned counter-clockwise by `yaw`."""

    center: tuple[float, float]
    half: tuple[float, float]
    yaw: float

    def axes(self) -> NDArray[np.float64]:
        """Unit vectors along the rectangle's own x and y, one per row (2, 2)."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[cosine, sine], [-sine, cosine]])

    def corners(self) -> NDArray[np.float64]:
        """The four corners in the world, counter-clockwise (4, 2)."""
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        return np.asarray(np.asarray(self.center) + (signs * np.asarray(self.half)) @ self.axes())


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc of `radius` at `center` (2)."""

    center: tuple[float, float]
    radius: float


Footprint = Rectangle | Circle


def signed_distance(first: Footprint, second: Footprint) -> float:
    """Distance of two footprints (m): positive apart, zero touching, negative overlapping."""
    if isinstance(first, Circle) and isinstance(second, Circle):
        gap = np.subtract(first.center, second.center)
        return float(np.hypot(gap[0], gap[1])) - first.radius - second.radius
    if isinstance(first, Circle) and isinstance(second, Rectangle):
        return _distance_to_rectangle(first.center, second) - first.radius
    if isinstance(first, Rectangle) and isinstance(second, Circle):
        return _distance_to_rectangle(second.center, first) - second.radius
    assert isinstance(first, Rectangle) and isinstance(second, Rectangle)
    return _rectangle_distance(first, second)


def inside(inner: Footprint, outer: Rectangle) -> bool:
    """Whether `inner` lies fully within `outer` (touching the border counts as inside, to 1e-9 m)."""
    half = np.asarray(outer.half) + 1e-9
    if isinstance(inner, Circle):
        local = _to_local(inner.center, outer)
        return bool(np.all(np.abs(local) + inner.radius <= half))
    return bool(np.all(np.abs(_to_local(inner.corners(), outer)) <= half))


def fits(inner: Footprint, sides: tuple[float, float]) -> bool:
    """Whether `inner`, turned and shifted as need be, fits into a rectangle of these sides (m).

    For a rectangle of sides p >= q in one of sides a >= b that is the condition of Carver, "Solution to problem E 1225"
    (American Mathematical Monthly 64, 1957).
    """
    long, short = max(sides), min(sides)
    if isinstance(inner, Circle):
        return 2 * inner.radius <= short
    p, q = 2 * max(inner.half), 2 * min(inner.half)
    if p <= long:
        return q <= short
    diagonal = p * p + q * q
    return (
        q <= short
        and diagonal >= long * long
        and short * diagonal >= (2 * p * q * long + (p * p - q * q) * math.sqrt(diagonal - long * long))
    )


def contains_point(point: tuple[float, float], outer: Rectangle) -> bool:
    """Whether a point lies within `outer`, the border included."""
    return bool(np.all(np.abs(_to_local(point, outer)) <= np.asarray(outer.half)))


def _to_local(points: object, rectangle: Rectangle) -> NDArray[np.float64]:
    """World points (..., 2) in the rectangle's frame (..., 2)."""
    return np.asarray((np.asarray(points, dtype=float) - np.asarray(rectangle.center)) @ rectangle.axes().T)


def _distance_to_rectangle(point: tuple[float, float], rectangle: Rectangle) -> float:
    """Signed distance of a point to a rectangle's border, negative inside."""
    excess = np.abs(_to_local(point, rectangle)) - np.asarray(rectangle.half)
    outside = np.maximum(excess, 0.0)
    return float(np.hypot(outside[0], outside[1]) + min(float(excess.max()), 0.0))


def _rectangle_distance(first: Rectangle, second: Rectangle) -> float:
    """Signed distance of two rectangles: largest gap over the four face normals, or corner distance when apart."""
    offset = np.subtract(second.center, first.center)
    axes = np.concatenate([first.axes(), second.axes()])  # (4, 2)
    reach = np.abs(axes @ first.axes().T) @ np.asarray(first.half) + np.abs(axes @ second.axes().T) @ np.asarray(
        second.half
    )
    gap = float((np.abs(axes @ offset) - reach).max())
    if gap <= 0.0:
        return gap
    # Apart: of two separate convex polygons, the nearest pair always contains a corner.
    corner_distances = [_distance_to_rectangle((x, y), second) for x, y in first.corners()]
    corner_distances += [_distance_to_rectangle((x, y), first) for x, y in second.corners()]
    return min(corner_distances)
