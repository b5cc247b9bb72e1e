"""Signed distances between capsules, prisms and the table plane, with the contact wrench of each.

Shapes. A *capsule* is a segment with a radius. A *prism* stands for boxes and cylinders alike: half extents ``(hx,
hy, hz, r)``, a box of half extents ``hx, hy, hz`` whose horizontal outline is rounded outwards by ``r``. A box has
``r = 0``, an upright cylinder ``hx = hy = 0``. One formula serves both, so shapes are data; only where the distance has
kinks (`nearest_on_axis`) differs.

Every distance is positive apart and negative in penetration [m]. Each comes with a contact point ``c`` and a unit
normal ``n`` (world frame, pointing from the second body to the first), returned as the *wrench* ``w = (c x n, n)``
about the world's origin. For twists ``V1, V2`` of the two bodies

    d(distance)/dt = w . (V1 - V2),

which is all that a Jacobian needs: one wrench times the bodies' twist Jacobians.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from dvr_jax.geometry.arrays import Array
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

    Exact wherever the two segments do not cross."""
    between, on_b = _closest(a0, a1, b0, b1)
    length, on_b = materialize(_length(between)), materialize(on_b)
    return length - ra - rb, _wrench(on_b, between / length)


def capsule_capsule_distance(
    a0: Vector, a1: Vector, ra: Array | float, b0: Vector, b1: Vector, rb: Array | float
) -> Array:
    """The distance of `capsule_capsule` alone."""
    return _length(_closest(a0, a1, b0, b1)[0]) - ra - rb


def _length(a: Vector) -> Array:
    return jnp.sqrt(dot(a, a) + TINY * TINY)


