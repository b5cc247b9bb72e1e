r"""Second derivatives of points and orientations that a chain of variables moves.

A *column* is the twist (omega, v) of a body at unit rate of one variable. Along a chain, a variable moves all columns
that come after it. A point p that moves with the last body has the velocities ``u_j = omega_j x p + v_j``, and for a
variable i that comes before j, or is j itself,

    d^2 p / dx_i dx_j = omega_i x u_j.

The rotation vector of the last body, measured from where the body is, has the second derivatives

    d^2 phi / dx_i dx_j = 1/2 omega_i x omega_j        for i before j.

Both follow from R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section 2.11: a twist that is carried by another
one changes by their cross product.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Vector, cross


def pair_products(
    a: Float[Array, "3 i *#batch"], b: Float[Array, "3 j *#batch"]
) -> Float[Array, "i j *#batch"]:
    """Return the inner products of all vectors of two sets.

    Args:
        a: The first set, one vector for each i.
        b: The second set, one vector for each j.
    """
    return sum(a[k][:, None] * b[k][None] for k in range(3))  # type: ignore[return-value]


def point_curvature(
    columns: Float[Array, "6 columns *#batch"],
    force: Vector,
    point: Float[Array, "3 *#batch"],
    is_before: Bool[Array, "columns columns *#batch"],
) -> Float[Array, "columns columns *#batch"]:
    """Return the second derivatives of ``force . p``, a symmetric matrix.

    Args:
        columns: Twists of the variables.
        force: The vector that the point is multiplied by.
        point: The point p [m]; it may have an axis of columns, where they move different points.
        is_before: Whether variable i comes before variable j, or is the same.
    """
    points = point if point.ndim == columns.ndim else point[:, None]
    turn = columns[:3]
    velocity = columns[3:] + cross(turn, points)
    in_order = pair_products(cross(force[:, None], turn), velocity)
    return jnp.where(is_before, in_order, jnp.swapaxes(in_order, 0, 1))


def turn_curvature(
    columns: Float[Array, "6 columns *#batch"],
    moment: Vector,
    is_before: Bool[Array, "columns columns *#batch"],
) -> Float[Array, "columns columns *#batch"]:
    """Return the second derivatives of ``moment . phi`` with the rotation vector phi, a symmetric matrix.

    Args:
        columns: Twists of the variables.
        moment: The vector that the rotation vector is multiplied by.
        is_before: Whether variable i comes before variable j, or is the same.
    """
    turn = columns[:3]
    in_order = 0.5 * pair_products(cross(moment[:, None], turn), turn)
    return jnp.where(is_before, in_order, jnp.swapaxes(in_order, 0, 1))
