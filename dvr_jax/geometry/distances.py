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
    cross,
    dot,
    materialize,
    normalize,
    rotate,
    rotate_back,
    vector,
)

Prism = Array
"""(4, ...): half extents ``hx, hy, hz`` and rounding ``r`` [m]."""


def _wrench(point: Vector, normal: Vector) -> Six:
    return jnp.concatenate([cross(point, normal), jnp.broadcast_to(normal, (3, *jnp.shape(point)[1:]))])


def capsule_capsule(
    a0: Vector, a1: Vector, ra: Array | float, b0: Vector, b1: Vector, rb: Array | float
) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules with segment ends ``a0, a1`` and ``b0, b1``.

    Exact wherever the two segments do not cross. (Closest points of segments: Ericson, Real-Time Collision Detection,
    sec. 5.1.9.)"""
    da, db, r = a1 - a0, b1 - b0, a0 - b0
    aa, bb, ab, ar, br = materialize((dot(da, da), dot(db, db), dot(da, db), dot(da, r), dot(db, r)))
    denominator = aa * bb - ab * ab
    parallel = denominator <= 1e-9 * aa * bb
    s = jnp.clip(jnp.where(parallel, 0.5, (ab * br - ar * bb) / jnp.where(parallel, 1, denominator)), 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s = materialize(jnp.clip((ab * t - ar) / aa, 0, 1))
    t = materialize(jnp.clip((ab * s + br) / bb, 0, 1))
    pb = b0 + t * db
    between, pb = materialize((a0 + s * da - pb, pb))
    length = materialize(jnp.sqrt(dot(between, between) + TINY * TINY))
    return length - ra - rb, _wrench(pb, between / length)


def capsule_plane(a0: Vector, a1: Vector, radius: Array | float) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules above the plane ``z = 0``; the normal is +z."""
    lower = jnp.where(a0[2] < a1[2], a0, a1)
    return lower[2] - radius, _lift(lower)


def _lift(point: Vector) -> Six:
    """Wrench of a unit force along +z at a point."""
    zero = jnp.zeros_like(point[0])
    return jnp.stack([point[1], -point[0], zero, zero, zero, zero + 1])


def point_prism(p: Vector, half: Prism) -> tuple[Array, tuple[Array, Array, Array]]:
    """Signed distance and the components of its gradient for points in the prism's own frame.

    Exact outside and inside; the gradient is a unit vector, that of the nearest face where the point is inside."""
    qx, qy = jnp.abs(p[0]) - half[0], jnp.abs(p[1]) - half[1]
    px, py = jnp.maximum(qx, 0), jnp.maximum(qy, 0)
    square = px * px + py * py
    outside = square > TINY * TINY
    rho = jnp.sqrt(jnp.where(outside, square, 1))
    x_nearer = qx > qy
    ex = jnp.where(outside, px / rho, x_nearer)
    ey = jnp.where(outside, py / rho, ~x_nearer)
    horizontal = jnp.where(outside, rho, jnp.maximum(qx, qy)) - half[3]
    vertical = jnp.abs(p[2]) - half[2]
    h, v = jnp.maximum(horizontal, 0), jnp.maximum(vertical, 0)
    square = h * h + v * v
    outside = square > TINY * TINY
    length = jnp.sqrt(jnp.where(outside, square, 1))
    side_nearer = horizontal > vertical
    wh = jnp.where(outside, h / length, side_nearer)
    wv = jnp.where(outside, v / length, ~side_nearer)
    distance = jnp.where(outside, length, jnp.maximum(horizontal, vertical))
    return distance, (wh * ex * jnp.sign(p[0]), wh * ey * jnp.sign(p[1]), wv * jnp.sign(p[2]))


