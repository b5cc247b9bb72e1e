"""Contact wrenches: how a signed distance changes as two bodies move.

All distance functions of this package share one convention. A signed distance is positive apart and negative in
penetration [m]. It comes with a contact point ``c`` and a unit normal ``n``, both in the world frame; the normal points
from the second body to the first. They are returned as one wrench about the world's origin,

    w = (c x n, n).

For twists ``V1`` and ``V2`` of the two bodies,

    d(distance)/dt = w . (V1 - V2),

so a Jacobian of the distance needs nothing else: it is the wrench times the Jacobians of the bodies' twists.
"""

from __future__ import annotations

import jax.numpy as jnp

from dvr_jax.geometry.vectors import SpatialVector, Vector, cross


def contact_wrench(point: Vector, normal: Vector) -> SpatialVector:
    """Wrench of a unit force along the contact normal.

    Args:
        point: Contact point in the world [m].
        normal: Unit normal from the second body to the first.

    Returns:
        The moment about the world's origin [m], then the normal.
    """
    return jnp.concatenate(
        [cross(point, normal), jnp.broadcast_to(normal, (3, *jnp.shape(point)[1:]))]
    )


def upward_wrench(point: Vector) -> SpatialVector:
    """Wrench of a unit force along +z at a point in the world [m]."""
    zero = jnp.zeros_like(point[0])
    return jnp.stack([point[1], -point[0], zero, zero, zero, zero + 1])
