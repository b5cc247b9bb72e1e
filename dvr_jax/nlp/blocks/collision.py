"""Collision: at every sample of the motion all bodies that can touch are apart.

Rows ``g = -distance``, one for each sample and each pair of bodies (`dvr_jax.nlp.collision_rows`). Their Jacobian is
never written down: the active rows of each sample are summed up beforehand (`dvr_jax.nlp.slices.reduce_slices`), and
what is added here are these sums. A sample between two slices, at the fraction s of the interval, depends on both: on
slice t by the factor s, on slice t - 1 by 1 - s.
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
"""Deepest penetration of a feasible point [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.slices * horizon.samples, horizon.collision_rows)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    deepest = jnp.maximum(-given.distance.min(axis=(1, 2)), 0)
    return Evaluation(-given.distance, None, (deepest,))


def _sum_over_samples(weights: Array, value: Array) -> Array:
    """Weighted sum of the M samples of each slice; weights (T, M), values (T M, ...)."""
    T, M = weights.shape
    samples = value.reshape(T, M, *value.shape[1:])
    weights = weights.reshape(T, M, *(1,) * (value.ndim - 1))
    return sum(weights[:, m] * samples[:, m] for m in range(M))  # type: ignore[return-value]


def _from_next(value: Array) -> Array:
    """Values of slice t + 1 at slice t; what falls on the home posture before the first slice is dropped."""
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
    """Distribute the sums of the samples over slices and mode parameters; `jacobian` holds these sums."""
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
        """Columns of the objects' parameters (T, D, 4 N) to those of the actions (T, D, 4 K)."""
        local = value.reshape(K, T // K, -1, PARAMETERS, N)
        return jnp.einsum("ksicn,knl->ksilc", local, belongs).reshape(T, -1, K * PARAMETERS)

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
"""Bodies that can touch stay apart."""
