r"""Two blocks keep hands straight on their way to and from objects, and held objects near the vertical of their place.

A *straight motion* lies between two neighboring slices: the *near* one, at which the hand is at the object or the
object at its support, and the *far* one, at which it is the distance d away. A phase of a path has two of them, one in
its first interval, which leaves the last switch, and one in its last interval but one, which comes to the next switch;
the fingers move in the last interval. There are two kinds (`StraightKind`):

- *along the approach*: a hand comes to an object that it grasps, or leaves an object that it has released;
- *vertical*: an arm lifts an object from its support, or lowers it to its support.

Let (R_n, p_n) be the pose of the hand at the near slice, and (R, p) its pose at a point of the motion: at the far
slice, or at a sample between the two. The axes x, y and z of a motion along the approach are those of the near hand,
whose z axis points to the object. Those of a vertical motion are fixed in the world, and z points down.

- The block of the straight line has five equalities for the far slice of a motion along the approach: the components of
  ``p - p_n`` along x and y [m], and ``2 e``, where (w, e) is the quaternion of ``R R_n^T``
  (`dvr_jax.nlp.blocks.mode_switch`) [rad].
- The block of the corridor has the inequality ``d + z . (p - p_n) <= 0`` [m] for the far slice. It bounds the
  components along x and y on either side: by `CORRIDOR` at the samples between both slices of a motion along the
  approach, and by `LIFT_CORRIDOR` at the far slice and at these samples but the first of a vertical motion.

A hand turns with the angular velocity omega of its joints, and the point at p that moves with it has the velocity v(p).
For an axis a_n of the near hand, and for a fixed axis a,

    d(a_n . (p - p_n)) = a_n . v(p) - a_n . v_n(p),        d(a . (p - p_n)) = a . v(p) - a . v_n(p_n),
    d(2 e) = w (omega - omega_n) + (omega + omega_n) x e.

The joint angles at a sample of the fraction s are those of its interval's slices, weighted by s and 1 - s.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    compose,
    cross,
    dot,
    half_rotation_vector,
    materialize,
    rotation_angle,
    transpose,
)
from dvr_jax.nlp.blocks.block import (
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    Measure,
)
from dvr_jax.nlp.blocks.straight_curvature import MotionEnds, straight_curvature
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import Curvature, SystemParts

SIDEWAYS_TOLERANCE = 2e-3
"""Largest distance of the far hand of a feasible point from the approach axis [m]."""

TURN_TOLERANCE = 2e-2
"""Largest turn of the hand between both ends of a straight motion of a feasible point [rad]."""

DISTANCE_TOLERANCE = 2e-3
"""By how much the straight motion of a feasible point may be shorter than asked for [m]."""

CORRIDOR = 1e-3
"""Largest distance from the straight line between both ends, along each of two axes [m]. Between two slices joints move
on straight lines in joint space, and their hands nearly do so."""

LIFT_CORRIDOR = 0.03
"""Largest distance from the vertical line through the near end of a vertical motion, along each of two axes [m]."""

CORRIDOR_TOLERANCE = 1e-3
"""By how much a feasible point may leave this corridor [m]."""

CORRIDOR_ROWS = 4
"""Number of rows of each sample between both ends."""

POSITION_SCALE = 1.0
"""Penalty of a row in meters relative to the common one."""

ROTATION_SCALE = 0.1
"""Penalty of a row in radians relative to the common one."""

MOTIONS = 2
"""Number of straight motions of a phase: one that leaves the last switch, and one that comes to the next one."""

DOWNWARD_FRAME = np.diag([1.0, -1.0, -1.0])
"""Axes of vertical motions in the world, one in each row; the last one points down."""


class StraightKind(IntEnum):
    """Along which axis a straight motion goes (`Problem.straight_kind`)."""

    APPROACH = 0
    """Along the approach axis of the hand."""

    VERTICAL = 1
    """Along the vertical axis of the world."""


LINE_ROWS = np.array([0, 1, 3, 4, 5])
"""Components of an offset that the line keeps at zero: all but the one along the approach axis."""


class StraightMotions(NamedTuple):
    """Points of all straight motions of B problems, with their derivatives.

    The axes are B problems, K phases, 2 motions, and M points of each motion. The last point is the far end, the others
    are the samples between the two slices.
    """

    offset: Float[Array, "batch phases 2 points 6"]
    """Components of ``p - p_n`` along the motion's axes x, y and z [m], and 2 e [rad]."""

    angle: Float[Array, "batch phases 2 points"]
    """Turn of the hand [rad]."""

    by_near: Float[Array, "batch phases 2 points 6 joints"]
    """Derivatives by the joint angles of all arms at the near slice."""

    by_far: Float[Array, "batch phases 2 points 6 joints"]
    """Derivatives by the joint angles of all arms at the far slice."""


