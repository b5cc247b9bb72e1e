"""By how much the footprint of a prism covers a rectangle, by the separating axis theorem, with its derivatives.

The footprint is a rectangle of half extents h with corners rounded outwards by r; the other rectangle has half extents
s. Their sides have four directions. With the offset d of the two centers in the frame of one of them, and with the
angle a between both, the footprints are apart along the axis x of the rectangle by

    |d_x| - s_x - (h_x |cos a| + h_y |sin a|) - r,

and along the axes of the footprint by the same formula with h and s exchanged. The largest of the four is a lower bound
of the distance, and it is the exact depth of an overlap if r = 0. A round footprint counts as its bounding square at
the corners of the rectangle, which is on the safe side.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array


def intrusion(
    m: Float[Array, "4 *#batch"],
    outline: Float[Array, "3 *#batch"],
    rectangle: Float[Array, "5 *#batch"],
) -> tuple[Float[Array, "*#batch"], Float[Array, "4 *#batch"]]:
    """Compute by how much footprints cover rectangles, and the derivatives by the footprints' poses.

    Args:
        m: Pose of each footprint: center x, y [m], yaw [rad]; the fourth number has no meaning.
        outline: Half extents hx, hy and rounding r of each footprint [m].
        rectangle: Center x, y [m], yaw [rad] and half extents [m] of each rectangle.

    Returns:
        Minus the largest gap [m]: positive where the footprint covers a part of the rectangle. Its derivatives by m.
    """
    turn = m[2] - rectangle[2]
    own_axes = _gaps(m, rectangle[2], rectangle[3:], outline[:2], turn, rectangle)
    their_axes = _gaps(m, m[2], outline[:2], rectangle[3:], turn, rectangle, turns=True)
    gaps = jnp.concatenate([own_axes[0], their_axes[0]]) - outline[2]
    slopes = jnp.concatenate([own_axes[1], their_axes[1]])

    widest = jnp.argmax(gaps, axis=0)[None]
    gap = jnp.take_along_axis(gaps, widest, axis=0)[0]
    slope = jnp.take_along_axis(
        slopes, jnp.broadcast_to(widest[:, None], (1, *slopes.shape[1:])), axis=0
    )[0]
    return -gap, -slope


def _gaps(
    m: Array,
    yaw: Array,
    near: Array,
    far: Array,
    turn: Array,
    rectangle: Array,
    turns: bool = False,
) -> tuple[Float[Array, "2 *#batch"], Float[Array, "2 4 *#batch"]]:
    """Compute the gaps along the two axes of one body, without the rounding, and their derivatives by m.

    Args:
        m: Pose of the footprint.
        yaw: Direction of the first axis in the world [rad].
        near: Half extents of the body whose axes these are [m].
        far: Half extents of the other body [m].
        turn: Angle between both bodies [rad].
        rectangle: The rectangle; its first two numbers are its center.
        turns: Whether the axes turn with the footprint.
    """
    dx = m[0] - rectangle[0]
    dy = m[1] - rectangle[1]
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    along, across = c * dx + s * dy, c * dy - s * dx
    sign_along = jnp.where(along < 0, -1.0, 1.0)
    sign_across = jnp.where(across < 0, -1.0, 1.0)

    # Reach of the other body along both axes, and its derivative by the angle.
    ct, st = jnp.cos(turn), jnp.sin(turn)
    slope_c = -st * jnp.sign(ct)
    slope_s = ct * jnp.sign(st)
    reach = [
        far[0] * jnp.abs(ct) + far[1] * jnp.abs(st),
        far[0] * jnp.abs(st) + far[1] * jnp.abs(ct),
    ]
    reach_by_yaw = [far[0] * slope_c + far[1] * slope_s, far[0] * slope_s + far[1] * slope_c]

    # An axis that turns with the footprint sees the offset turn the other way.
    offset_by_yaw = [across, -along] if turns else [0.0 * along, 0.0 * across]
    gaps = []
    slopes = []
    rows = ((along, sign_along, c, s), (across, sign_across, -s, c))
    for axis, (offset, sign, by_x, by_y) in enumerate(rows):
        gaps.append(jnp.abs(offset) - near[axis] - reach[axis])
        by_yaw = sign * offset_by_yaw[axis] - reach_by_yaw[axis]
        parts = jnp.broadcast_arrays(sign * by_x, sign * by_y, by_yaw, 0.0 * by_yaw)
        slopes.append(jnp.stack(parts))
    batch = jnp.broadcast_shapes(gaps[0].shape, gaps[1].shape)
    shape = jnp.broadcast_shapes(slopes[0].shape, slopes[1].shape, (4, *batch))
    return (
        jnp.stack([jnp.broadcast_to(gap, batch) for gap in gaps]),
        jnp.stack([jnp.broadcast_to(slope, shape) for slope in slopes]),
    )