def _closest(a0: Vector, a1: Vector, b0: Vector, b1: Vector) -> tuple[Vector, Vector]:
    """Vector from the second segment's nearest point to the first one's, and the second's (Ericson, Real-Time Collision
    Detection, sec. 5.1.9)."""
    da, db, r = a1 - a0, b1 - b0, a0 - b0
    aa, bb, ab, ar, br = materialize((dot(da, da), dot(db, db), dot(da, db), dot(da, r), dot(db, r)))
    denominator = aa * bb - ab * ab
    parallel = denominator <= 1e-9 * aa * bb
    s = jnp.clip(jnp.where(parallel, 0.5, (ab * br - ar * bb) / jnp.where(parallel, 1, denominator)), 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s = materialize(jnp.clip((ab * t - ar) / aa, 0, 1))
    t = materialize(jnp.clip((ab * s + br) / bb, 0, 1))
    return materialize(r + s * da - t * db), b0 + t * db


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
    # Not `sign`, which is 0 on the planes between two faces.
    sx, sy, sz = (jnp.where(x < 0, -1, 1) for x in p)
    return distance, (wh * ex * sx, wh * ey * sy, wv * sz)


def _kinks(b0: Vector, d: Vector, half: Prism) -> Array:
    """Positions (6, ...) along lines ``b0 + t d`` where the distance to a prism has a kink: on a box' six planes; on
    a cylinder's two planes and its side, and where the line is nearest to the cylinder's axis."""

    def over(a: Array, b: Array) -> Array:
        return a / jnp.where(jnp.abs(b) > TINY, b, TINY)

    def planes(axis: int) -> tuple[Array, Array]:
        return over(-half[axis] - b0[axis], d[axis]), over(half[axis] - b0[axis], d[axis])

    square = d[0] * d[0] + d[1] * d[1]
    nearest = over(-(b0[0] * d[0] + b0[1] * d[1]), square)
    chord = nearest * nearest - over(b0[0] * b0[0] + b0[1] * b0[1] - half[3] * half[3], square)
    chord = jnp.sqrt(jnp.maximum(chord, 0))
    round_side = (nearest - chord, nearest, nearest + chord, nearest)
    side = [jnp.where(half[3] > 0, a, b) for a, b in zip(round_side, (*planes(0), *planes(1)), strict=True)]
    return jnp.stack(jnp.broadcast_arrays(*planes(2), *side))


def _slope(p: Vector, d: Vector, half: Prism) -> Array:
    """Slope of half the squared distance to a prism along ``d`` at points outside; at points inside a number that has
    the sign of the distance's slope."""
    qx, qy, vertical = (jnp.abs(x) - h for x, h in zip(p, half[:3], strict=True))
    dx, dy, dz = (jnp.sign(x) * along for x, along in zip(p, d, strict=True))
    px, py = jnp.maximum(qx, 0), jnp.maximum(qy, 0)
    square = px * px + py * py
    rho = jnp.sqrt(square + TINY * TINY)
    horizontal = jnp.where(square > 0, rho, jnp.maximum(qx, qy)) - half[3]
    radial = jnp.where(square > 0, (px * dx + py * dy) / rho, jnp.where(qx > qy, dx, dy))
    outside = jnp.maximum(horizontal, 0) * radial + jnp.maximum(vertical, 0) * dz
    inside = jnp.where(horizontal > vertical, radial, dz)
    return jnp.where(jnp.maximum(horizontal, vertical) > 0, outside, 1e-3 * inside)


class _Bracket(NamedTuple):
    """Both ends of a part of a line on which a prism's distance has its minimum, and `_slope` there."""

    low: Array
    high: Array
    at_low: Array
    at_high: Array

    def cut(self, t: Array, value: Array) -> _Bracket:
        """What is left of it when it is cut at ``t``; itself where that is not within."""
        left, right = (value <= 0) & (t >= self.low), (value > 0) & (t <= self.high)
        return _Bracket(
            jnp.where(left, t, self.low),
            jnp.where(right, t, self.high),
            jnp.where(left, value, self.at_low),
            jnp.where(right, value, self.at_high),
        )


SECTIONS = 8
"""Equal parts of the bracket of which `nearest_on_axis` keeps one."""

GUESSES = 12
"""Evaluations by the rule of false position after that."""


def capsule_prism(
    a0: Vector, a1: Vector, radius: Array | float, R: Rotation, p: Vector, half: Prism, guesses: int = GUESSES
) -> tuple[Array, Six]:
    """Signed distance and wrench of capsules to prisms with pose ``R, p``. A prism is a box or a cylinder here: its
    ``r`` is 0, or ``hx`` and ``hy`` are. (Exact where `nearest_on_axis` is.)"""
    t = nearest_on_axis(a0, a1, R, p, half, guesses)
    distance, gradient = materialize(point_prism(rotate_back(R, a0 + t * (a1 - a0) - p), half))
    return distance - radius, axis_point_wrench(a0, a1, t, R, gradient)


def axis_point_wrench(a0: Vector, a1: Vector, t: Array, R: Rotation, gradient: tuple[Array, Array, Array]) -> Six:
    """Wrench of a capsule's distance to a prism of orientation ``R``, taken at the position ``t`` of its axis where
    `point_prism` has this gradient."""
    return _wrench(*materialize((a0 + t * (a1 - a0), rotate(R, gradient))))  # type: ignore[arg-type]


def nearest_on_axis(a0: Vector, a1: Vector, R: Rotation, p: Vector, half: Prism, guesses: int = GUESSES) -> Array:
    """Position, from 0 to 1, of the point of a segment that is nearest to a prism.

    The distance of a point to a convex body is convex along the capsule's axis, so its minimum is bracketed by the
    sign of the slope. The bracket is cut where the distance has kinks, then to one of its `SECTIONS`, then by
    ``guesses`` of the rule of false position: outside a box the slope of the squared distance is linear between kinks,
    and the nearest point is exact; on a cylinder the distance is, to rounding. Where the capsule's *axis* enters the
    prism, the depth is that of the axis' deepest point; it is too small by 0.3 mm at most (in 25,000 random
    cases)."""
    b0, d = materialize((rotate_back(R, a0 - p), rotate_back(R, a1 - a0)))

    def cut(bracket: _Bracket, positions: Array) -> _Bracket:
        # All slopes in one kernel: in a loop over the positions it takes twice as long.
        positions = materialize(positions)
        values = materialize(_slope(b0[:, None] + positions * d[:, None], d[:, None], half[:, None]))
        for t, value in zip(positions, values, strict=True):
            bracket = bracket.cut(t, value)
        return materialize(bracket)

    zero = jnp.zeros_like(d[0] + half[0])
    first, last = materialize((_slope(b0, d, half), _slope(b0 + d, d, half)))
    bracket = cut(_Bracket(zero, zero + 1, first, last), _kinks(b0, d, half))
    parts = [i / SECTIONS for i in range(1, SECTIONS)]
    bracket = cut(bracket, jnp.stack([bracket.low + part * (bracket.high - bracket.low) for part in parts]))

    def guess(_: int, state: tuple[_Bracket, Array, Array]) -> tuple[_Bracket, Array, Array]:
        bracket, was_left, was_right = state
        gap = bracket.at_high - bracket.at_low
        step = -bracket.at_low * (bracket.high - bracket.low) / jnp.where(gap > 0, gap, 1)
        t = materialize(jnp.minimum(bracket.low + step, bracket.high))
        value = materialize(_slope(b0 + t * d, d, half))
        bracket, left = bracket.cut(t, value), value <= 0
        # Illinois rule: an end that stays twice holds false position up, so its value counts half.
        bracket = bracket._replace(
            at_low=jnp.where(~left & was_right, 0.5 * bracket.at_low, bracket.at_low),
            at_high=jnp.where(left & was_left, 0.5 * bracket.at_high, bracket.at_high),
        )
        return materialize((bracket, left, ~left))

    never = jnp.zeros(zero.shape, bool)
    bracket, _, _ = jax.lax.fori_loop(0, guesses, guess, (bracket, never, never))
    nearest = _meet(bracket.low, bracket.high, b0, d, half)
    return materialize(jnp.where(first >= 0, 0, jnp.where(last <= 0, 1, nearest)))


def _meet(low: Array, high: Array, b0: Vector, d: Vector, half: Prism) -> Array:
    """Where the nearest point is between two near points: outside, the root of the squared distance's slope by false
    position; inside, where depth has linear pieces, where the tangents at both ends meet."""
    (d0, g0), (d1, g1) = materialize((point_prism(b0 + low * d, half), point_prism(b0 + high * d, half)))
    s0, s1 = dot(g0, d), dot(g1, d)  # type: ignore[arg-type]
    # Not 0: the ends may be where the line meets the surface.
    inside = jnp.maximum(d0, d1) < 1e-9
    a, b, width = -s0 * jnp.maximum(d0, 0), s1 * jnp.maximum(d1, 0), high - low
    total = jnp.where(inside, s1 - s0, a + b)
    step = jnp.where(inside, d0 - d1 + s1 * width, a * width) / jnp.where(total > 0, total, 1)
    return low + jnp.clip(step, 0, width)


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