def capsule_prism(
    a0: Vector, a1: Vector, radius: Array | float, R: Rotation, p: Vector, half: Prism, rounds: int = 6
) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules to prisms with pose ``R, p``.

    The distance of a point to a convex body is convex along the segment, so its minimum is bracketed by the sign of
    the slope: ``rounds`` pairs of one false-position and one bisection step, and one more false position. Outside,
    the slope of the squared distance to a box is piecewise linear and false position ends on its root exactly. An
    error e in the position on the segment costs the order of e^2 in the distance outside, and of e inside. Where the
    capsule's *axis* enters the prism, the depth is that of the axis' deepest point."""
    b0, d = materialize((rotate_back(R, a0 - p), rotate_back(R, a1 - a0)))

    def slope(t: Array) -> Array:
        distance, gradient = point_prism(b0 + t * d, half)
        return dot(gradient, d) * jnp.maximum(distance, 1e-3)  # type: ignore[arg-type]

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
    distance, gradient = materialize(point_prism(b0 + t * d, half))
    normal = rotate(R, gradient)  # type: ignore[arg-type]
    return distance - radius, _wrench(*materialize((a0 + t * (a1 - a0), normal)))


def prism_support(R: Rotation, half: Prism, n: Vector) -> Vector:
    """Support point of prisms relative to their centre: ``argmax_{x in prism} n . x`` in the world frame."""
    m = rotate_back(R, n)
    inverse = 1 / jnp.sqrt(m[0] * m[0] + m[1] * m[1] + TINY * TINY)
    local = (
        jnp.sign(m[0]) * half[0] + half[3] * m[0] * inverse,
        jnp.sign(m[1]) * half[1] + half[3] * m[1] * inverse,
        jnp.sign(m[2]) * half[2],
    )
    return rotate(R, local)  # type: ignore[arg-type]


def prism_plane(R: Rotation, p: Vector, half: Prism) -> tuple[Array, Six]:
    """Signed distance and wrench of prisms above the plane ``z = 0``."""
    zero = jnp.zeros_like(p[0])
    lowest = materialize(p + prism_support(R, half, vector(zero, zero, zero - 1)))
    return lowest[2], _lift(lowest)


def prism_prism(
    R_a: Rotation, p_a: Vector, half_a: Prism, R_b: Rotation, p_b: Vector, half_b: Prism, refinements: int = 3
) -> tuple[Array, Six]:
    """Separation and wrench of two prisms.

    The separation is the largest gap over the separating axes of two boxes (Gottschalk 1996: 6 face normals, 9 edge
    products), the directions in which two upright cylinders separate, and ``refinements`` further ones. It never
    exceeds the signed distance, so "apart" is always true; it equals it for boxes that touch or penetrate and where a
    face is nearest; past a corner it is smaller. For boxes its sign is that of the distance; tilted cylinders up to 2
    cm apart may seem to touch."""
    center = p_a - p_b
    # The candidate axes are one more batch axis and share one evaluation: that keeps the compiled program small.
    faces_a, faces_b = jnp.swapaxes(R_a, 0, 1), jnp.swapaxes(R_b, 0, 1)
    edges = cross(faces_a[:, :, None], faces_b[:, None])
    edges = edges.reshape(3, 9, *edges.shape[3:])
    # Two upright cylinders separate along the line between their axes.
    between = jnp.stack([center - dot(center, R[2]) * R[2] for R in (R_a, R_b)], axis=1)
    axes = materialize(jnp.concatenate([faces_a, faces_b, edges, between], axis=1))
    length = jnp.sqrt(dot(axes, axes) + TINY * TINY)
    n = materialize(jnp.where(dot(axes, center) < 0, -1, 1) / length * axes)

    def gap(n: Vector) -> Array:
        """Gap between the prisms along unit vectors (3, 17, ...) from B to A."""
        support = prism_support(R_a[:, :, None], half_a[:, None], -n) - prism_support(
            R_b[:, :, None], half_b[:, None], n
        )
        return dot(n, center[:, None] + support)

    gaps = materialize(jnp.where(length > 1e-4, gap(n), -jnp.inf))
    best = jnp.argmax(gaps, axis=0)
    separation = jnp.max(gaps, axis=0)
    normal = jnp.take_along_axis(n, best[None, None], axis=1)[:, 0]

    # Gilbert's iteration toward the point of the difference body A - B nearest to the origin: each direction that it
    # visits is one more candidate axis. Corners and the curved side of tilted cylinders need it.
    v, refined = center, jnp.zeros(separation.shape, bool)
    for _ in range(refinements):
        m = materialize(normalize(v))
        w = center + prism_support(R_a, half_a, -m) - prism_support(R_b, half_b, m)
        w = materialize(w)
        value = dot(m, w)
        # Where the bodies overlap v shrinks to zero: that is no direction.
        better = (value > separation) & (dot(v, v) > 1e-12)
        separation, normal = jnp.where(better, value, separation), jnp.where(better, m, normal)
        refined |= better
        edge = v - w
        v = v - jnp.clip(dot(v, edge) / jnp.maximum(dot(edge, edge), TINY), 0, 1) * edge
        v, separation, normal, refined = materialize((v, separation, normal, refined))

    # Where the contact is: a face of A touches B's support point and conversely; two edges touch where their lines
    # are nearest.
    corner_a = p_a + prism_support(R_a, half_a, -normal)
    corner_b = p_b + prism_support(R_b, half_b, normal)
    corner_a, corner_b = materialize((corner_a, corner_b))
    i, j = jnp.clip(best - 6, 0, 8) // 3, jnp.clip(best - 6, 0, 8) % 3
    da = jnp.where(i == 0, R_a[0], jnp.where(i == 1, R_a[1], R_a[2]))
    db = jnp.where(j == 0, R_b[0], jnp.where(j == 1, R_b[1], R_b[2]))
    da, db = materialize((da, db))
    offset, slant = corner_b - corner_a, dot(da, db)
    along = (dot(offset, da) - slant * dot(offset, db)) / jnp.maximum(1 - slant * slant, 1e-8)
    is_edge = (best >= 6) & (best < 15) & ~refined
    face_of_b = (best >= 3) & (best < 6) & ~refined
    point = jnp.where(is_edge, corner_a + along * da, jnp.where(face_of_b, corner_a, corner_b))
    return separation, _wrench(*materialize((point, normal)))
