"""The on-top block requires that the center of an object that an action puts on another object is over its top.

It has four rows g for each action, in the frame of the lower object: by how much the center of the upper object is
beyond the sides +x, +y, -x and -y of the area that is allowed on the top [m]. With the centers p and p_l of both
objects, the yaw a of the lower one and the half extents s of the area,

    d = R(a)^T (p - p_l),        rows  d - s  and  -d - s.

The lower object stands where the scene has it, or where the mode parameters of an earlier action put it. The rows
depend on these parameters too: this is how an upper object follows the one below it. Its own parameters stay those of
a pose in the world, because a lower object does not move while another one stands on it. A scene in which no object is
a support has no rows. For an action that puts nothing on an object, the rows are the constant -1.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS, ModeKind
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

ON_TOP_TOLERANCE = 1e-3
"""Largest distance by which the center of a feasible point may be beyond the allowed area [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""

SIDES = 4
"""Number of sides of the area."""


class OnTopJacobian(NamedTuple):
    """Derivatives of the rows by the parameters of two actions."""

    by_own: Float[Array, "*batch phases 4 parameters"]
    """Derivatives by the parameters of the action itself."""

    by_lower: Float[Array, "*batch phases 4 parameters"]
    """Derivatives by the parameters of the action that placed the lower object; zero if none did."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, SIDES * horizon.tops)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _of_lower(problems: Problem, values: Int[Array, "*batch states objects"]) -> Array:
    """Return the entries of the lower object of each action, from its state before the action (..., K)."""
    lower = jnp.asarray(problems.top_object)
    states = jnp.asarray(values)[..., : lower.shape[-2], :]
    return jnp.take_along_axis(states, lower, axis=-1)[..., 0]


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows (B, K, 4), and their Jacobians (B, K, 4, 4) by the parameters of both actions."""
    problems = given.problems
    m = given.x.m
    B, K = m.shape[:2]
    if problems.top_object.shape[-1] == 0:
        none = jnp.zeros((B, K, 0), m.dtype)
        empty = jnp.zeros((B, K, 0, PARAMETERS), m.dtype)
        return Evaluation(none, OnTopJacobian(empty, empty), (none.sum((1, 2)),))

    half = jnp.asarray(problems.top_half)[..., 0, :]
    action = _of_lower(problems, problems.mode_action)
    is_placed = (_of_lower(problems, problems.mode_kind) == ModeKind.PLACED)[..., None]
    placed = jnp.take_along_axis(m, action[..., None], axis=1)[..., :3]
    poses = jnp.asarray(problems.initial_pose)[..., jnp.asarray([0, 1, 3])]
    standing = jnp.take_along_axis(poses, problems.top_object, axis=1)
    x, y, yaw = jnp.moveaxis(jnp.where(is_placed, placed, standing), -1, 0)

    c = jnp.cos(yaw)
    s = jnp.sin(yaw)
    dx = m[..., 0] - x
    dy = m[..., 1] - y
    along = c * dx + s * dy
    across = c * dy - s * dx
    offset = jnp.stack([along, across], axis=-1)
    rows = jnp.concatenate([offset - half, -offset - half], axis=-1)

    zero = jnp.zeros_like(c)
    own = _both_signs(jnp.stack([c, s, zero, zero], -1), jnp.stack([-s, c, zero, zero], -1))
    lower = _both_signs(jnp.stack([-c, -s, across, zero], -1), jnp.stack([s, -c, -along, zero], -1))

    is_on_top = (half[..., 0] > 0)[..., None]
    rows = jnp.where(is_on_top, rows, -1)
    own = jnp.where(is_on_top[..., None], own, 0)
    lower = jnp.where((is_on_top & is_placed)[..., None], lower, 0)
    worst = jnp.maximum(rows.max(axis=(1, 2)), 0)
    return Evaluation(rows, OnTopJacobian(own, lower), (worst,))


def _both_signs(along: Array, across: Array) -> Float[Array, "batch phases 4 parameters"]:
    """Return the derivatives of the four rows from those of the two offsets."""
    return jnp.stack([along, across, -along, -across], axis=-2)


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: OnTopJacobian,
    multiplier_estimate: Float[Array, "phases rows"],
    active_penalty: Float[Array, "phases rows"],
) -> SystemParts:
    """Add the rows to the corner: each couples the parameters of its action with those of an earlier one."""
    if problem.top_object.shape[-1] == 0:
        return parts

    K = len(x.m)
    dtype = x.m.dtype
    placed_by = jnp.asarray(
        _of_lower(problem, problem.mode_action)[:, None] == jnp.arange(K), dtype
    )
    J = jnp.einsum("kri,kl->krli", jacobian.by_own, jnp.eye(K, dtype=dtype))
    J += jnp.einsum("kri,kl->krli", jacobian.by_lower, placed_by)
    J = J.reshape(K * SIDES, K * PARAMETERS)
    penalty = active_penalty.reshape(-1, 1)
    return parts._replace(
        corner=parts.corner + J.T @ (penalty * J),
        gradient_m=parts.gradient_m + J.T @ multiplier_estimate.reshape(-1),
    )


ON_TOP = ConstraintBlock(
    name="on_top",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("on_top", "m", ON_TOP_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""The block that keeps the centers of objects over the tops of those on which they stand."""
