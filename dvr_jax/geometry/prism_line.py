"""How the distance to a prism changes along a line: its slope, and where it has kinks.

These are what the search for the nearest point of a capsule's axis needs (`dvr_jax.geometry.capsule_prism`). All
vectors are in the frame of the prism. For kinks, a prism is either a box (``r = 0``) or a cylinder (``hx = hy = 0``).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.prisms import Prism
from dvr_jax.geometry.vectors import TINY, Scalar, Vector

DEPTH_SCALE = 1e-3
"""Factor of the slope at points inside a prism [m]: there the distance counts as 1 mm."""


class Line(NamedTuple):
    """A capsule's axis in the frame of a prism: the points ``start + t direction`` with t in [0, 1]."""

    start: Vector
    """First end of the axis [m]."""

    direction: Vector
    """Vector from the first end to the second [m]."""

    prism: Prism
    """Shape of the prism."""


def slope_along(point: Vector, direction: Vector, prism: Prism) -> Scalar:
    """Slope along a direction of half the squared distance to a prism.

    With the horizontal and the vertical distance h and v as in `dvr_jax.geometry.prisms`, and their slopes h' and v',
    it is

        max(h, 0) h' + max(v, 0) v'    outside,
        DEPTH_SCALE h' or DEPTH_SCALE v'    inside, by the nearer face.

    Inside, it is only a number that has the sign of the distance's slope.
    """
    excess_x, excess_y, vertical = (
        jnp.abs(x) - half for x, half in zip(point, prism[:3], strict=True)
    )
    slope_x, slope_y, slope_z = (
        jnp.sign(x) * along for x, along in zip(point, direction, strict=True)
    )

    beyond_x = jnp.maximum(excess_x, 0)
    beyond_y = jnp.maximum(excess_y, 0)
    square = beyond_x * beyond_x + beyond_y * beyond_y
    length = jnp.sqrt(square + TINY * TINY)
    horizontal = jnp.where(square > 0, length, jnp.maximum(excess_x, excess_y)) - prism[3]
    slope_horizontal = jnp.where(
        square > 0,
        (beyond_x * slope_x + beyond_y * slope_y) / length,
        jnp.where(excess_x > excess_y, slope_x, slope_y),
    )

    outside = jnp.maximum(horizontal, 0) * slope_horizontal + jnp.maximum(vertical, 0) * slope_z
    inside = jnp.where(horizontal > vertical, slope_horizontal, slope_z)
    return jnp.where(jnp.maximum(horizontal, vertical) > 0, outside, DEPTH_SCALE * inside)


def kinks(line: Line) -> Float[Array, "6 *#batch"]:
    """Positions on a line where the distance to a prism has a kink.

    These are the six planes of a box. Of a cylinder they are its two planes, the two points where the line crosses the
    infinite round side, and the point where the line is nearest to the cylinder's axis.
    """
    start = line.start
    direction = line.direction
    prism = line.prism

    # The crossings with a round side solve the quadratic equation (x + t dx)^2 + (y + t dy)^2 = r^2.
    square = direction[0] * direction[0] + direction[1] * direction[1]
    nearest = _quotient(-(start[0] * direction[0] + start[1] * direction[1]), square)
    chord = nearest * nearest - _quotient(
        start[0] * start[0] + start[1] * start[1] - prism[3] * prism[3], square
    )
    chord = jnp.sqrt(jnp.maximum(chord, 0))
    of_cylinder = (nearest - chord, nearest, nearest + chord, nearest)

    of_box = (*_plane_crossings(line, 0), *_plane_crossings(line, 1))
    sides = [jnp.where(prism[3] > 0, a, b) for a, b in zip(of_cylinder, of_box, strict=True)]
    return jnp.stack(jnp.broadcast_arrays(*_plane_crossings(line, 2), *sides))


def _plane_crossings(line: Line, axis: int) -> tuple[Scalar, Scalar]:
    """Positions where a line crosses the two faces of a box that are normal to an axis."""
    start = line.start
    direction = line.direction
    prism = line.prism
    at_lower_face = _quotient(-prism[axis] - start[axis], direction[axis])
    at_upper_face = _quotient(prism[axis] - start[axis], direction[axis])
    return at_lower_face, at_upper_face


def _quotient(a: Scalar, b: Scalar) -> Scalar:
    """The quotient a / b, finite where b is zero."""
    return a / jnp.where(jnp.abs(b) > TINY, b, TINY)
