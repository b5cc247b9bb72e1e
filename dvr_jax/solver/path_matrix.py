"""The matrix of a path's quadratic program, made positive definite and factorized.

The matrix is the Hessian of the Lagrangian: that of the cost, and the curvature C of the constraints weighted with the
multipliers of the last quadratic program (`dvr_jax.nlp.curvature`). To it belong the damping, the penalty of the
linearized equalities, and a penalty w of the linearized inequalities that had a multiplier,

    H + factor C + damping I + p J_h^T J_h + J^T diag(w) J.

The last two terms change nothing along the constraints, where the matrix is positive definite near an optimum. They
make up for the negative curvature that C has across the constraints. Where the matrix is still indefinite, the factor
of the curvature shrinks (`FACTORS`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, ConstraintKind, Horizon
from dvr_jax.nlp.curvature import add_curvature
from dvr_jax.nlp.evaluation import FlatResiduals, gauss_newton_system, row_scales, unflatten
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import BorderedSystem, Curvature
from dvr_jax.nlp.working_rows import RowDerivatives
from dvr_jax.solver.banded import BorderedFactor, factorize_bordered
from dvr_jax.solver.sequential import SequentialSettings

EQUALITY_BLOCKS = [block for block in CONSTRAINT_BLOCKS if block.kind is ConstraintKind.EQUALITY]
"""The constraint blocks whose rows are equalities."""

FACTORS = (1.0, 0.25, 0.0625, 0.0)
"""Factors of the curvature, of which the first one that makes the matrix positive definite is taken."""

ROW_PENALTY = 30.0
"""Penalty of linearized inequalities that had a multiplier [1/m^2]."""

PENALIZED_ROWS = 16
"""Largest number of such rows for each phase; an optimum has five to fifteen."""


class _Attempt(NamedTuple):
    """State of the search for a factor."""

    number: Int[Array, ""]
    """Number of factorizations so far."""

    factor: BorderedFactor
    """The last one."""


def factorize_convexified(
    system: BorderedSystem,
    curvature: Curvature,
    rows: RowDerivatives,
    weights: Float[Array, " rows"],
    damping: Float[Array, ""],
) -> tuple[BorderedFactor, Float[Array, ""]]:
    """Factorize the matrix of one path with as much of the curvature as leaves it positive definite.

    Args:
        system: The system of cost and penalized equalities.
        curvature: The curvature C.
        rows: Derivatives of the working rows.
        weights: Penalties w of the working rows; rows beyond `PENALIZED_ROWS` for each phase must have none.
        damping: Number that is added to the whole diagonal.

    Returns:
        The factor, and the factor of the curvature.
    """
    penalized = _add_rows(system, rows, weights)
    factors = jnp.asarray(FACTORS, damping.dtype)

    def is_indefinite(state: _Attempt) -> Array:
        failed = ~jnp.all(jnp.isfinite(state.factor.corner_inverse))
        return (state.number == 0) | (failed & (state.number < len(FACTORS)))

    def attempt(state: _Attempt) -> _Attempt:
        matrix = add_curvature(penalized, curvature, factors[state.number])
        return _Attempt(state.number + 1, factorize_bordered(matrix, damping))

    shapes = jax.eval_shape(factorize_bordered, system, damping)
    nothing = jax.tree.map(lambda value: jnp.zeros(value.shape, value.dtype), shapes)
    start = _Attempt(jnp.zeros((), jnp.int32), nothing)
    found = jax.lax.while_loop(is_indefinite, attempt, start)
    return found.factor, factors[found.number - 1]


def row_weights(had_multiplier: Float[Array, " rows"], phases: int) -> Float[Array, " rows"]:
    """Return the penalties of working rows.

    Args:
        had_multiplier: Multipliers of the last quadratic program.
        phases: Number of phases.
    """
    had = had_multiplier > 0
    is_kept = had & (jnp.cumsum(had) <= PENALIZED_ROWS * phases)
    return jnp.where(is_kept, ROW_PENALTY, 0.0)


def _add_rows(
    system: BorderedSystem, rows: RowDerivatives, weights: Float[Array, " rows"]
) -> BorderedSystem:
    """Return the system with ``J^T diag(w) J`` of the working rows in its matrix."""
    assert system.coupling is not None
    number = min(len(weights), PENALIZED_ROWS * rows.by_parameters.shape[0] // PARAMETERS)
    chosen = jnp.nonzero(weights > 0, size=number, fill_value=len(weights))[0]
    root = jnp.sqrt(jnp.asarray(weights).at[chosen].get(mode="fill", fill_value=0.0))
    q = jnp.asarray(rows.by_joints).at[..., chosen].get(mode="clip") * root
    m = jnp.asarray(rows.by_parameters).at[..., chosen].get(mode="clip") * root

    # A row depends on one slice and on the slice before it.
    before = jnp.concatenate([jnp.zeros_like(q[:1]), q[:-1]])
    return system._replace(
        diagonal=system.diagonal + q @ q.swapaxes(1, 2),
        coupling=system.coupling + q @ before.swapaxes(1, 2),
        border=system.border + q @ m.T,
        corner=system.corner + m @ m.T,
    )


def penalized_system(
    problem: Problem,
    x: Variables,
    settings: SequentialSettings,
    horizon: Horizon,
    jacobians: dict[str, Any],
    equalities: Array,
) -> BorderedSystem:
    """Return the system of cost and penalized equalities; with derivatives of another point it has only its gradient.

    Args:
        problem: The NLP.
        x: The point at which the gradient of the cost is computed.
        settings: Settings of the method.
        horizon: Sizes of the NLP.
        jacobians: Derivatives of the equalities.
        equalities: Values of the equalities.
    """
    scales = row_scales(horizon, x.q.dtype)
    penalty = settings.equality_penalty * scales.equality
    nothing = FlatResiduals(jnp.zeros(()), equalities, jnp.zeros_like(scales.inequality))
    return gauss_newton_system(
        problem,
        x,
        jacobians,
        unflatten(nothing._replace(equality=penalty * equalities), horizon),
        unflatten(nothing._replace(equality=penalty), horizon),
        blocks=EQUALITY_BLOCKS,
    )
