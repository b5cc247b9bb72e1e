r"""The mode switch block requires that an object has the same pose under its old mode as under its new one at a switch.

It has six rows h for each action, at the last slice of its phase:

- the position of the object under the old mode minus its position under the new mode [m];
- ``2 e``, where (w, e) is the quaternion of the rotation ``R_old R_new^T``, w its scalar and e its vector part. For
  small differences this is the rotation vector [rad], with an error of third order.

Let (omega, v) be the twist of a pose: its angular velocity, and the velocity of the point at the world's origin. The
position p of the object then moves with ``v + omega x p``, and

    d(2 e)/dt = w (omega_old - omega_new) + (omega_old + omega_new) x e.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.chain_curvature import pair_products, point_curvature, turn_curvature
from dvr_jax.geometry.vectors import (
    compose,
    cross,
    half_rotation_vector,
    materialize,
    rotation_angle,
    transpose,
)
from dvr_jax.modes.mode import PARAMETERS, Attachment, ObjectPoses
from dvr_jax.modes.poses import chain_depth, object_poses
from dvr_jax.nlp.blocks.block import (
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    Measure,
    SwitchGeometry,
)
from dvr_jax.nlp.layout import attachments
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import Curvature, SystemParts

POSITION_TOLERANCE = 1e-3
"""Largest distance between the object's positions under the old and the new mode of a feasible point [m]."""

ROTATION_TOLERANCE = 1e-2
"""Largest angle between the object's orientations under the old and the new mode of a feasible point [rad]."""

POSITION_SCALE = 1.0
"""Penalty of a position row relative to the common one."""

ROTATION_SCALE = 0.1
"""Penalty of a rotation row relative to the common one."""


class SwitchJacobian(NamedTuple):
    """Derivatives of the rows by joint angles and mode parameters."""

    by_joints: Float[Array, "*batch phases 6 joints"]
    """Derivatives by the joint angles of all arms at the switch."""

    by_parameters: Float[Array, "*batch phases 6 2 4"]
    """Derivatives by the mode parameters of the old mode (index 0) and of the new mode (index 1)."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, 6)


def _scale(horizon: Horizon) -> Float[np.ndarray, "phases 6"]:
    return np.tile(np.repeat([POSITION_SCALE, ROTATION_SCALE], 3), (horizon.phases, 1))


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows, their Jacobian, and the largest distance and angle of each problem."""
    B, K = given.x.m.shape[:2]

    # Axis "objects" of these poses is the old mode (0) and the new mode (1).
    both = _both_attachments(given.problems, given.x.m)
    objects = materialize(object_poses(both, given.switches.hands))
    R = objects.rotation
    p = objects.position

    difference = materialize(compose(R[:, :, 0], transpose(R[:, :, 1])))
    w, v = materialize(half_rotation_vector(difference))
    rows = jnp.concatenate([p[:, 0] - p[:, 1], 2 * v]).reshape(6, B, K).transpose(1, 2, 0)
    angle = rotation_angle(difference).reshape(B, K)
    jacobian = _jacobian(given.switches, objects.twists, objects.held, p, w, v)

    position = jnp.sqrt(jnp.sum(rows[..., :3] ** 2, axis=-1)).max(axis=1)
    return Evaluation(rows, _by_problem(jacobian, B, K), (position, angle.max(axis=1)))


def _empty_jacobian(horizon: Horizon, zeros: Callable[..., Any]) -> SwitchJacobian:
    K = horizon.phases
    return SwitchJacobian(zeros(K, 6, horizon.joints), zeros(K, 6, 2, PARAMETERS))


