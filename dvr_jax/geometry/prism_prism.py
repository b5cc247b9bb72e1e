"""Separation of two prisms.

For a unit vector n, the *gap* between two convex bodies A and B along n is the distance between the two planes normal
to n that touch them. With the centers ``p_A, p_B`` and the support points ``h_A, h_B`` relative to them,

    gap(n) = n . (p_A + h_A(-n)) - n . (p_B + h_B(n)).

The gap never exceeds the signed distance, and the largest gap over all n equals it. `prism_prism` takes the largest gap
of a finite number of directions, the *separating axes*:

1. the face normals of two boxes, and the products of an edge of the one and an edge of the other (S. Gottschalk,
   Separating axis theorem, technical report TR96-024, University of North Carolina, 1996);
2. the directions in which two upright cylinders separate;
3. the directions that Gilbert's iteration visits on its way to the nearest points (E. Gilbert, An iterative procedure
   for computing the minimum of a quadratic form on a convex set, SIAM Journal on Control 4, 1966).

The convention of signed distances and wrenches is that of `dvr_jax.geometry.wrenches`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.prisms import Prism, prism_support
from dvr_jax.geometry.vectors import (
    TINY,
    Rotation,
    Scalar,
    SpatialVector,
    Vector,
    cross,
    dot,
    materialize,
    normalize,
)
from dvr_jax.geometry.wrenches import contact_wrench

REFINEMENTS = 3
"""Steps of Gilbert's iteration."""

FIRST_FACE_OF_B = 3
"""Number of the first axis that is a face normal of B; the face normals of A come before."""

FIRST_EDGE_PRODUCT = 6
"""Number of the first axis that is a product of an edge of A and an edge of B, B's edges running fastest."""

EDGE_PRODUCTS = 9
"""Number of such axes; the axes of upright cylinders come after them."""

SHORTEST_AXIS = 1e-4
"""An axis whose length is at most this is left out: the product of two edges that are nearly parallel."""

SMALLEST_SQUARE = 1e-12
"""A vector whose squared length is at most this [m^2] is no direction for Gilbert's iteration."""

SMALLEST_SQUARED_SINE = 1e-8
"""Lower bound of the squared sine of the angle between two edges, which is divided by."""


class _Pair(NamedTuple):
    """Poses and shapes of two prisms A and B."""

    R_a: Rotation
    p_a: Vector
    prism_a: Prism
    R_b: Rotation
    p_b: Vector
    prism_b: Prism


class _SeparatingAxis(NamedTuple):
    """The candidate axis with the largest gap."""

    number: Int[Array, "*#batch"]
    """Which of the candidate axes it is."""

    separation: Scalar
    """Gap along it [m]."""

    normal: Vector
    """Unit vector along it, from B to A."""


class _Refinement(NamedTuple):
    """State of Gilbert's iteration."""

    nearest: Vector
    """Point of the difference body A - B that is nearest to the origin so far [m]."""

    separation: Scalar
    """Largest gap so far [m]."""

    normal: Vector
    """Unit vector along which the gap is largest."""

    refined: Bool[Array, "*#batch"]
    """True where the iteration has found the largest gap, and not one of the candidate axes."""


def prism_prism(
    R_a: Rotation,
    p_a: Vector,
    prism_a: Prism,
    R_b: Rotation,
    p_b: Vector,
    prism_b: Prism,
    refinements: int = REFINEMENTS,
) -> tuple[Scalar, SpatialVector]:
    """Separation and wrench of two prisms.

    The separation never exceeds the signed distance, so "apart" is always true. It equals the distance for boxes that
    touch or penetrate, and where a face is nearest; past a corner it is smaller. For boxes its sign is that of the
    distance. For tilted cylinders that are up to 2 cm apart it may be negative.

    Args:
        R_a: Rotation of the first prism.
        p_a: Center of the first prism [m].
        prism_a: Shape of the first prism.
        R_b: Rotation of the second prism.
        p_b: Center of the second prism [m].
        prism_b: Shape of the second prism.
        refinements: Number of steps of Gilbert's iteration.

    Returns:
        Separations [m] and wrenches.
    """
    pair = _Pair(R_a, p_a, prism_a, R_b, p_b, prism_b)
    center = p_a - p_b
    axis = _largest_gap(pair, center)

    state = _Refinement(
        center, axis.separation, axis.normal, jnp.zeros(axis.separation.shape, bool)
    )
    for _ in range(refinements):
        state = _refine(pair, center, state)

    point = _contact_point(pair, axis.number, state)
    point, normal = materialize((point, state.normal))
    return state.separation, contact_wrench(point, normal)


def _candidate_axes(pair: _Pair, center: Vector) -> Float[Array, "3 axes *#batch"]:
    """Separating axes of two boxes or two upright cylinders, of any length and sign.

    They are the face normals of A, the face normals of B, the products of edges, and the vectors between the axes of
    two parallel cylinders.
    """
    faces_a = jnp.swapaxes(pair.R_a, 0, 1)
    faces_b = jnp.swapaxes(pair.R_b, 0, 1)
    edges = cross(faces_a[:, :, None], faces_b[:, None])
    edges = edges.reshape(3, EDGE_PRODUCTS, *edges.shape[3:])

    # Two upright cylinders separate along the line between their axes.
    between = jnp.stack([center - dot(center, R[2]) * R[2] for R in (pair.R_a, pair.R_b)], axis=1)
    return jnp.concatenate([faces_a, faces_b, edges, between], axis=1)


