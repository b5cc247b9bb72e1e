r"""Mode switch: at a switch the object has the same pose under its old mode as under its new one.

Six rows for each action, at the last slice of its phase: position under the old mode minus that under the new one [m],
and twice the vector part of the quaternion of ``R_old R_new^T`` (the rotation vector [rad] to third order). With
twists V_old, V_new of the object's two poses, V = (omega, v), a point p of each pose moves by ``v + omega x p``, and
the quaternion (w, v) of the difference turns by

    d(2 v) = w (omega_old - omega_new) + (omega_old + omega_new) x v.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    compose,
    cross,
    half_rotation_vector,
    materialize,
    rotation_angle,
    transpose,
)
from dvr_jax.modes.mode import PARAMETERS, Attachment
from dvr_jax.modes.poses import object_poses
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
from dvr_jax.nlp.system import SystemParts

POSITION_TOLERANCE = 1e-3
"""Largest distance between the object's positions under the old and the new mode [m]."""

ROTATION_TOLERANCE = 1e-2
"""Largest angle between its orientations [rad]."""

POSITION_SCALE = 1.0
ROTATION_SCALE = 0.1
"""Penalties of the rows relative to the common one."""


class SwitchJacobian(NamedTuple):
    """Derivatives of the rows."""

    by_joints: Float[Array, "*batch phases 6 joints"]
    by_parameters: Float[Array, "*batch phases 6 2 4"]
    """By the parameters of the old and of the new mode."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, 6)


def _scale(horizon: Horizon) -> Float[np.ndarray, "phases 6"]:
    return np.tile(np.repeat([POSITION_SCALE, ROTATION_SCALE], 3), (horizon.phases, 1))


def _evaluate(given: EvaluationInput) -> Evaluation:
    B, K = given.x.m.shape[:2]
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


def _both_attachments(problems: Problem, m: Array) -> Attachment:
    """The switched object before and after each switch, as two objects of one slice; batch axes (2, B K)."""
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
    """Derivatives of the rows by joints and parameters, through the old pose and through the new one."""
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
    """Derivatives with the batch axes first."""
    joints = change.shape[1] - PARAMETERS
    by_joints = change[:, :joints].sum(2).reshape(6, joints, B, K).transpose(2, 3, 0, 1)
    by_parameters = change[:, joints:].reshape(6, PARAMETERS, 2, B, K).transpose(3, 4, 0, 2, 1)
    return SwitchJacobian(by_joints, by_parameters)


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: SwitchJacobian,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    T = len(x.q)
    K = len(x.m)
    last = slice(T // K - 1, None, T // K)

    # The two sets of parameters belong to the actions that the object is attached by before and after the switch.
    item = problem.switched_object[:, None]
    actions = [
        jnp.take_along_axis(rows, item, axis=1)[:, 0]
        for rows in (problem.mode_action[:-1], problem.mode_action[1:])
    ]
    belongs = jnp.asarray(jnp.stack(actions, axis=1)[..., None] == jnp.arange(K), x.q.dtype)
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
)
"""The switched object does not jump."""