class StraightJacobian(NamedTuple):
    """Derivatives of the rows of a block by the joint angles at both ends of the straight motions."""

    by_near: Float[Array, "*batch phases 2 rows joints"]
    by_far: Float[Array, "*batch phases 2 rows joints"]


def near_and_far(phases: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the near and the far slices (K, 2) of all straight motions.

    Args:
        phases: Number K of phases.
        steps: Number S of slices in each phase.
    """
    # Phase 0 has no switch to leave; any slices will do for this motion, whose length is 0.
    first = np.arange(phases) * steps
    near = np.stack([np.maximum(first - 1, 0), first + steps - 2], axis=1)
    far = np.stack([np.maximum(first, 1), first + steps - 3], axis=1)
    return near, far


class _MotionSamples(NamedTuple):
    """Which samples of a problem belong to its straight motions."""

    start: Int[np.ndarray, "phases 2 points"]
    """Sample of the near slice."""

    point: Int[np.ndarray, "phases 2 points"]
    """Sample of each point; the last one is that of the far slice."""

    share: Float[Array, "batch phases 2 points"]
    """The part of a point's motion that is due to the far slice; the rest is due to the near one."""


def _motion_samples(problems: Problem, phases: int) -> _MotionSamples:
    """Return the samples of all straight motions of B problems."""
    fraction = jnp.asarray(problems.sample_fraction)
    T, M = fraction.shape[1:]
    near, far = near_and_far(phases, T // phases)

    # The points are the samples of the interval that lies between both slices, in which the far end takes the place of
    # the last sample.
    later = np.maximum(near, far)
    point = later[..., None] * M + np.arange(M)
    point[..., -1] = far * M + M - 1
    start = np.broadcast_to(near[..., None] * M + M - 1, point.shape)

    of_later = fraction[:, later]
    is_far_later = (far > near)[..., None]
    share = jnp.where(is_far_later, of_later, 1 - of_later).at[..., -1].set(1)
    return _MotionSamples(start, point, share)


def _motion_ends(given: EvaluationInput) -> MotionEnds:
    """Return the poses of the hands at both ends of all straight motions, and the twists of their joints."""
    K = given.x.m.shape[1]
    D = given.x.q.shape[2]
    A = given.hands.position.shape[1]
    samples = _motion_samples(given.problems, K)
    own = given.problems.straight_arm[..., None] == jnp.arange(A)
    own = jnp.asarray(own, given.x.q.dtype).transpose(3, 0, 1, 2)[..., None]

    def at(value: Array, index: np.ndarray) -> Array:
        """Take the arm that moves at samples: (..., A, B, T M) to (..., B, K, 2, M)."""
        return materialize((value[..., index] * own).sum(-5))

    # Poses of the hand at the near slice and at the points, and the axes of the motion.
    R_n = at(given.hands.rotation, samples.start)
    is_vertical = (jnp.asarray(given.problems.straight_kind) == StraightKind.VERTICAL)[..., None]
    downward = jnp.asarray(DOWNWARD_FRAME, R_n.dtype).reshape(3, 3, 1, 1, 1, 1)

    # The joints of other arms than the one that moves have no twist.
    moves = jnp.repeat(own, D // A, axis=0)
    return MotionEnds(
        near_rotation=R_n,
        near_position=at(given.hands.position, samples.start),
        near_screws=given.screws[..., samples.start] * moves,
        rotation=at(given.hands.rotation, samples.point),
        position=at(given.hands.position, samples.point),
        screws=given.screws[..., samples.point] * moves,
        axes=materialize(jnp.where(is_vertical, downward, R_n)),
        is_vertical=is_vertical,
        share=samples.share,
    )


def straight_motions(given: EvaluationInput) -> StraightMotions:
    """Compute points of all straight motions and their derivatives."""
    ends = _motion_ends(given)
    axes = ends.axes
    p_n = ends.near_position
    p_p = ends.position
    apart = materialize(p_p - p_n)
    difference = materialize(compose(ends.rotation, transpose(ends.near_rotation)))
    w, e = materialize(half_rotation_vector(difference))
    offset = jnp.concatenate([jnp.stack([dot(axes[i], apart) for i in range(3)]), 2 * e])

    # Derivatives by the joints (6, D, B, K, 2, M). Axes of the hand turn with it, so that the point p itself seems to
    # move; fixed axes do not.
    pivot = jnp.where(ends.is_vertical, p_n, p_p)
    by_start = -_offset_changes(ends.near_screws, axes, pivot, w, -e)
    by_point = _offset_changes(ends.screws, axes, p_p, w, e)
    by_start, by_point = materialize((by_start, by_point))
    share = ends.share
    return StraightMotions(
        offset=jnp.moveaxis(offset, 0, -1),
        angle=rotation_angle(difference),
        by_near=jnp.moveaxis(by_start + (1 - share) * by_point, (0, 1), (-2, -1)),
        by_far=jnp.moveaxis(share * by_point, (0, 1), (-2, -1)),
    )


def _offset_changes(screws: Array, R: Array, p: Array, w: Array, e: Array) -> Array:
    """Return ``a . v(p)`` for the three axes a of R, and ``w omega + omega x e``, for the twists of joints.

    Args:
        screws: Twists of the joints (6, D, ...).
        R: Axes (3, 3, ...).
        p: Point whose velocity is taken (3, ...) [m].
        w: Scalar part of a quaternion (...).
        e: Its vector part (3, ...).

    Returns:
        The changes (6, D, ...).
    """
    turn = screws[:3]
    velocity = materialize(screws[3:] + cross(turn, p[:, None]))
    along = jnp.stack([dot(R[i][:, None], velocity) for i in range(3)])
    return jnp.concatenate([along, w * turn + cross(turn, e[:, None])])


def _line_shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases if horizon.is_path else 0, MOTIONS, len(LINE_ROWS))


def _corridor_shape(horizon: Horizon) -> tuple[int, ...]:
    between = horizon.samples - 1
    return (horizon.phases if horizon.is_path else 0, MOTIONS, 1 + between * CORRIDOR_ROWS)


def _evaluate_line(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows of the straight line."""
    if given.x.q.shape[1] == given.x.m.shape[1]:
        return _no_rows(given, len(LINE_ROWS), 2)
    motions = straight_motions(given)
    is_approach = jnp.asarray(given.problems.straight_kind) == StraightKind.APPROACH
    is_motion = ((jnp.asarray(given.problems.straight_distance) > 0) & is_approach)[..., None]
    rows = jnp.where(is_motion, motions.offset[..., -1, LINE_ROWS], 0)
    jacobian = StraightJacobian(
        *(
            jnp.where(is_motion[..., None], value[..., -1, LINE_ROWS, :], 0)
            for value in (motions.by_near, motions.by_far)
        )
    )
    sideways = jnp.sqrt((rows[..., :2] ** 2).sum(-1)).max(axis=(1, 2))
    angle = jnp.where(is_motion[..., 0], motions.angle[..., -1], 0).max(axis=(1, 2))
    return Evaluation(rows, jacobian, (sideways, angle))


def _empty_line_jacobian(horizon: Horizon, zeros: Callable[..., Any]) -> StraightJacobian:
    shape = (*_line_shape(horizon), horizon.joints)
    return StraightJacobian(zeros(*shape), zeros(*shape))


def _evaluate_corridor(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows of the corridor; those of a motion that is none are -1."""
    B, K = given.x.m.shape[:2]
    between = given.problems.sample_fraction.shape[2] - 1
    number = 1 + between * CORRIDOR_ROWS
    if given.x.q.shape[1] == K:
        return _no_rows(given, number, 2)
    motions = straight_motions(given)
    distance = jnp.asarray(given.problems.straight_distance)[..., None]
    is_motion = distance > 0
    is_vertical = jnp.asarray(given.problems.straight_kind) == StraightKind.VERTICAL
    is_vertical = is_vertical[..., None, None]

    def bounded(value: Array) -> Array:
        """Take the points whose sides are bounded: the far end stands in for the first one of a vertical motion."""
        condition = is_vertical.reshape(is_vertical.shape + (1,) * (value.ndim - is_vertical.ndim))
        return jnp.where(condition, value[:, :, :, 1:], value[:, :, :, :-1])

    # The distance of the far end, then for each bounded point the corridor's sides +x, +y, -x, -y.
    aside = bounded(motions.offset)[..., :2]
    width = jnp.where(is_vertical, LIFT_CORRIDOR, CORRIDOR)
    sides = jnp.concatenate([aside, -aside], axis=-1) - width
    rows = jnp.concatenate(
        [distance + motions.offset[..., -1, 2:3], sides.reshape(B, K, MOTIONS, number - 1)],
        axis=-1,
    )

    def of_rows(value: Array) -> Array:
        """Derivatives of the rows: (B, K, 2, M, 6, D) to (B, K, 2, rows, D)."""
        across = bounded(value)[..., :2, :]
        both = jnp.concatenate([across, -across], axis=-2)
        both = both.reshape(B, K, MOTIONS, number - 1, value.shape[-1])
        found = jnp.concatenate([value[..., -1, 2:3, :], both], axis=-2)
        return jnp.where(is_motion[..., None], found, 0)

    rows = jnp.where(is_motion, rows, -1)
    too_short = jnp.maximum(rows[..., 0].max(axis=(1, 2)), 0)
    too_far = jnp.maximum(rows[..., 1:].max(axis=(1, 2, 3), initial=-1), 0)
    return Evaluation(
        rows,
        StraightJacobian(of_rows(motions.by_near), of_rows(motions.by_far)),
        (too_short, too_far),
    )


def _no_rows(given: EvaluationInput, rows: int, measures: int) -> Evaluation:
    """Return the evaluation of a keyframe NLP, which has no straight motions."""
    B = given.x.q.shape[0]
    dtype = given.x.q.dtype
    return Evaluation(
        jnp.zeros((B, 0, MOTIONS, rows), dtype), None, (jnp.zeros(B, dtype),) * measures
    )


def _line_curvature(given: EvaluationInput, multipliers: Array) -> Curvature:
    """Return the second derivatives of the rows of the straight line, times their multipliers (B, K, 2, 5)."""
    T = given.x.q.shape[1]
    K = given.x.m.shape[1]
    ends = _motion_ends(given)
    is_approach = jnp.asarray(given.problems.straight_kind) == StraightKind.APPROACH
    is_motion = (jnp.asarray(given.problems.straight_distance) > 0) & is_approach
    values = jnp.where(is_motion[..., None], multipliers, 0)

    # Only the far end has rows.
    is_far = jnp.arange(ends.position.shape[-1]) == ends.position.shape[-1] - 1
    force = ends.axes[0] * (values[..., 0, None] * is_far)
    force += ends.axes[1] * (values[..., 1, None] * is_far)
    moment = jnp.moveaxis(values[..., 2:], -1, 0)[..., None] * is_far
    return straight_curvature(ends, force, moment, near_and_far(K, T // K), T)


def _corridor_curvature(given: EvaluationInput, multipliers: Array) -> Curvature:
    """Return the second derivatives of the rows of the corridor, times their multipliers (B, K, 2, rows)."""
    T = given.x.q.shape[1]
    B, K = given.x.m.shape[:2]
    ends = _motion_ends(given)
    is_motion = (jnp.asarray(given.problems.straight_distance) > 0)[..., None]
    values = jnp.where(is_motion, multipliers, 0)

    # The bounded points are those of `_evaluate_corridor`; the sides are +x, +y, -x, -y.
    sides = values[..., 1:].reshape(B, K, MOTIONS, -1, CORRIDOR_ROWS)
    aside = sides[..., :2] - sides[..., 2:]
    nothing = jnp.zeros_like(aside[..., :1, :])
    at_points = jnp.where(
        ends.is_vertical[..., None],
        jnp.concatenate([nothing, aside], axis=-2),
        jnp.concatenate([aside, nothing], axis=-2),
    )
    is_far = jnp.arange(ends.position.shape[-1]) == ends.position.shape[-1] - 1
    force = ends.axes[0] * at_points[..., 0] + ends.axes[1] * at_points[..., 1]
    force += ends.axes[2] * (values[..., 0, None] * is_far)
    return straight_curvature(ends, force, jnp.zeros_like(force), near_and_far(K, T // K), T)


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: StraightJacobian | None,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the rows to the blocks of their two slices, and to the coupling of the later one with the earlier one."""
    T = len(x.q)
    K = len(x.m)
    if T == K or jacobian is None:
        return parts

    near, far = near_and_far(K, T // K)
    weighted_near = jacobian.by_near * active_penalty[..., None]
    weighted_far = jacobian.by_far * active_penalty[..., None]

    def product(a: Array, b: Array) -> Array:
        return jnp.einsum("kmri,kmrj->kmij", a, b)

    # The far slice of a leaving motion (0) is the later one of the two, that of a coming motion (1) the earlier one.
    leaving = product(weighted_far, jacobian.by_near)[:, 0]
    coming = product(weighted_near, jacobian.by_far)[:, 1]
    blocks = jnp.asarray(parts.blocks)
    blocks = blocks.at[near].add(product(weighted_near, jacobian.by_near))
    blocks = blocks.at[far].add(product(weighted_far, jacobian.by_far))
    coupling = jnp.asarray(parts.coupling)
    coupling = coupling.at[far[:, 0]].add(leaving).at[near[:, 1]].add(coming)
    gradient = jnp.asarray(parts.gradient_q)
    for index, part in ((near, jacobian.by_near), (far, jacobian.by_far)):
        gradient = gradient.at[index].add(jnp.einsum("kmri,kmr->kmi", part, multiplier_estimate))
    return parts._replace(blocks=blocks, coupling=coupling, gradient_q=gradient)


def _line_scale(horizon: Horizon) -> Float[np.ndarray, "phases 2 rows"]:
    scales = np.repeat([POSITION_SCALE, ROTATION_SCALE], [2, 3])
    return np.broadcast_to(scales, _line_shape(horizon))


def _corridor_scale(horizon: Horizon) -> float:
    return POSITION_SCALE


STRAIGHT_LINE = ConstraintBlock(
    name="straight_line",
    kind=ConstraintKind.EQUALITY,
    measures=(
        Measure("sideways", "m", SIDEWAYS_TOLERANCE),
        Measure("turn", "rad", TURN_TOLERANCE),
    ),
    shape=_line_shape,
    scale=_line_scale,
    evaluate=_evaluate_line,
    add_to_system=_add_to_system,
    empty_jacobian=_empty_line_jacobian,
    curvature=_line_curvature,
)
"""The block that lets a hand come to an object, or leave it, from a point on the approach axis, without turning."""

STRAIGHT_CORRIDOR = ConstraintBlock(
    name="straight_corridor",
    kind=ConstraintKind.INEQUALITY,
    measures=(
        Measure("approach", "m", DISTANCE_TOLERANCE),
        Measure("corridor", "m", CORRIDOR_TOLERANCE),
    ),
    shape=_corridor_shape,
    scale=_corridor_scale,
    evaluate=_evaluate_corridor,
    add_to_system=_add_to_system,
    curvature=_corridor_curvature,
)
"""The block that makes straight motions long enough, and keeps the hand near the line between both ends."""
