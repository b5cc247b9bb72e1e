"""Signed distances between capsules, prisms and the table plane, with the contact wrench of each.

Shapes. A *capsule* is a segment with a radius. A *prism* stands for boxes and cylinders alike: half extents
``(hx, hy, hz, r)``, a box of half extents ``hx, hy, hz`` whose horizontal outline is rounded outwards by ``r``:
``B = box(hx, hy, hz) + disc(r)``. A box has ``r = 0``, an upright cylinder ``hx = hy = 0``. One formula serves both, so
shapes are data and no branch is taken on them.

Every distance is positive apart and negative in penetration [m]. Each comes with a contact point ``c`` and a unit normal ``n``
(world frame, pointing from the second body to the first), returned as the *wrench* ``w = (c x n, n)`` about the world origin.
For twists ``V = (angular velocity, velocity of the point at the world origin)`` of the two bodies

    d(distance)/dt = w . (V1 - V2),

which is all that a Jacobian needs: one wrench times the bodies' twist Jacobians.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import cross, dot, normalize, rotate, rotate_back

_SMALL = 1e-12


def _wrench(point: Array, normal: Array) -> Array:
    return jnp.concatenate([cross(point, normal), normal])


def capsule_capsule(a0: Array, a1: Array, ra: Array, b0: Array, b1: Array, rb: Array) -> tuple[Array, Array]:
    """Signed distance of capsules with segment ends ``(3, *b)`` and radii ``(*b,)``: ``(distance (*b,), wrench (6, *b))``.

    Exact wherever the two segments do not cross. (Ericson, Real-Time Collision Detection, sec. 5.1.9.)
    """
    da, db, r = a1 - a0, b1 - b0, a0 - b0
    aa, bb, ab = dot(da, da), dot(db, db), dot(da, db)
    ar, br = dot(da, r), dot(db, r)
    denominator = aa * bb - ab * ab
    parallel = denominator <= 1e-9 * aa * bb
    s = jnp.clip(jnp.where(parallel, 0.5, (ab * br - ar * bb) / jnp.where(parallel, 1, denominator)), 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    s = jnp.clip((ab * t - ar) / aa, 0, 1)
    t = jnp.clip((ab * s + br) / bb, 0, 1)
    pa, pb = a0 + s * da, b0 + t * db
    n = pa - pb
    length = jnp.sqrt(dot(n, n) + _SMALL * _SMALL)
    n = n / length
    return length - ra - rb, _wrench(pb, n)


def capsule_plane(a0: Array, a1: Array, ra: Array) -> tuple[Array, Array]:
    """Signed distance of capsules above the plane ``z = 0``: ``(distance, wrench)``; the normal is +z."""
    lower = jnp.where(a0[2] < a1[2], a0, a1)
    zero = jnp.zeros_like(lower[2])
    return lower[2] - ra, _wrench(lower, jnp.stack([zero, zero, zero + 1]))


def point_prism(p: Array, half: Array) -> tuple[Array, Array]:
    """Signed distance of points ``(3, *b)`` in the prism's own frame to prisms ``(4, *b)``: ``(distance, gradient)``.

    Exact outside and inside; the gradient ``(3, *b)`` is a unit vector, the direction of the nearest face where the point
    is inside.
    """
    qx, qy = jnp.abs(p[0]) - half[0], jnp.abs(p[1]) - half[1]
    px, py = jnp.maximum(qx, 0), jnp.maximum(qy, 0)
    square = px * px + py * py
    outside = square > _SMALL * _SMALL
    rho = jnp.sqrt(jnp.where(outside, square, 1))
    x_nearer = qx > qy
    ex = jnp.where(outside, px / rho, x_nearer) * jnp.sign(p[0])
    ey = jnp.where(outside, py / rho, ~x_nearer) * jnp.sign(p[1])
    horizontal = jnp.where(outside, rho, jnp.maximum(qx, qy)) - half[3]
    vertical = jnp.abs(p[2]) - half[2]
    h, v = jnp.maximum(horizontal, 0), jnp.maximum(vertical, 0)
    square = h * h + v * v
    outside = square > _SMALL * _SMALL
    length = jnp.sqrt(jnp.where(outside, square, 1))
    side_nearer = horizontal > vertical
    wh = jnp.where(outside, h / length, side_nearer)
    wv = jnp.where(outside, v / length, ~side_nearer)
    distance = jnp.where(outside, length, jnp.maximum(horizontal, vertical))
    return distance, jnp.stack([wh * ex, wh * ey, wv * jnp.sign(p[2])])


def capsule_prism(
    a0: Array, a1: Array, ra: Array, R: Array, p: Array, half: Array, rounds: int = 4
) -> tuple[Array, Array]:
    """Signed distance of capsules to prisms with pose ``R (3, 3, *b), p (3, *b)``: ``(distance (*b,), wrench (6, *b))``.

    The distance of a point to a convex body is convex along the segment, so its minimum is bracketed by the sign of the
    slope: ``rounds`` pairs of one false-position and one bisection step. Outside, the slope of the squared distance to a box is
    piecewise linear and false position ends on it exactly. An error e in the position on the segment costs the order of
    e^2 in the distance. Where the capsule's *axis* enters the prism, the depth is that of the axis' deepest point.
    """
    b0, b1 = rotate_back(R, a0 - p), rotate_back(R, a1 - p)
    d = b1 - b0

    def slope(t: Array) -> Array:
        distance, gradient = point_prism(b0 + t * d, half)
        return dot(gradient, d) * jnp.maximum(distance, 1e-3)

    zero = jnp.zeros_like(b0[0])
    low, high = zero, zero + 1
    slope_low, slope_high = slope(low), slope(high)
    at_low, at_high = slope_low >= 0, slope_high <= 0
    for step in range(2 * rounds):
        if step % 2 == 0:
            gap = slope_high - slope_low
            middle = low - slope_low * (high - low) / jnp.where(gap > 0, gap, 1)
            middle = jnp.clip(middle, low, high)
        else:
            middle = 0.5 * (low + high)
        value = slope(middle)
        left = value <= 0
        low, slope_low = jnp.where(left, middle, low), jnp.where(left, value, slope_low)
        high, slope_high = jnp.where(left, high, middle), jnp.where(left, slope_high, value)
    gap = slope_high - slope_low
    t = jnp.clip(low - slope_low * (high - low) / jnp.where(gap > 0, gap, 1), low, high)
    t = jnp.where(at_low, 0, jnp.where(at_high, 1, t))
    distance, gradient = point_prism(b0 + t * d, half)
    n = rotate(R, gradient)
    return distance - ra, _wrench(a0 + t * (a1 - a0), n)


def prism_support(R: Array, half: Array, n: Array) -> Array:
    """Support vector of prisms about their own centre: ``argmax_{x in prism} n . x``, in the world frame ``(3, *b)``."""
    m = rotate_back(R, n)
    length = jnp.sqrt(m[0] * m[0] + m[1] * m[1] + _SMALL * _SMALL)
    local = [
        jnp.sign(m[0]) * half[0] + half[3] * m[0] / length,
        jnp.sign(m[1]) * half[1] + half[3] * m[1] / length,
        jnp.sign(m[2]) * half[2],
    ]
    return rotate(R, jnp.stack(local))


def prism_plane(R: Array, p: Array, half: Array) -> tuple[Array, Array]:
    """Signed distance of prisms above the plane ``z = 0``: ``(distance (*b,), wrench (6, *b))``."""
    zero = jnp.zeros_like(p[0])
    up = jnp.stack([zero, zero, zero + 1])
    lowest = p + prism_support(R, half, -up)
    return lowest[2], _wrench(lowest, up)


def _separation(R_a: Array, p_a: Array, half_a: Array, R_b: Array, p_b: Array, half_b: Array, refinements: int) -> Array:
    """Largest gap between two prisms over a set of separating axes, shape ``(*b,)``; see `prism_prism`."""
    center = p_a - p_b

    def gap(n: Array) -> Array:
        return dot(n, center) + dot(n, prism_support(R_a, half_a, -n)) - dot(n, prism_support(R_b, half_b, n))

    faces = [R_a[:, i] for i in range(3)] + [R_b[:, i] for i in range(3)]
    edges = [cross(R_a[:, i], R_b[:, j]) for i in range(3) for j in range(3)]
    # Two upright cylinders separate along the line between their axes.
    edges += [center - dot(center, R[:, 2]) * R[:, 2] for R in (R_a, R_b)]
    best = jnp.full_like(center[0], -jnp.inf)
    for axis in faces + edges:
        length = jnp.sqrt(dot(axis, axis) + _SMALL * _SMALL)
        n = axis / length
        n = jnp.where(dot(n, center) < 0, -n, n)
        best = jnp.maximum(best, jnp.where(length > 1e-4, gap(n), -jnp.inf))
    # Gilbert's iteration toward the point of the difference body A - B nearest to the origin: each direction that it visits is
    # one more candidate axis. Corners and the curved side of tilted cylinders need it.
    v = center
    for _ in range(refinements):
        n = normalize(v)
        best = jnp.maximum(best, gap(jax.lax.stop_gradient(n)))
        w = center + prism_support(R_a, half_a, -n) - prism_support(R_b, half_b, n)
        edge = v - w
        v = v - jnp.clip(dot(v, edge) / jnp.maximum(dot(edge, edge), _SMALL), 0, 1) * edge
    return best


def prism_prism(
    R_a: Array, p_a: Array, half_a: Array, R_b: Array, p_b: Array, half_b: Array, refinements: int = 4
) -> tuple[Array, Array]:
    """Separation of two prisms: ``(separation (*b,), wrench (6, *b))``.

    The separation is the largest gap over the separating axes of two boxes (Gottschalk 1996: 6 face normals, 9 edge products),
    the axes of cylinders, and ``refinements`` further directions. It never exceeds the signed distance, so "apart" is always true; it
    equals it for boxes that touch or penetrate, and where a face is nearest; past a corner it is smaller but of the same sign.
    """

    def total(R: Array, p: Array) -> tuple[Array, Array]:
        value = _separation(R, p, half_a, R_b, p_b, half_b, refinements)
        return value.sum(), value

    # Only the relative pose counts, so the derivative with respect to A's pose is the whole wrench (B feels its negative).
    (dR, dp), value = jax.grad(total, argnums=(0, 1), has_aux=True)(R_a, p_a)
    moment = cross(p_a, dp)
    for i in range(3):
        moment = moment + cross(R_a[:, i], dR[:, i])
    return value, jnp.concatenate([moment, dp])
