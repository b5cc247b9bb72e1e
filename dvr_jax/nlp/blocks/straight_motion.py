r"""Two blocks let a hand come to a grasp, and leave an object that it has released, straight along its approach axis.

A *straight motion* lies between two neighboring slices: the *near* one, at which the hand is at the object, and the *far*
one, at which it is the distance d away. A phase of a path has two of them: the hand that released an object at the last
switch leaves it in the first interval of the phase, and the hand that grasps an object at the next switch comes to it in
the last interval but one, since the fingers move in the last one. With the poses (R_n, p_n) and (R_f, p_f) of the hand,

- the block of the straight line has five equalities: the components of ``p_f - p_n`` along the x and y axes of the near
  hand [m], and ``2 e``, where (w, e) is the quaternion of ``R_f R_n^T`` (`dvr_jax.nlp.blocks.mode_switch`) [rad];
- the block of the distance has one inequality, ``d + z_n . (p_f - p_n) <= 0`` [m], with the approach axis z_n.

A hand turns with the angular velocity omega of its joints, and its center moves with v, so that

    d(a_n . (p_f - p_n)) = a_n . v_f - a_n . (v_n + omega_n x (p_f - p_n))                  for an axis a_n of the near hand,
    d(2 e) = w (omega_f - omega_n) + (omega_f + omega_n) x e.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

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
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import SystemParts

SIDEWAYS_TOLERANCE = 2e-3
"""Largest distance of the far hand of a feasible point from the straight line [m]."""

TURN_TOLERANCE = 2e-2
"""Largest turn of the hand between both ends of a straight motion of a feasible point [rad]."""

DISTANCE_TOLERANCE = 2e-3
"""By how much the straight motion of a feasible point may be shorter than asked for [m]."""

POSITION_SCALE = 1.0
"""Penalty of a row in meters relative to the common one."""

ROTATION_SCALE = 0.1
"""Penalty of a row in radians relative to the common one."""

MOTIONS = 2
"""Number of straight motions of a phase: one that leaves the last switch, and one that comes to the next one."""


class StraightMotions(NamedTuple):
    """All straight motions of B problems, with their derivatives; the axes are B problems, K phases and 2 motions."""

    offset: Float[Array, "batch phases 2 6"]
    """Components of ``p_f - p_n`` along x, y and z of the near hand [m], and 2 e [rad]."""

    angle: Float[Array, "batch phases 2"]
    """Turn of the hand [rad]."""

    by_near: Float[Array, "batch phases 2 6 joints"]
    """Derivatives by the joint angles of all arms at the near slice."""

    by_far: Float[Array, "batch phases 2 6 joints"]
    """Derivatives by the joint angles of all arms at the far slice."""


class StraightJacobian(NamedTuple):
    """Derivatives of the rows of a block by the joint angles at both ends of the straight motions."""

    by_near: Float[Array, "*batch phases 2 rows joints"]
    by_far: Float[Array, "*batch phases 2 rows joints"]


def near_and_far(phases: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the near and the far slices (K, 2) of all straight motions; that of a motion that is none is -1.

    Args:
        phases: Number K of phases.
        steps: Number S of slices in each phase.
    """
    first = np.arange(phases) * steps
    near = np.stack([first - 1, first + steps - 2], axis=1)
    far = np.stack([first, first + steps - 3], axis=1)
    return near, far


