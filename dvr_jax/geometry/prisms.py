"""Prisms: the one family of shapes that stands for boxes and cylinders alike.

A prism has the numbers ``(hx, hy, hz, r)`` [m]: a box of half extents ``hx, hy, hz`` whose horizontal outline is
rounded outwards by ``r``. A box has ``r = 0``, an upright cylinder ``hx = hy = 0``. One formula serves both, so shapes
are data of a compiled program. A pose is a rotation ``R`` and the center ``p`` in the world.

The signed distance of a point with coordinates ``(x, y, z)`` in the prism's frame follows from two steps of the same
kind. With the distance ``q(a, b)`` of a point ``(a, b)`` in the plane from the quadrant ``a <= 0, b <= 0``,

    q(a, b) = |(max(a, 0), max(b, 0))|  outside of the quadrant,        max(a, b)  inside,
    horizontal = q(|x| - hx, |y| - hy) - r,
    vertical = |z| - hz,
    distance = q(horizontal, vertical).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    TINY,
    Components,
    Rotation,
    Scalar,
    SpatialVector,
    Vector,
    materialize,
    rotate,
    rotate_back,
    vector,
)
from dvr_jax.geometry.wrenches import upward_wrench

Prism = Float[Array, "4 *#batch"]
"""Half extents ``hx, hy, hz`` and rounding ``r`` of a prism [m]."""


class _QuadrantDistance(NamedTuple):
    """Signed distance of points (a, b) in the plane from the quadrant ``a <= 0, b <= 0``, and its gradient."""

    distance: Scalar
    """Positive outside, negative inside [m]."""

    by_a: Scalar
    """Derivative by a. The gradient (by_a, by_b) is a unit vector."""

    by_b: Scalar
    """Derivative by b."""


def point_prism(point: Vector, prism: Prism) -> tuple[Scalar, Components]:
    """Signed distance of points from prisms, exact outside and inside, and its gradient.

    Args:
        point: Points in the prism's own frame [m].
        prism: Shapes.

    Returns:
        Distances [m], and the components of their gradients in the prism's frame. A gradient is a unit vector: that of
        the nearest face where the point is inside.
    """
    excess_x = jnp.abs(point[0]) - prism[0]
    excess_y = jnp.abs(point[1]) - prism[1]
    outline = _quadrant_distance(excess_x, excess_y)
    horizontal = outline.distance - prism[3]
    vertical = jnp.abs(point[2]) - prism[2]
    surface = _quadrant_distance(horizontal, vertical)

    # Not `sign`, which is 0 on the planes between two faces.
    sign_x, sign_y, sign_z = (jnp.where(x < 0, -1, 1) for x in point)
    gradient = (
        surface.by_a * outline.by_a * sign_x,
        surface.by_a * outline.by_b * sign_y,
        surface.by_b * sign_z,
    )
    return surface.distance, gradient


def _quadrant_distance(a: Scalar, b: Scalar) -> _QuadrantDistance:
    """The function q of the module's docstring."""
    beyond_a = jnp.maximum(a, 0)
    beyond_b = jnp.maximum(b, 0)
    square = beyond_a * beyond_a + beyond_b * beyond_b
    outside = square > TINY * TINY
    length = jnp.sqrt(jnp.where(outside, square, 1))

    # Inside, the side that is nearer alone counts.
    a_is_nearer = a > b
    by_a = jnp.where(outside, beyond_a / length, a_is_nearer)
    by_b = jnp.where(outside, beyond_b / length, ~a_is_nearer)
    return _QuadrantDistance(jnp.where(outside, length, jnp.maximum(a, b)), by_a, by_b)


def prism_support(R: Rotation, prism: Prism, direction: Vector) -> Vector:
    """Support point of prisms: their point that is farthest along a direction.

    In the prism's frame, with ``m = R^T direction``, it is

        (sign(m_x) hx, sign(m_y) hy, sign(m_z) hz) + r (m_x, m_y, 0) / |(m_x, m_y)|.

    Args:
        R: Rotations of the prisms.
        prism: Shapes.
        direction: Directions in the world, of any length.

    Returns:
        Points in the world, relative to the prism's center [m].
    """
    m = rotate_back(R, direction)
    inverse = 1 / jnp.sqrt(m[0] * m[0] + m[1] * m[1] + TINY * TINY)
    local = (
        jnp.sign(m[0]) * prism[0] + prism[3] * m[0] * inverse,
        jnp.sign(m[1]) * prism[1] + prism[3] * m[1] * inverse,
        jnp.sign(m[2]) * prism[2],
    )
    return rotate(R, local)


def prism_plane(R: Rotation, p: Vector, prism: Prism) -> tuple[Scalar, SpatialVector]:
    """Signed distance and wrench of prisms above the plane z = 0, whose normal is +z.

    Args:
        R: Rotations of the prisms.
        p: Centers of the prisms [m].
        prism: Shapes.

    Returns:
        Distances [m] and wrenches.
    """
    zero = jnp.zeros_like(p[0])
    down = vector(zero, zero, zero - 1)
    lowest = materialize(p + prism_support(R, prism, down))
    return lowest[2], upward_wrench(lowest)
