"""The joint limit block requires that every joint is within its range at every slice.

It has the rows ``g = (lower - q, q - upper)`` [rad] for each slice and joint; their derivatives by q are -1 and 1.
"""

from __future__ import annotations

import jax.numpy as jnp

from dvr_jax.geometry.arrays import Array
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

LIMIT_TOLERANCE = 1e-3
"""Largest excess over a joint limit that a feasible point may have [rad]."""

SCALE = 0.1
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (2, horizon.slices, horizon.joints)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows; their derivatives are constant."""
    q = given.x.q
    lower, upper = jnp.asarray(given.joint_limits, q.dtype)
    rows = jnp.stack([lower - q, q - upper], axis=1)
    return Evaluation(rows, None, (jnp.maximum(rows.max(axis=(1, 2, 3)), 0),))


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: None,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the rows to the diagonals of the blocks A_t; index 0 is the lower limit, index 1 the upper one."""
    return parts._replace(
        joint_diagonal=parts.joint_diagonal + active_penalty[0] + active_penalty[1],
        gradient_q=parts.gradient_q + multiplier_estimate[1] - multiplier_estimate[0],
    )


JOINT_LIMIT = ConstraintBlock(
    name="joint_limit",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("joint_limit", "rad", LIMIT_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""The block that keeps joints within their ranges."""
