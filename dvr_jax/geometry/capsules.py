"""Signed distances of capsules from each other and from the table plane.

A *capsule* is a segment with a radius: all points that are at most the radius away from the segment. The segment is
never a single point. The convention of signed distances and wrenches is that of `dvr_jax.geometry.wrenches`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from dvr_jax.geometry.vectors import TINY, Scalar, SpatialVector, Vector, dot, materialize
from dvr_jax.geometry.wrenches import contact_wrench, upward_wrench

PARALLEL = 1e-9
"""Segments count as parallel where the squared sine of their angle is at most this."""


class NearestPoints(NamedTuple):
    """The nearest points of two segments."""

    between: Vector
    """Vector from the second segment's nearest point to the first segment's [m]."""

    on_second: Vector
    """Nearest point of the second segment [m]."""


def capsule_capsule(
    a0: Vector,
    a1: Vector,
    radius_a: Scalar | float,
    b0: Vector,
    b1: Vector,
    radius_b: Scalar | float,
) -> tuple[Scalar, SpatialVector]:
    """Signed distance and wrench of two capsules, exact wherever the two segments do not cross.

    Args:
        a0: First end of the first capsule's segment [m].
        a1: Second end of the first capsule's segment [m].
        radius_a: Radius of the first capsule [m].
        b0: First end of the second capsule's segment [m].
        b1: Second end of the second capsule's segment [m].
        radius_b: Radius of the second capsule [m].

    Returns:
        Distances [m] and wrenches.
    """
    nearest = nearest_points(a0, a1, b0, b1)
    length = materialize(_length(nearest.between))
    on_second = materialize(nearest.on_second)
    return length - radius_a - radius_b, contact_wrench(on_second, nearest.between / length)


def capsule_capsule_distance(
    a0: Vector,
    a1: Vector,
    radius_a: Scalar | float,
    b0: Vector,
    b1: Vector,
    radius_b: Scalar | float,
) -> Scalar:
    """Signed distance of two capsules without the wrench.

    Args:
        a0: First end of the first capsule's segment [m].
        a1: Second end of the first capsule's segment [m].
        radius_a: Radius of the first capsule [m].
        b0: First end of the second capsule's segment [m].
        b1: Second end of the second capsule's segment [m].
        radius_b: Radius of the second capsule [m].

    Returns:
        Distances [m], those of `capsule_capsule`.
    """
    return _length(nearest_points(a0, a1, b0, b1).between) - radius_a - radius_b


def capsule_plane(a0: Vector, a1: Vector, radius: Scalar | float) -> tuple[Scalar, SpatialVector]:
    """Signed distance and wrench of capsules above the plane z = 0, whose normal is +z.

    Args:
        a0: First end of the segment [m].
        a1: Second end of the segment [m].
        radius: Radius of the capsule [m].

    Returns:
        Distances [m] and wrenches.
    """
    lower = jnp.where(a0[2] < a1[2], a0, a1)
    return lower[2] - radius, upward_wrench(lower)


def _length(a: Vector) -> Scalar:
    """Length of a vector, never quite zero."""
    return jnp.sqrt(dot(a, a) + TINY * TINY)


def nearest_points(a0: Vector, a1: Vector, b0: Vector, b1: Vector) -> NearestPoints:
    """Nearest points of two segments.

    The points are ``A(s) = a0 + s da`` and ``B(t) = b0 + t db`` with s and t in [0, 1]. With ``r = a0 - b0`` and with
    inner products written as products, the distance of the two lines is least at

        s = ((da db) (db r) - (da r) (db db)) / ((da da) (db db) - (da db)^2),

    and on one line it is least, for a given point of the other line, at

        t = ((da db) s + db r) / (db db),        s = ((da db) t - da r) / (da da).

    So s is clipped to its segment, then t follows and is clipped, and then s and t are computed once more.

    Source: C. Ericson, Real-Time Collision Detection, 2005, section 5.1.9.

    Args:
        a0: First end of the first segment [m].
        a1: Second end of the first segment [m].
        b0: First end of the second segment [m].
        b1: Second end of the second segment [m].
    """
    da = a1 - a0
    db = b1 - b0
    r = a0 - b0
    aa, bb, ab, ar, br = materialize(
        (dot(da, da), dot(db, db), dot(da, db), dot(da, r), dot(db, r))
    )

    # Parallel lines are equally near everywhere: start in the middle.
    denominator = aa * bb - ab * ab
    parallel = denominator <= PARALLEL * aa * bb
    s = jnp.clip(
        jnp.where(parallel, 0.5, (ab * br - ar * bb) / jnp.where(parallel, 1, denominator)), 0, 1
    )

    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s = materialize(jnp.clip((ab * t - ar) / aa, 0, 1))
    t = materialize(jnp.clip((ab * s + br) / bb, 0, 1))
    return NearestPoints(materialize(r + s * da - t * db), b0 + t * db)
