"""Signed distances between capsules, prisms and the table plane, with the contact wrench of each.

Shapes. A *capsule* is a segment with a radius. A *prism* stands for boxes and cylinders alike: half extents ``(hx,
hy, hz, r)``, a box of half extents ``hx, hy, hz`` whose horizontal outline is rounded outwards by ``r``. A box has
``r = 0``, an upright cylinder ``hx = hy = 0``. One formula serves both, so shapes are data and no branch is taken on
them.

Every distance is positive apart and negative in penetration [m]. Each comes with a contact point ``c`` and a unit
normal ``n`` (world frame, pointing from the second body to the first), returned as the *wrench* ``w = (c x n, n)``
about the world's origin. For twists ``V1, V2`` of the two bodies

    d(distance)/dt = w . (V1 - V2),

which is all that a Jacobian needs: one wrench times the bodies' twist Jacobians.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import (
    TINY,
    Rotation,
    Six,
    Vector,
    add,
    cross,
    dot,
    materialize,
    normalize,
    rotate,
    rotate_back,
    scale,
    select,
    subtract,
)

Prism = tuple[Array, Array, Array, Array]
"""Half extents ``hx, hy, hz`` and rounding ``r`` [m]."""


def _wrench(point: Vector, normal: Vector) -> Six:
    return (*cross(point, normal), *normal)


def capsule_capsule(
    a0: Vector, a1: Vector, ra: Array | float, b0: Vector, b1: Vector, rb: Array | float
) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules with segment ends ``a0, a1`` and ``b0, b1``.

    Exact wherever the two segments do not cross. (Closest points of segments: Ericson, Real-Time Collision Detection,
    sec. 5.1.9.)"""
    da, db, r = subtract(a1, a0), subtract(b1, b0), subtract(a0, b0)
    aa, bb, ab = dot(da, da), dot(db, db), dot(da, db)
    ar, br = dot(da, r), dot(db, r)
    denominator = aa * bb - ab * ab
    parallel = denominator <= 1e-9 * aa * bb
    s = jnp.clip(jnp.where(parallel, 0.5, (ab * br - ar * bb) / jnp.where(parallel, 1, denominator)), 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s = jnp.clip((ab * t - ar) / aa, 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s, t = materialize((s, t))
    pa, pb = add(a0, scale(s, da)), add(b0, scale(t, db))
    between = subtract(pa, pb)
    length = jnp.sqrt(dot(between, between) + TINY * TINY)
    n = scale(1 / length, between)
    return length - ra - rb, _wrench(pb, n)


def capsule_plane(a0: Vector, a1: Vector, radius: Array | float) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules above the plane ``z = 0``; the normal is +z."""
    lower = select(a0[2] < a1[2], a0, a1)
    zero = jnp.zeros_like(lower[2])
    return lower[2] - radius, _wrench(lower, (zero, zero, zero + 1))


def point_prism(p: Vector, half: Prism) -> tuple[Array, Vector]:
    """Signed distance and its gradient for points in the prism's own frame.

    Exact outside and inside; the gradient is a unit vector, that of the nearest face where the point is inside."""
    qx, qy = jnp.abs(p[0]) - half[0], jnp.abs(p[1]) - half[1]
    px, py = jnp.maximum(qx, 0), jnp.maximum(qy, 0)
    rho = jnp.sqrt(px * px + py * py)
    outside = rho > TINY
    inverse = 1 / jnp.where(outside, rho, 1)
    x_nearer = qx > qy
    ex = jnp.where(outside, px * inverse, x_nearer)
    ey = jnp.where(outside, py * inverse, ~x_nearer)
    horizontal = jnp.where(outside, rho, jnp.maximum(qx, qy)) - half[3]
    vertical = jnp.abs(p[2]) - half[2]
    h, v = jnp.maximum(horizontal, 0), jnp.maximum(vertical, 0)
    length = jnp.sqrt(h * h + v * v)
    outside = length > TINY
    inverse = 1 / jnp.where(outside, length, 1)
    side_nearer = horizontal > vertical
    wh = jnp.where(outside, h * inverse, side_nearer)
    wv = jnp.where(outside, v * inverse, ~side_nearer)
    distance = jnp.where(outside, length, jnp.maximum(horizontal, vertical))
    gradient = (wh * ex * jnp.sign(p[0]), wh * ey * jnp.sign(p[1]), wv * jnp.sign(p[2]))
    return distance, gradient


def capsule_prism(
    a0: Vector, a1: Vector, radius: Array | float, R: Rotation, p: Vector, half: Prism, rounds: int = 6
) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules to prisms with pose ``R, p``.

    The distance of a point to a convex body is convex along the segment, so its minimum is bracketed by the sign of
    the slope: ``rounds`` pairs of one false-position and one bisection step, and one more false position. Outside,
    the slope of the squared distance to a box is piecewise linear and false position ends on its root exactly. An
    error e in the position on the segment costs the order of e^2 in the distance. Where the capsule's *axis* enters
    the prism, the depth is that of the axis' deepest point."""
    b0 = rotate_back(R, subtract(a0, p))
    b0, d = materialize((b0, subtract(rotate_back(R, subtract(a1, p)), b0)))

    def slope(t: Array) -> Array:
        distance, gradient = point_prism(add(b0, scale(t, d)), half)
        return dot(gradient, d) * jnp.maximum(distance, 1e-3)

    zero = jnp.zeros_like(d[0] + half[0])

    def false_position(low: Array, high: Array, slope_low: Array, slope_high: Array) -> Array:
        gap = slope_high - slope_low
        return jnp.clip(low - slope_low * (high - low) / jnp.where(gap > 0, gap, 1), low, high)

    def shrink(bracket: tuple[Array, Array, Array, Array], middle: Array) -> tuple[Array, Array, Array, Array]:
        low, high, slope_low, slope_high = bracket
        value = materialize(slope(middle))
        left = value <= 0
        return (
            jnp.where(left, middle, low), jnp.where(left, high, middle),
            jnp.where(left, value, slope_low), jnp.where(left, slope_high, value),
        )  # fmt: skip

    def one_round(_: int, bracket: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        bracket = shrink(bracket, false_position(*bracket))
        return shrink(bracket, 0.5 * (bracket[0] + bracket[1]))

    ends = (zero, zero + 1, slope(zero), slope(zero + 1))
    bracket = jax.lax.fori_loop(0, rounds, one_round, ends)
    t = jnp.where(ends[2] >= 0, 0, jnp.where(ends[3] <= 0, 1, false_position(*bracket)))
    t = materialize(t)
    distance, gradient = materialize(point_prism(add(b0, scale(t, d)), half))
    nearest = add(a0, scale(t, subtract(a1, a0)))
    return distance - radius, _wrench(nearest, rotate(R, gradient))


def prism_support(R: Rotation, half: Prism, n: Vector) -> Vector:
    """Support point of prisms relative to their centre: ``argmax_{x in prism} n . x`` in the world frame."""
    m = rotate_back(R, n)
    inverse = 1 / jnp.sqrt(m[0] * m[0] + m[1] * m[1] + TINY * TINY)
    local = (
        jnp.sign(m[0]) * half[0] + half[3] * m[0] * inverse,
        jnp.sign(m[1]) * half[1] + half[3] * m[1] * inverse,
        jnp.sign(m[2]) * half[2],
    )
    return rotate(R, local)


def prism_plane(R: Rotation, p: Vector, half: Prism) -> tuple[Array, Six]:
    """Signed distance and wrench of prisms above the plane ``z = 0``."""
    zero = jnp.zeros_like(p[0])
    up = (zero, zero, zero + 1)
    lowest = add(p, prism_support(R, half, scale(-1.0, up)))
    return lowest[2], _wrench(lowest, up)


def prism_prism(
    R_a: Rotation, p_a: Vector, half_a: Prism, R_b: Rotation, p_b: Vector, half_b: Prism, refinements: int = 3
) -> tuple[Array, Six]:
    """Separation and wrench of two prisms.

    The separation is the largest gap over the separating axes of two boxes (Gottschalk 1996: 6 face normals, 9 edge
    products), the directions in which two upright cylinders separate, and ``refinements`` further ones. It never
    exceeds the signed distance, so "apart" is always true; it equals it for boxes that touch or penetrate and where a
    face is nearest; past a corner it is smaller. For boxes its sign is that of the distance; tilted cylinders up to 2
    cm apart may seem to touch."""
    center = subtract(p_a, p_b)
    edges = [cross(R_a[i], R_b[j]) for i in range(3) for j in range(3)]
    # Two upright cylinders separate along the line between their axes.
    between = [subtract(center, scale(dot(center, R[2]), R[2])) for R in (R_a, R_b)]
    # The candidate axes lead as one more batch axis and share one evaluation: that keeps the compiled program small.
    axes: Vector = tuple(jnp.stack([axis[i] for axis in (*R_a, *R_b, *edges, *between)]) for i in range(3))  # type: ignore[assignment]
    length = jnp.sqrt(dot(axes, axes) + TINY * TINY)
    n = materialize(scale(jnp.where(dot(axes, center) < 0, -1, 1) / length, axes))

    def gap(n: Vector) -> Array:
        """Gap between the prisms along unit vectors from B to A."""
        support = subtract(prism_support(R_a, half_a, scale(-1.0, n)), prism_support(R_b, half_b, n))
        return dot(n, add(center, support))

    gaps = materialize(jnp.where(length > 1e-4, gap(n), -jnp.inf))
    best = jnp.argmax(gaps, axis=0)
    separation = jnp.max(gaps, axis=0)

    def chosen(candidates: Array, index: Array) -> Array:
        return jnp.take_along_axis(candidates, index[None], axis=0)[0]

    normal: Vector = (chosen(n[0], best), chosen(n[1], best), chosen(n[2], best))

    # Gilbert's iteration toward the point of the difference body A - B nearest to the origin: each direction that it
    # visits is one more candidate axis. Corners and the curved side of tilted cylinders need it.
    v, refined = center, jnp.zeros(separation.shape, bool)
    for _ in range(refinements):
        m = normalize(v)
        w = add(center, subtract(prism_support(R_a, half_a, scale(-1.0, m)), prism_support(R_b, half_b, m)))
        value = dot(m, w)
        # Where the bodies overlap v shrinks to zero: that is no direction.
        better = (value > separation) & (dot(v, v) > 1e-12)
        separation, normal, refined = jnp.where(better, value, separation), select(better, m, normal), refined | better
        edge = subtract(v, w)
        v = subtract(v, scale(jnp.clip(dot(v, edge) / jnp.maximum(dot(edge, edge), TINY), 0, 1), edge))
        v, separation, normal, refined = materialize((v, separation, normal, refined))

    # Where the contact is: a face of A touches B's support point and conversely; two edges touch where their lines
    # are nearest.
    corner_a = add(p_a, prism_support(R_a, half_a, scale(-1.0, normal)))
    corner_b = add(p_b, prism_support(R_b, half_b, normal))
    i, j = jnp.clip(best - 6, 0, 8) // 3, jnp.clip(best - 6, 0, 8) % 3
    da = select(i == 0, R_a[0], select(i == 1, R_a[1], R_a[2]))
    db = select(j == 0, R_b[0], select(j == 1, R_b[1], R_b[2]))
    offset, slant = subtract(corner_b, corner_a), dot(da, db)
    along = (dot(offset, da) - slant * dot(offset, db)) / jnp.maximum(1 - slant * slant, 1e-8)
    is_edge = (best >= 6) & (best < 15) & ~refined
    face_of_b = (best >= 3) & (best < 6) & ~refined
    point = select(is_edge, add(corner_a, scale(along, da)), select(face_of_b, corner_a, corner_b))
    return separation, _wrench(point, normal)