def _both_attachments(problems: Problem, m: Array) -> Attachment:
    """Return the attachments of the switched object before and after each switch, with the batch axes (2, B K)."""
    B, K = m.shape[:2]
    item = jnp.asarray(problems.switched_object)

    def attach(phases: slice) -> Attachment:
        kind, parent, action = (
            jnp.take_along_axis(value[:, phases], item[..., None], axis=2)
            for value in (problems.mode_kind, problems.mode_parent, problems.mode_action)
        )
        found = attachments(problems, m, kind, parent, action, item)
        return jax.tree.map(lambda value: value.reshape(*value.shape[:-3], 1, B * K), found)

    old = attach(slice(0, K))
    new = attach(slice(1, K + 1))
    return materialize(jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=-2), old, new))


def _jacobian(
    switches: SwitchGeometry, twists: Array, held: Array, p: Array, w: Array, v: Array
) -> Float[Array, "6 columns 2 switches"]:
    """Compute the derivatives of the rows by joints and parameters, for the old pose (0) and the new pose (1).

    Args:
        switches: Twists of the joints at the switches.
        twists: Twists of the object by the parameters of each mode.
        held: Whether each arm holds the object under each mode.
        p: Positions of the object under both modes [m].
        w: Scalar part of the quaternion of the difference.
        v: Vector part of the quaternion of the difference, e in the module's docstring.
    """
    screws = switches.screws
    moved_by = jnp.repeat(held.astype(screws.dtype), screws.shape[1] // held.shape[0], axis=0)
    columns = materialize(jnp.concatenate([screws[:, :, None] * moved_by, twists], axis=1))
    angular = columns[:3]
    linear = columns[3:]

    side = jnp.asarray([1.0, -1.0], screws.dtype)[:, None]
    moved = linear + cross(angular, p[:, None])
    turned = w * angular + side * cross(angular, v[:, None, None])
    return materialize(side * jnp.concatenate([moved, turned]))


def _by_problem(change: Array, B: int, K: int) -> SwitchJacobian:
    """Return the derivatives with the batch axes first; those by joints are summed over both modes."""
    joints = change.shape[1] - PARAMETERS
    by_joints = change[:, :joints].sum(2).reshape(6, joints, B, K).transpose(2, 3, 0, 1)
    by_parameters = change[:, joints:].reshape(6, PARAMETERS, 2, B, K).transpose(3, 4, 0, 2, 1)
    return SwitchJacobian(by_joints, by_parameters)


def _curvature(given: EvaluationInput, multipliers: Array) -> Curvature:
    """Return the second derivatives of the rows times their multipliers (B, K, 6)."""
    B, K = given.x.m.shape[:2]
    both = _both_attachments(given.problems, given.x.m)
    objects = materialize(object_poses(both, given.switches.hands))
    values = jnp.moveaxis(multipliers, -1, 0).reshape(6, B * K)
    by_columns = _by_columns(given.switches.screws, objects, values)

    # To the slices of the switches, and to the parameters of the actions by which the object is attached.
    D = given.x.q.shape[2]
    T = given.x.q.shape[1]
    H = jnp.moveaxis(by_columns, -1, 0).reshape(B, K, D + 2 * PARAMETERS, D + 2 * PARAMETERS)
    belongs = jax.vmap(_belongs)(given.problems).astype(H.dtype)
    of_both = H[..., :D, D:].reshape(B, K, D, 2, PARAMETERS)
    of_parameters = H[..., D:, D:].reshape(B, K, 2, PARAMETERS, 2, PARAMETERS)
    border = jnp.einsum("bkdsc,bksl->bkdlc", of_both, belongs).reshape(B, K, D, -1)
    corner = jnp.einsum("bkscte,bksl,bktm->blcme", of_parameters, belongs, belongs)
    last = slice(T // K - 1, None, T // K)
    return Curvature(
        diagonal=jnp.zeros((B, T, D, D), H.dtype).at[:, last].set(H[..., :D, :D]),
        coupling=jnp.zeros((B, T, D, D), H.dtype),
        border=jnp.zeros((B, T, D, border.shape[-1]), H.dtype).at[:, last].set(border),
        corner=corner.reshape(B, K * PARAMETERS, K * PARAMETERS),
    )


def _by_columns(
    screws: Array, objects: ObjectPoses, multipliers: Array
) -> Float[Array, "columns columns switches"]:
    """Return the second derivatives by the joints, the parameters of the old mode, and those of the new mode.

    The rotation rows are those of the difference of two rotations. Where it is small, their second derivatives are
    those of the old rotation vector less those of the new one, less ``1/2 (omega_old x omega_new)`` for a variable of
    the old mode and one of the new mode.
    """
    force = multipliers[:3]
    moment = multipliers[3:]
    D = screws.shape[1]
    size = D + 2 * PARAMETERS
    total = jnp.zeros((size, size, screws.shape[-1]), screws.dtype)
    turns = []
    for side, sign in enumerate((1.0, -1.0)):
        held = objects.held[:, side]
        moved_by = jnp.repeat(held.astype(screws.dtype), D // held.shape[0], axis=0)
        columns = jnp.concatenate([screws * moved_by, objects.twists[:, :, side]], axis=1)
        depth = chain_depth(D, held.any(0))
        is_before = depth[:, None] <= depth[None]
        found = point_curvature(columns, force, objects.position[:, side], is_before)
        found += turn_curvature(columns, moment, is_before)
        own = np.r_[:D, D + side * PARAMETERS : D + (side + 1) * PARAMETERS]
        total = total.at[own[:, None], own].add(sign * found)
        turns.append(
            jnp.zeros((3, size, screws.shape[-1]), screws.dtype).at[:, own].set(columns[:3])
        )

    both = -pair_products(0.5 * cross(moment[:, None], turns[0]), turns[1])
    return total + both + both.swapaxes(0, 1)


def _belongs(problem: Problem) -> Array:
    """Return 1 where the old or the new mode's parameters at a switch are those of an action (K, 2, K), else 0."""
    item = problem.switched_object[:, None]
    actions = [
        jnp.take_along_axis(rows, item, axis=1)[:, 0]
        for rows in (problem.mode_action[:-1], problem.mode_action[1:])
    ]
    K = len(problem.switched_object)
    return jnp.stack(actions, axis=1)[..., None] == jnp.arange(K)


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: SwitchJacobian,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the rows at the last slice of each phase, and at the parameters of the old and the new mode."""
    T = len(x.q)
    K = len(x.m)
    last = slice(T // K - 1, None, T // K)

    # The parameters of the old and the new mode belong to the actions that attached the object before and after.
    belongs = jnp.asarray(_belongs(problem), x.q.dtype)
    by_joints = jacobian.by_joints
    by_parameters = jnp.einsum("krob,kol->krlb", jacobian.by_parameters, belongs).reshape(
        K, 6, K * PARAMETERS
    )

    weighted_joints = by_joints * active_penalty[..., None]
    weighted_parameters = by_parameters * active_penalty[..., None]
    return parts._replace(
        blocks=jnp.asarray(parts.blocks)
        .at[last]
        .add(jnp.einsum("kri,krj->kij", weighted_joints, by_joints)),
        border=jnp.asarray(parts.border)
        .at[last]
        .add(jnp.einsum("kri,krj->kij", weighted_joints, by_parameters)),
        corner=parts.corner + jnp.einsum("kri,krj->ij", weighted_parameters, by_parameters),
        gradient_q=jnp.asarray(parts.gradient_q)
        .at[last]
        .add(jnp.einsum("kri,kr->ki", by_joints, multiplier_estimate)),
        gradient_m=parts.gradient_m + jnp.einsum("kri,kr->i", by_parameters, multiplier_estimate),
    )


MODE_SWITCH = ConstraintBlock(
    name="mode_switch",
    kind=ConstraintKind.EQUALITY,
    measures=(
        Measure("position", "m", POSITION_TOLERANCE),
        Measure("rotation", "rad", ROTATION_TOLERANCE),
    ),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
    empty_jacobian=_empty_jacobian,
    curvature=_curvature,
)
"""The block that gives a switched object the same pose before and after its switch."""
