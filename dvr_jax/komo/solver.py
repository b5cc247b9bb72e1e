"""Augmented-Lagrangian Gauss-Newton: many NLPs of the same shape at once, in chunks of iterations.

One iteration evaluates all rows with Jacobians at the trial point, accepts it if the augmented Lagrangian fell (else
the damping grows), and solves the banded Gauss-Newton system for the next trial point. When the steps of a subproblem
have become small, multipliers are updated and the penalty grows if the violation did not fall enough. Every lane
carries a status; nothing is raised under jit, and a lane that has ended no longer changes."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import materialize
from dvr_jax.komo.banded import BorderedSystem, solve_bordered
from dvr_jax.komo.constraints import Jacobians, Rows, evaluate
from dvr_jax.komo.lagrangian import (
    Multipliers,
    Weights,
    augmented_value,
    gauss_newton_system,
    penalties,
    residuals,
    update_multipliers,
    zero_multipliers,
)
from dvr_jax.komo.problem import Problem, Variables
from dvr_jax.komo.verdict import Violations, measure_violations

RUNNING, FEASIBLE, STAGNATED, ITERATION_LIMIT, NUMERICAL_FAILURE = 0, 1, 2, 3, 4
"""Status of a lane. Only FEASIBLE says that the verdict's tolerances hold."""

STATUS_WORDS = {
    RUNNING: "running",
    FEASIBLE: "feasible",
    STAGNATED: "infeasible: violation stagnated",
    ITERATION_LIMIT: "infeasible: iteration limit",
    NUMERICAL_FAILURE: "infeasible: numerical failure",
}


class Settings(NamedTuple):
    """Settings of the solver; numbers, so that changing one needs no new compilation."""

    weights: Weights = Weights()
    penalty: float = 1e4
    """Initial penalty [1/m^2]."""
    penalty_growth: float = 5.0
    """Factor of the penalty where the violation did not fall to `sufficient_decrease` of its last value."""
    penalty_limit: float = 1e7
    sufficient_decrease: float = 0.5
    step_limit: float = 0.3
    """Largest change of one joint in one iteration [rad]; the whole step is scaled."""
    step_tolerance: float = 1e-2
    """A subproblem has ended when no joint moved more than this [rad] ..."""
    inner_limit: int = 6
    """... or after so many iterations."""
    damping: float = 1e-3
    """Initial damping, added to the diagonal."""
    damping_limit: float = 1e4
    final_step: float = 1e-1
    """A feasible lane ends when its last accepted step was no longer than this [rad]."""
    iteration_limit: int = 50
    patience: int = 5
    """A lane stagnates after so many multiplier updates in a row without a violation 10 % below the best."""


class State(NamedTuple):
    """One lane of the solver."""

    x: Variables
    """Last accepted point."""
    step: Variables
    """Step to the trial point."""
    multipliers: Multipliers
    penalty: Array
    damping: Array
    value: Array
    """Augmented Lagrangian at `x` under the present multipliers and penalty."""
    system: BorderedSystem
    """Gauss-Newton system at `x`, likewise."""
    violations: Violations
    """At `x`."""
    updated_ratio: Array
    """Violation ratio at the last multiplier update."""
    best_ratio: Array
    """Least violation ratio so far."""
    inner: Array
    """Iterations since the last multiplier update."""
    stale: Array
    """Multiplier updates in a row without progress."""
    iterations: Array
    status: Array


class Solution(NamedTuple):
    """What is known of a lane: its last accepted point, verdict and effort."""

    x: Variables
    violations: Violations
    status: Array
    iterations: Array


def _tree_where(condition: Array, a: State, b: State) -> State:
    return jax.tree.map(lambda u, v: jnp.where(condition, u, v), a, b)


def _start(problem: Problem, x: Variables, settings: Settings) -> State:
    """State before the first iteration; its system is a placeholder, replaced because the first trial point is
    accepted."""
    dtype = x.q.dtype
    zero, infinity = jnp.zeros((), dtype), jnp.full((), jnp.inf, dtype)

    def shapes(rows: Rows, J: Jacobians) -> tuple[Multipliers, BorderedSystem]:
        c = residuals(problem, x, rows)
        multipliers = zero_multipliers(c)
        p = penalties(settings.weights, zero, dtype)
        return multipliers, gauss_newton_system(problem, x, c, J, multipliers, p, settings.weights)

    one = jax.tree.map(lambda leaf: leaf[None], (problem, x))
    rows, J = jax.tree.map(lambda s: jax.ShapeDtypeStruct(s.shape[1:], s.dtype), jax.eval_shape(evaluate, *one))
    multipliers, system = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(shapes, rows, J))
    count = jnp.zeros((), jnp.int32)
    return State(
        x=x,
        step=jax.tree.map(jnp.zeros_like, x),
        multipliers=multipliers,
        penalty=jnp.full((), settings.penalty, dtype),
        damping=jnp.full((), settings.damping, dtype),
        value=infinity,
        system=system,
        violations=Violations(*(infinity,) * len(Violations._fields)),
        updated_ratio=infinity,
        best_ratio=infinity,
        inner=count,
        stale=count,
        iterations=count,
        status=count,
    )


