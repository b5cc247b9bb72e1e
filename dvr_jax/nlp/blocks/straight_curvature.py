r"""Second derivatives of the rows of straight motions (`dvr_jax.nlp.blocks.straight_motion`).

A row of position is ``f . (p - p_n)`` with a vector f that is fixed in the near hand, or in the world for a vertical
motion. In the frame of the near hand, the chain that moves the point p consists of the near joints in reverse order and
with opposite signs, then of the joints at the point. In the world, p and p_n have a chain of their own.

The rows of rotation are 2 e of ``R R_n^T``. Where the hand hardly turns, their second derivatives are those of the two
rotation vectors, less

    1/2 (omega_i x omega_j + omega_j x omega_i),      i a joint at the point and j a near joint.

A sample at the part s of the way from the near slice has the joint angles ``(1 - s) q_near + s q_far``.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.chain_curvature import pair_products, point_curvature, turn_curvature
from dvr_jax.geometry.vectors import Rotation, Vector, cross
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.system import Curvature


class MotionEnds(NamedTuple):
    """The hand of each straight motion at its near slice and at M points; all batch axes are (B, K, 2, M)."""

    near_rotation: Rotation
    """Axes of the hand at the near slice."""

    near_position: Vector
    """Its position there [m]."""

    near_screws: Float[Array, "6 joints batch phases 2 points"]
    """Twists of all joints at the near slice; zero for those of other arms."""

    rotation: Rotation
    """Axes of the hand at the points."""

    position: Vector
    """Its position at the points [m]."""

    screws: Float[Array, "6 joints batch phases 2 points"]
    """Twists of all joints at the points; zero for those of other arms."""

    axes: Rotation
    """Axes of the motion."""

    is_vertical: Bool[Array, "batch phases 2 1"]
    """Whether these axes are fixed in the world."""

    share: Float[Array, "batch phases 2 points"]
    """The part of a point's motion that is due to the far slice."""


def straight_curvature(
    ends: MotionEnds, force: Vector, moment: Vector, slices: tuple[np.ndarray, np.ndarray], T: int
) -> Curvature:
    """Return the second derivatives of all rows times their multipliers.

    Args:
        ends: Poses of the hands, and twists of their joints.
        force: Sum of the axes times the multipliers of the position rows (3, B, K, 2, M).
        moment: Multipliers of the rotation rows (3, B, K, 2, M).
        slices: Near and far slices (K, 2).
        T: Number of slices.
    """
    near, point, both = _at_points(ends, force, moment)
    share = ends.share
    rest = 1 - share
    by_near = (near + rest**2 * point + rest * (both + both.swapaxes(0, 1))).sum(-1)
    by_far = (share**2 * point).sum(-1)
    by_both = (share * (rest * point + both)).sum(-1)
    by_near, by_far, by_both = (
        jnp.moveaxis(value, (0, 1), (-2, -1)) for value in (by_near, by_far, by_both)
    )

    # The far slice of a leaving motion (0) is the later one of the two, that of a coming motion (1) the earlier one.
    B = by_near.shape[0]
    D = by_near.shape[-1]
    near_slice, far_slice = slices
    nothing = jnp.zeros((B, T, D, D), by_near.dtype)
    coupling = nothing.at[:, far_slice[:, 0]].add(by_both[:, :, 0].swapaxes(-1, -2))
    parameters = PARAMETERS * by_near.shape[1]
    return Curvature(
        diagonal=nothing.at[:, near_slice].add(by_near).at[:, far_slice].add(by_far),
        coupling=coupling.at[:, near_slice[:, 1]].add(by_both[:, :, 1]),
        border=jnp.zeros((B, T, D, parameters), by_near.dtype),
        corner=jnp.zeros((B, parameters, parameters), by_near.dtype),
    )


def _at_points(ends: MotionEnds, force: Vector, moment: Vector) -> tuple[Array, Array, Array]:
    """Return the second derivatives (D, D, B, K, 2, M) by near joints, by joints at the point, and by one of each."""
    D = ends.screws.shape[1]
    near_turn = ends.near_screws[:3]
    in_order = jnp.asarray(np.triu(np.ones((D, D), bool))).reshape(D, D, 1, 1, 1, 1)
    in_reverse = in_order.swapaxes(0, 1)
    point_velocity = ends.screws[3:] + cross(ends.screws[:3], ends.position[:, None])

    in_hand = point_curvature(ends.near_screws, force, ends.position, in_reverse)
    in_world = point_curvature(ends.near_screws, force, ends.near_position, in_order)
    near = jnp.where(ends.is_vertical, -in_world, in_hand)
    near -= turn_curvature(ends.near_screws, moment, in_order)

    point = point_curvature(ends.screws, force, ends.position, in_order)
    point += turn_curvature(ends.screws, moment, in_order)

    both = -pair_products(cross(force[:, None], near_turn), point_velocity)
    both = jnp.where(ends.is_vertical, 0, both)
    turned = pair_products(0.5 * cross(moment[:, None], ends.screws[:3]), near_turn)
    return near, point, both - turned.swapaxes(0, 1)
