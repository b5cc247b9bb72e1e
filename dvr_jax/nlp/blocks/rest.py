"""Rest: an arm that takes part in a switch does not move in the interval before it.

Rows for each switch k of a path: ``h = rest_k (q_t - q_{t-1})`` at the switch's slice t, zero for arms that need not
rest. In this interval the fingers close. Keyframes have no such rows.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

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

REST_TOLERANCE = 3e-3
"""Largest step of a joint [rad/slice]: 2.4 mm at a distance of 0.8 m from the joint."""

SCALE = 0.1
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases if horizon.is_path else 0, horizon.joints)


def _scale(horizon: Horizon) -> float:
    return SCALE


def joints_at_rest(arm_at_rest: Array, joints: int) -> Float[Array, "*batch joints"]:
    """1 for each joint of an arm at rest, else 0.

    Args:
        arm_at_rest: 1 for each arm at rest (..., A).
        joints: Number of joints of all arms.
    """
    return jnp.repeat(arm_at_rest, joints // arm_at_rest.shape[-1], axis=-1)


def _evaluate(given: EvaluationInput) -> Evaluation:
    q = given.x.q
    B, K = given.x.m.shape[:2]
    S = q.shape[1] // K
    if S == 1:
        return Evaluation(jnp.zeros((B, 0, q.shape[2]), q.dtype), None, (jnp.zeros(B, q.dtype),))
    steps = q[:, S - 1 :: S] - q[:, S - 2 :: S]
    rows = steps * joints_at_rest(given.problems.arm_at_rest, q.shape[2])
    return Evaluation(rows, None, (jnp.abs(rows).max(axis=(1, 2)),))


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: None,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    T, D = x.q.shape
    K = len(x.m)
    if T == K:
        return parts

    # A row couples the switch's slice with the one before it, joint by joint.
    last = slice(T // K - 1, None, T // K)
    at_rest = joints_at_rest(problem.arm_at_rest, D)
    zeros = jnp.zeros((T, D), x.q.dtype)
    penalty = zeros.at[last].set(active_penalty * at_rest)
    estimate = zeros.at[last].set(multiplier_estimate * at_rest)
    one = jnp.zeros((1, D), x.q.dtype)
    return parts._replace(
        joint_diagonal=parts.joint_diagonal + penalty + jnp.concatenate([penalty[1:], one]),
        coupling_diagonal=parts.coupling_diagonal - penalty,
        gradient_q=parts.gradient_q + estimate - jnp.concatenate([estimate[1:], one]),
    )


REST = ConstraintBlock(
    name="rest",
    kind=ConstraintKind.EQUALITY,
    measures=(Measure("rest", "rad/slice", REST_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""Arms rest as they take or give."""