def _advance(problem: Problem, settings: Settings, state: State, rows: Rows, J: Jacobians) -> State:
    """One iteration of one lane, from the rows at its trial point."""
    dtype = state.x.q.dtype
    trial = jax.tree.map(jnp.add, state.x, state.step)
    c = residuals(problem, trial, rows)
    p = penalties(settings.weights, state.penalty, dtype)
    value = augmented_value(problem, trial, c, state.multipliers, p, settings.weights)
    # Equal values count as success: at convergence steps are lost in rounding. NaN does not.
    accepted = value <= state.value + 1e-9 * jnp.abs(state.value)
    moved = jnp.abs(state.step.q).max()

    violations = measure_violations(problem, trial, rows)
    ratio = violations.ratio()
    feasible = accepted & (ratio <= 1) & (moved <= settings.final_step)
    inner = state.inner + 1
    first = jnp.isinf(state.value)
    ended = accepted & ~first & ((moved <= settings.step_tolerance) | (inner >= settings.inner_limit))

    # Multiplier update, from the rows at hand: x has just become the trial point.
    multipliers = jax.tree.map(
        lambda new, old: jnp.where(ended, new, old), update_multipliers(state.multipliers, c, p), state.multipliers
    )
    slow = ratio > settings.sufficient_decrease * state.updated_ratio
    penalty = jnp.where(
        ended & slow, jnp.minimum(state.penalty * settings.penalty_growth, settings.penalty_limit), state.penalty
    )
    stale = jnp.where(ended, jnp.where(ratio < 0.9 * state.best_ratio, 0, state.stale + 1), state.stale)
    p = penalties(settings.weights, penalty, dtype)
    system = materialize(gauss_newton_system(problem, trial, c, J, multipliers, p, settings.weights))
    value = jnp.where(ended, augmented_value(problem, trial, c, multipliers, p, settings.weights), value)

    damping = jnp.where(accepted, jnp.maximum(state.damping / 4, 1e-6), jnp.maximum(state.damping, 1e-4) * 8)
    x, value, system = jax.tree.map(
        lambda new, old: jnp.where(accepted, new, old), (trial, value, system), (state.x, state.value, state.system)
    )
    x, value, system, damping = materialize((x, value, system, damping))
    dq, dm = materialize(solve_bordered(system, damping))
    # One factor for joints and parameters; parameters may move 0.3 m or rad as well.
    length = jnp.maximum(jnp.abs(dq).max(), jnp.abs(dm).max())
    scale = jnp.minimum(1, settings.step_limit / jnp.maximum(length, 1e-12))
    broken = ~jnp.isfinite(length)
    # No step helps any more: return to x and take the multiplier update there.
    stuck = damping > settings.damping_limit
    factor = jnp.where(stuck | broken, 0, scale)
    step = Variables(jnp.where(factor > 0, factor * dq, 0), jnp.where(factor > 0, factor * dm.reshape(x.m.shape), 0))
    damping = jnp.where(stuck, settings.damping, jnp.where(broken, damping * 100, damping))
    iterations = state.iterations + 1
    status = jnp.where(iterations >= settings.iteration_limit, ITERATION_LIMIT, RUNNING)
    status = jnp.where(stale >= settings.patience, STAGNATED, status)
    status = jnp.where(first & ~jnp.isfinite(value), NUMERICAL_FAILURE, status)
    status = jnp.where(feasible, FEASIBLE, status)
    return State(
        x=x,
        step=step,
        multipliers=multipliers,
        penalty=penalty,
        damping=damping,
        value=jnp.where(stuck | (broken & ~first), jnp.inf, value),
        system=system,
        violations=jax.tree.map(lambda new, old: jnp.where(accepted, new, old), violations, state.violations),
        updated_ratio=jnp.where(ended, ratio, state.updated_ratio),
        best_ratio=jnp.where(accepted, jnp.minimum(ratio, state.best_ratio), state.best_ratio),
        inner=jnp.where(ended, 0, inner),
        stale=stale,
        iterations=iterations,
        status=status.astype(state.status.dtype),
    )


def iterate_once(problems: Problem, settings: Settings, states: State) -> State:
    """One iteration of a batch."""
    rows, J = evaluate(problems, jax.tree.map(jnp.add, states.x, states.step))
    return jax.vmap(_advance, in_axes=(0, None, 0, 0, 0))(problems, settings, states, rows, J)


@jax.jit
def start(problems: Problem, x: Variables, settings: Settings) -> State:
    """Initial states of a batch of NLPs (leading axis of every leaf of ``problems`` and ``x``)."""
    return jax.vmap(_start, in_axes=(0, 0, None))(problems, x, settings)


@partial(jax.jit, donate_argnums=2)
def iterate(problems: Problem, settings: Settings, states: State, iterations: Array) -> State:
    """Run a batch for at most ``iterations`` iterations, or until no lane is running."""

    def unfinished(carry: tuple[Array, State]) -> Array:
        count, lanes = carry
        return (count < iterations) & jnp.any(lanes.status == RUNNING)

    def body(carry: tuple[Array, State]) -> tuple[Array, State]:
        count, lanes = carry
        new = iterate_once(problems, settings, lanes)
        return count + 1, jax.vmap(_tree_where)(lanes.status == RUNNING, new, lanes)

    return jax.lax.while_loop(unfinished, body, (jnp.zeros((), jnp.int32), states))[1]
