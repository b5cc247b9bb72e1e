"""Bounds of the mode parameters: a grasp stays on its face, a pitch within its range.

Rows ``g = (lower - m, m - upper)`` for each action and parameter [m or rad].
"""

from __future__ import annotations

import jax.numpy as jnp

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
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

BOUND_TOLERANCE = 1e-3
"""Largest excess over a bound [m or rad]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (2, horizon.phases, PARAMETERS)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    m = given.x.m
    rows = jnp.stack(
        [given.problems.parameter_lower - m, m - given.problems.parameter_upper], axis=1
    )
    return Evaluation(rows, None, (jnp.maximum(rows.max(axis=(1, 2, 3)), 0),))


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: None,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    penalty = active_penalty[0] + active_penalty[1]
    return parts._replace(
        corner=parts.corner + jnp.diag(penalty.reshape(-1)),
        gradient_m=parts.gradient_m + (multiplier_estimate[1] - multiplier_estimate[0]).reshape(-1),
    )


PARAMETER_BOUND = ConstraintBlock(
    name="parameter_bound",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("parameter_bound", "m or rad", BOUND_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""Mode parameters stay within their bounds."""