def straight_motions(given: EvaluationInput) -> StraightMotions:
    """Compute all straight motions and their derivatives."""
    problems = given.problems
    B, T, D = given.x.q.shape
    K = given.x.m.shape[1]
    arms = problems.straight_arm
    hands = given.hands
    A = hands.position.shape[1]

    near, far = (np.maximum(index, 0).reshape(-1) for index in near_and_far(K, T // K))
    own = jnp.asarray(arms.reshape(B, -1)[None] == jnp.arange(A)[:, None, None], given.x.q.dtype)

    def of_arm(value: Array, index: np.ndarray) -> Array:
        """Take (..., A, B, T) at slices, and of each motion the arm that moves: (..., B, 2 K)."""
        return materialize((value[..., index] * own).sum(-3))

    R_n = of_arm(hands.rotation, near)
    R_f = of_arm(hands.rotation, far)
    p_n = of_arm(hands.position, near)
    p_f = of_arm(hands.position, far)
    apart = materialize(p_f - p_n)
    difference = materialize(compose(R_f, transpose(R_n)))
    w, e = materialize(half_rotation_vector(difference))

    # Twists of the joints (6, D, B, 2 K); those of other arms than the one that moves are zero.
    moves = jnp.repeat(own, D // A, axis=0)
    screws_n, screws_f = materialize((given.screws[..., near] * moves, given.screws[..., far] * moves))
    turn_n, turn_f = screws_n[:3], screws_f[:3]
    v_n = screws_n[3:] + cross(turn_n, p_n[:, None])
    v_f = screws_f[3:] + cross(turn_f, p_f[:, None])
    v_n, v_f = materialize((v_n + cross(turn_n, apart[:, None]), v_f))

    offset = [dot(R_n[i], apart) for i in range(3)]
    near_rows = [-dot(R_n[i][:, None], v_n) for i in range(3)]
    far_rows = [dot(R_n[i][:, None], v_f) for i in range(3)]
    e_columns = e[:, None]
    near_turn = -w * turn_n + cross(turn_n, jnp.broadcast_to(e_columns, turn_n.shape))
    far_turn = w * turn_f + cross(turn_f, jnp.broadcast_to(e_columns, turn_f.shape))

    def by_motion(rows: list[Array], turns: Array) -> Array:
        """Stack rows (6, ..., B, 2 K) to (B, K, 2, 6, ...)."""
        stacked = jnp.concatenate([jnp.stack(rows), turns])
        motions = stacked.reshape(*stacked.shape[:-1], K, MOTIONS)
        return jnp.moveaxis(motions, (-3, -2, -1), (0, 1, 2))

    return StraightMotions(
        offset=by_motion(offset, 2 * e),
        angle=rotation_angle(difference).reshape(B, K, MOTIONS),
        by_near=by_motion(near_rows, near_turn),
        by_far=by_motion(far_rows, far_turn),
    )


def _shape(horizon: Horizon, rows: int) -> tuple[int, ...]:
    return (horizon.phases if horizon.is_path else 0, MOTIONS, rows)


def _evaluate_line(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows of the straight line."""
    if given.x.q.shape[1] == given.x.m.shape[1]:
        return _no_rows(given, 5, 2)
    motions = straight_motions(given)
    is_motion = (given.problems.straight_distance > 0)[..., None]
    chosen = np.array([0, 1, 3, 4, 5])
    rows = jnp.where(is_motion, motions.offset[..., chosen], 0)
    jacobian = StraightJacobian(
        *(
            jnp.where(is_motion[..., None], value[..., chosen, :], 0)
            for value in (motions.by_near, motions.by_far)
        )
    )
    sideways = jnp.sqrt((rows[..., :2] ** 2).sum(-1)).max(axis=(1, 2))
    angle = jnp.where(is_motion[..., 0], motions.angle, 0).max(axis=(1, 2))
    return Evaluation(rows, jacobian, (sideways, angle))


def _evaluate_distance(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows of the distance; that of a motion that is none is -1."""
    if given.x.q.shape[1] == given.x.m.shape[1]:
        return _no_rows(given, 1, 1)
    motions = straight_motions(given)
    distance = given.problems.straight_distance[..., None]
    is_motion = distance > 0
    rows = jnp.where(is_motion, distance + motions.offset[..., 2:3], -1)
    jacobian = StraightJacobian(
        *(
            jnp.where(is_motion[..., None], value[..., 2:3, :], 0)
            for value in (motions.by_near, motions.by_far)
        )
    )
    return Evaluation(rows, jacobian, (jnp.maximum(rows.max(axis=(1, 2, 3)), 0),))


def _no_rows(given: EvaluationInput, rows: int, measures: int) -> Evaluation:
    """Return the evaluation of a keyframe NLP, which has no straight motions."""
    B = given.x.q.shape[0]
    dtype = given.x.q.dtype
    return Evaluation(
        jnp.zeros((B, 0, MOTIONS, rows), dtype), None, (jnp.zeros(B, dtype),) * measures
    )


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: StraightJacobian,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the rows to the blocks of their two slices, and to the coupling of the later one with the earlier one."""
    T = len(x.q)
    K = len(x.m)
    if T == K:
        return parts

    # A motion of phase 0 that leaves a switch does not exist; its rows are zero.
    near, far = (np.maximum(index, 0) for index in near_and_far(K, T // K))
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


def _line_scale(horizon: Horizon) -> Float[np.ndarray, "phases 2 5"]:
    scales = np.repeat([POSITION_SCALE, ROTATION_SCALE], [2, 3])
    return np.broadcast_to(scales, _shape(horizon, 5))


def _distance_scale(horizon: Horizon) -> float:
    return POSITION_SCALE


STRAIGHT_LINE = ConstraintBlock(
    name="straight_line",
    kind=ConstraintKind.EQUALITY,
    measures=(
        Measure("sideways", "m", SIDEWAYS_TOLERANCE),
        Measure("turn", "rad", TURN_TOLERANCE),
    ),
    shape=lambda horizon: _shape(horizon, 5),
    scale=_line_scale,
    evaluate=_evaluate_line,
    add_to_system=_add_to_system,
)
"""The block that keeps a hand on a straight line as it comes to an object or leaves it."""

STRAIGHT_DISTANCE = ConstraintBlock(
    name="straight_distance",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("approach", "m", DISTANCE_TOLERANCE),),
    shape=lambda horizon: _shape(horizon, 1),
    scale=_distance_scale,
    evaluate=_evaluate_distance,
    add_to_system=_add_to_system,
)
"""The block that makes these straight motions as long as asked for."""
