"""The collision block requires that all pairs of bodies that can touch are apart at every sample of the motion.

It has one row ``g = -distance`` [m] for each of the T M samples (T slices, M samples in the interval before each) and
each of the P pairs of bodies (`dvr_jax.nlp.collision_rows`). The Jacobian of all rows is never stored. Instead,
`dvr_jax.nlp.slices.reduce_slices` sums ``J^T e`` and ``J^T diag(a) J`` over the active rows of each sample
(`dvr_jax.nlp.blocks.block`), and this block adds the sums to the system. A sample at the fraction s of the interval
before slice t has the joint angles ``(1 - s) q_{t-1} + s q_t`` plus a constant, so its derivative by q_t has the factor
s and its derivative by q_{t-1} the factor 1 - s.
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
from dvr_jax.nlp.slices import NormalEquations
from dvr_jax.nlp.system import SystemParts

PENETRATION_TOLERANCE = 1e-3
"""Deepest penetration that a feasible point may have [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.slices * horizon.samples, horizon.collision_rows)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows; their Jacobian is None, because `reduce_slices` computes the sums from the geometry."""
    # XLA's minimum can lose a NaN, depending on how it divides the array.
    distance = given.distance
    deepest = jnp.maximum(-distance.min(axis=(1, 2)), 0)
    deepest = jnp.where(jnp.isfinite(distance).all(axis=(1, 2)), deepest, jnp.nan)
    return Evaluation(-distance, None, (deepest,))


def _sum_over_samples(weights: Array, value: Array) -> Array:
    """Return the weighted sum over the M samples of each slice; weights (T, M), values (T M, ...)."""
    T, M = weights.shape
    samples = value.reshape(T, M, *value.shape[1:])
    weights = weights.reshape(T, M, *(1,) * (value.ndim - 1))
    return sum(weights[:, m] * samples[:, m] for m in range(M))  # type: ignore[return-value]


def _from_next(value: Array) -> Array:
    """Return the values of slice t + 1 at slice t; those of slice 0 are dropped, as home is no variable."""
    return jnp.concatenate([value[1:], jnp.zeros_like(value[:1])])


def _sum_over_phases(matrix: Array, gradient: Array, belongs: Array) -> tuple[Array, Array]:
    """Matrix and gradient of the mode parameters of all actions.

    The parameters do not change within a phase, so all samples of a phase are summed up.

    Args:
        matrix: Matrices of all samples by the parameters of the N objects (T M, 4 N, 4 N).
        gradient: Gradients (T M, 4 N).
        belongs: 1 where an object's parameters in a phase are those of an action (K, N, K), else 0.

    Returns:
        Matrix (4 K, 4 K) and gradient (4 K,).
    """
    K, N = belongs.shape[:2]
    in_phase = matrix.reshape(K, -1, PARAMETERS, N, PARAMETERS, N).sum(1)
    corner = jnp.einsum("kcndo,knl,koj->lcjd", in_phase, belongs, belongs)
    by_object = gradient.reshape(K, -1, PARAMETERS, N).sum(1)
    of_actions = jnp.einsum("kcn,knl->lc", by_object, belongs)
    return corner.reshape(K * PARAMETERS, -1), of_actions.reshape(-1)


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: NormalEquations,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the sums of all samples to the blocks of the system; `jacobian` contains these sums.

    Their C = D + 4 N columns are the D joints, then parameter after parameter of the N objects.
    """
    T, D = x.q.shape
    K = len(x.m)
    N = problem.prism.shape[0]
    fraction = jnp.asarray(problem.sample_fraction)
    M = fraction.shape[1]
    matrix = jacobian.matrix
    gradient = jacobian.gradient

    # Each object's parameter columns belong to the action that it is attached by in this phase.
    belongs = jnp.asarray(problem.mode_action[:-1, :, None] == jnp.arange(K), matrix.dtype)

    def to_actions(value: Array) -> Array:
        """Map columns of the objects' parameters (T, D, 4 N) to columns of the actions' parameters (T, D, 4 K)."""
        local = value.reshape(K, T // K, -1, PARAMETERS, N)
        return jnp.einsum("ksicn,knl->ksilc", local, belongs).reshape(T, -1, K * PARAMETERS)

    # Joint angles: a sample contributes s^2 to block A_t, (1 - s)^2 to A_{t-1}, and s (1 - s) to the coupling B1_t.
    of_joints = matrix[:, :D, :D]
    of_both = matrix[:, :D, D:]
    blocks = _sum_over_samples(fraction**2, of_joints)
    gradient_q = _sum_over_samples(fraction, gradient[:, :D])
    border = to_actions(_sum_over_samples(fraction, of_both))
    coupling = parts.coupling
    if M > 1:
        rest = 1 - fraction
        blocks += _from_next(_sum_over_samples(rest**2, of_joints))
        gradient_q += _from_next(_sum_over_samples(rest, gradient[:, :D]))
        border += _from_next(to_actions(_sum_over_samples(rest, of_both)))
        coupling = coupling + _sum_over_samples(fraction * rest, of_joints)

    corner, gradient_m = _sum_over_phases(matrix[:, D:, D:], gradient[:, D:], belongs)
    return parts._replace(
        blocks=parts.blocks + blocks,
        coupling=coupling,
        border=parts.border + border,
        corner=parts.corner + corner,
        gradient_q=parts.gradient_q + gradient_q,
        gradient_m=parts.gradient_m + gradient_m,
    )


COLLISION = ConstraintBlock(
    name="collision",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("penetration", "m", PENETRATION_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""The block that keeps bodies that can touch apart."""