def _largest_gap(pair: _Pair, center: Vector) -> _SeparatingAxis:
    """Largest gap over the candidate axes.

    The candidate axes are one more batch axis and share one evaluation, which keeps the compiled program small.
    """
    axes = materialize(_candidate_axes(pair, center))
    length = jnp.sqrt(dot(axes, axes) + TINY * TINY)
    # Unit vectors from B to A.
    n = materialize(jnp.where(dot(axes, center) < 0, -1, 1) / length * axes)

    gaps = materialize(jnp.where(length > SHORTEST_AXIS, _gaps(pair, center, n), -jnp.inf))
    number = jnp.argmax(gaps, axis=0)
    separation = jnp.max(gaps, axis=0)
    normal = jnp.take_along_axis(n, number[None, None], axis=1)[:, 0]
    return _SeparatingAxis(number, separation, normal)


def _gaps(
    pair: _Pair, center: Vector, n: Float[Array, "3 axes *#batch"]
) -> Float[Array, "axes *#batch"]:
    """Gap between two prisms along each of several unit vectors from B to A [m]."""
    support_a = prism_support(pair.R_a[:, :, None], pair.prism_a[:, None], -n)
    support_b = prism_support(pair.R_b[:, :, None], pair.prism_b[:, None], n)
    support = support_a - support_b
    return dot(n, center[:, None] + support)


def _refine(pair: _Pair, center: Vector, state: _Refinement) -> _Refinement:
    """One step of Gilbert's iteration toward the point of the difference body A - B that is nearest to the origin.

    With the nearest point v so far and the difference body's support point w against the direction of v, the next
    nearest point is that of the segment from v to w:

        v - clip(v . (v - w) / |v - w|^2, 0, 1) (v - w).

    Corners and the curved side of tilted cylinders need the directions that the iteration visits: each is one more
    separating axis.
    """
    v = state.nearest
    direction = materialize(normalize(v))
    w = (
        center
        + prism_support(pair.R_a, pair.prism_a, -direction)
        - prism_support(pair.R_b, pair.prism_b, direction)
    )
    w = materialize(w)
    gap = dot(direction, w)

    # Where the bodies overlap v shrinks to zero, which is no direction.
    better = (gap > state.separation) & (dot(v, v) > SMALLEST_SQUARE)
    separation = jnp.where(better, gap, state.separation)
    normal = jnp.where(better, direction, state.normal)
    refined = state.refined | better

    edge = v - w
    nearest = v - jnp.clip(dot(v, edge) / jnp.maximum(dot(edge, edge), TINY), 0, 1) * edge
    return materialize(_Refinement(nearest, separation, normal, refined))


def _contact_point(pair: _Pair, number: Int[Array, "*#batch"], state: _Refinement) -> Vector:
    """Contact point in the world [m].

    A face of A touches the support point of B, and a face of B that of A. Two edges touch where their lines are
    nearest: with unit vectors da and db along them and with ``offset`` from the support point of A to that of B, at

        support point of A + (offset . da - (da . db) (offset . db)) / (1 - (da . db)^2) da.

    Where Gilbert's iteration has found the normal, the support point of B is taken. It is the contact point only where
    a corner of B is nearest.
    """
    support_a = pair.p_a + prism_support(pair.R_a, pair.prism_a, -state.normal)
    support_b = pair.p_b + prism_support(pair.R_b, pair.prism_b, state.normal)
    support_a, support_b = materialize((support_a, support_b))

    # The two edges of an axis that is a product of edges.
    edge_a = jnp.clip(number - FIRST_EDGE_PRODUCT, 0, EDGE_PRODUCTS - 1) // 3
    edge_b = jnp.clip(number - FIRST_EDGE_PRODUCT, 0, EDGE_PRODUCTS - 1) % 3
    da, db = materialize((_column(pair.R_a, edge_a), _column(pair.R_b, edge_b)))

    offset = support_b - support_a
    cosine = dot(da, db)
    along = (dot(offset, da) - cosine * dot(offset, db)) / jnp.maximum(
        1 - cosine * cosine, SMALLEST_SQUARED_SINE
    )

    is_edge = (
        (number >= FIRST_EDGE_PRODUCT)
        & (number < FIRST_EDGE_PRODUCT + EDGE_PRODUCTS)
        & ~state.refined
    )
    is_face_of_b = (number >= FIRST_FACE_OF_B) & (number < FIRST_EDGE_PRODUCT) & ~state.refined
    return jnp.where(is_edge, support_a + along * da, jnp.where(is_face_of_b, support_a, support_b))


def _column(R: Rotation, index: Int[Array, "*#batch"]) -> Vector:
    """Column of a rotation by its index, 0 to 2."""
    return jnp.where(index == 0, R[0], jnp.where(index == 1, R[1], R[2]))
