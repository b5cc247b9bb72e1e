"""An augmented Lagrangian method with Gauss-Newton steps, which does not depend on the structure of the problem.

All functions treat a single *lane*, which is one NLP with its point, multipliers and penalty. They are pure, and the
caller applies `jax.vmap` to solve many lanes together. The method minimizes 1/2 |r|^2 with cost residuals r, subject to
equalities h = 0 and inequalities g <= 0. With the penalty p and the multipliers y and z >= 0, the augmented Lagrangian
(Rockafellar 1973; Bertsekas 1982) is

    L(x) = 1/2 |r|^2 + y.h + p/2 |h|^2 + 1/(2 p) sum(max(0, z + p g)^2 - z^2).

The minimization of L for constant multipliers and penalty is a *subproblem*. An iteration consists of two functions:

1. `judge_trial` evaluates L at a trial point x + step. If L has not increased, the trial point is accepted and becomes
   the lane's point x. Otherwise the damping grows.
2. `next_trial` computes the next step d from the damped Gauss-Newton system (H + damping I) d = -gradient of L. H is
   the sum of J^T J over the cost residuals and of p J^T J over the equalities and the active inequalities, which are
   those with z + p g > 0.

A subproblem ends when its steps have become small. The multipliers are then updated,

    y <- y + p h,        z <- max(0, z + p g),

and the penalty grows if the violation has not decreased enough.

The planner needs a feasible point, not an optimum. The first subproblem that ends close to feasibility is therefore
followed by a *restoration*: some iterations without the multipliers and the gradient of the costs, but with the Hessian
of the costs, so that the lane moves to feasible points that are close in the metric of this Hessian. Restoration phases
of filter methods have the same purpose (Fletcher and Leyffer 2002). If the restoration does not reach a feasible point,
the method continues with costs and multipliers.

Constraint rows are a sequence of arrays, one for each kind of row; ``equalities`` says which kinds are equalities.
Variables, steps and systems are pytrees of arrays whose structure only the caller knows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.solver.state import RestorationPhase, Settings, SolverState, SolverStatus, TrialUpdate


class LagrangianRows(NamedTuple):
    """What the constraint rows contribute to the augmented Lagrangian and to its derivatives."""

    multiplier_estimate: tuple[Array, ...]
    """Derivative of the augmented Lagrangian by each row: y + p h, and max(0, z + p g)."""

    active_penalty: tuple[Array, ...]
    """The penalty of each row where it is active, else 0."""

    value: Float[Array, ""]
    """Sum of the terms of all rows in the augmented Lagrangian."""


def trial_point(state: SolverState) -> Any:
    """Return the trial point of a lane, its point plus its step."""
    return jax.tree.map(jnp.add, state.x, state.step)


def update_multipliers(
    multipliers: Sequence[Array],
    rows: Sequence[Array],
    penalties: Sequence[Array],
    equalities: Sequence[bool],
) -> tuple[Array, ...]:
    """Return the multipliers after the first-order update ``y + p h`` and ``max(0, z + p g)``.

    Args:
        multipliers: One array for each kind of row.
        rows: Values of the rows.
        penalties: Penalty of each row, or of all rows of a kind.
        equalities: Which kinds are equalities.
    """
    updated = [y + p * value for y, value, p in zip(multipliers, rows, penalties, strict=True)]
    return tuple(
        new if is_h else jnp.maximum(new, 0) for new, is_h in zip(updated, equalities, strict=True)
    )


def lagrangian_rows(
    multipliers: Sequence[Array],
    rows: Sequence[Array],
    penalties: Sequence[Array],
    equalities: Sequence[bool],
) -> LagrangianRows:
    """Compute multiplier estimate and active penalty of every row, and the rows' sum in the augmented Lagrangian.

    Args:
        multipliers: One array for each kind of row.
        rows: Values of the rows.
        penalties: Penalty of each row, or of all rows of a kind.
        equalities: Which kinds are equalities.
    """
    estimates: list[Array] = []
    active: list[Array] = []
    total: Array = jnp.zeros(())
    for y, value, p, is_h in zip(multipliers, rows, penalties, equalities, strict=True):
        estimate = y + p * value
        if is_h:
            total = total + _sum((y + 0.5 * p * value) * value)
            active.append(jnp.broadcast_to(p, value.shape))
        else:
            estimate = jnp.maximum(estimate, 0)
            total = total + _sum((estimate * estimate - y * y) * materialize(0.5 / p))
            active.append(jnp.where(estimate > 0, p, 0))
        estimates.append(estimate)
    return LagrangianRows(tuple(estimates), tuple(active), total)


def _sum(value: Array) -> Array:
    """Return the sum of all entries, computed by products with vectors of ones.

    XLA's CPU backend computes such a product in parallel, but a plain sum entry by entry. Under `vmap` the lanes become
    rows of one product, whose last rows may be added in another order. The sum of a lane therefore depends on its place
    in the batch, by a few units of the last digit; this is a millionth of the increase that `judge_trial` accepts.
    """
    value = materialize(value)
    while value.ndim:
        value = value @ jnp.ones(value.shape[-1], value.dtype)
    return value


def _next_penalty(settings: Settings, state: SolverState, relative_violation: Array) -> Array:
    """Penalty after a subproblem: it grows where the violation has not decreased by enough."""
    is_slow = relative_violation > settings.sufficient_decrease * state.updated_violation
    grown = jnp.minimum(state.penalty * settings.penalty_growth, settings.penalty_limit)
    return jnp.where(is_slow, grown, state.penalty)


def judge_trial(
    settings: Settings,
    state: SolverState,
    cost: Float[Array, ""],
    rows: Sequence[Array],
    scales: Sequence[Array | float],
    equalities: Sequence[bool],
    relative_violation: Float[Array, ""],
) -> TrialUpdate:
    """Accept or refuse a lane's trial point, and update its multipliers.

    Args:
        settings: Of the method.
        state: The lane.
        cost: Half the sum of squared costs at the trial point.
        rows: Constraint rows there.
        scales: Penalty of each row relative to the common one, an array or a number for each kind of row.
        equalities: Which kinds are equalities.
        relative_violation: Largest violation there as a multiple of its tolerance.
    """
    penalties = tuple(state.penalty * scale for scale in scales)
    restoring = state.restoration == RestorationPhase.DURING
    first = jnp.isinf(state.value)

    # Equal values count as success: at convergence steps are lost in rounding. NaN does not.
    own = lagrangian_rows(_zero_if(restoring, state.multipliers), rows, penalties, equalities)
    value = _zero_if(restoring, cost) + own.value
    accepted = value <= state.value + 1e-9 * jnp.abs(state.value)

    # Has the lane arrived, or its subproblem ended?
    moved = _largest(state.step)
    feasible = accepted & (relative_violation <= 1) & (moved <= settings.final_step)
    is_small = (moved <= settings.step_tolerance) & (state.damping <= settings.step_damping)
    is_last = state.inner_iterations + 1 >= settings.inner_limit
    ended = accepted & ~first & ~restoring & (is_small | is_last)
    restoration = _next_phase(settings, state, accepted, ended, relative_violation)

    # The multiplier update takes the rows at hand: x has just become the trial point.
    updated = update_multipliers(state.multipliers, rows, penalties, equalities)
    multipliers = tuple(
        jnp.where(ended, new, old) for new, old in zip(updated, state.multipliers, strict=True)
    )
    penalty = jnp.where(ended, _next_penalty(settings, state, relative_violation), state.penalty)
    progressed = relative_violation < 0.9 * state.best_violation
    without_progress = jnp.where(progressed, 0, state.updates_without_progress + 1)

    # Value and derivatives at the trial point under the new multipliers and penalty.
    penalties = tuple(penalty * scale for scale in scales)
    restores = restoration == RestorationPhase.DURING
    leaves = restoring & ~restores
    new = lagrangian_rows(_zero_if(restores, multipliers), rows, penalties, equalities)
    value = jnp.where(ended | leaves, _zero_if(restores, cost) + new.value, value)
    return TrialUpdate(
        accepted=accepted,
        feasible=feasible,
        ended=ended,
        relative_violation=relative_violation,
        multipliers=multipliers,
        penalty=penalty,
        value=value,
        multiplier_estimate=new.multiplier_estimate,
        active_penalty=new.active_penalty,
        updates_without_progress=jnp.where(ended, without_progress, state.updates_without_progress),
        restoration=restoration,
    )


def _next_phase(
    settings: Settings, state: SolverState, accepted: Array, ended: Array, relative_violation: Array
) -> Array:
    """Return the phase of the restoration after this iteration."""
    is_near = (relative_violation > 1) & (relative_violation <= settings.restoration_ratio)
    enters = ended & is_near & (state.restoration == RestorationPhase.BEFORE)
    restoring = state.restoration == RestorationPhase.DURING
    leaves = accepted & restoring & (state.inner_iterations + 1 >= settings.restoration_limit)
    after = jnp.where(leaves, int(RestorationPhase.AFTER), state.restoration)
    return jnp.where(enters, int(RestorationPhase.DURING), after)


class _Step(NamedTuple):
    """The next step of a lane, and the damping that is used after it."""

    step: Any
    """The step; zero if it was not finite or the damping exceeded its limit."""

    damping: Array
    """Damping after this iteration."""

    broken: Array
    """True if the step was not finite, because the system was indefinite."""

    stuck: Array
    """True if the damping exceeded its limit."""


def next_trial(
    settings: Settings,
    state: SolverState,
    update: TrialUpdate,
    system: Any,
    report: Any,
    solve: Callable[[Any, Array], Any],
) -> SolverState:
    """Move a lane to its trial point if that was accepted, and find the next trial point.

    Args:
        settings: Of the method.
        state: The lane.
        update: The verdict on its trial point.
        system: Gauss-Newton system at the trial point; during the restoration without the gradient of the costs.
        report: Numbers about the trial point that the caller wants to keep.
        solve: Function of a system and a damping that returns the step, of the structure of `SolverState.x`; the step
            is NaN if the damped system is indefinite.
    """
    first = jnp.isinf(state.value)
    turned = update.restoration != state.restoration

    # The trial point and everything that is known of it take the place of the old point, if the point was accepted.
    x, value, system, report = jax.tree.map(
        lambda new, old: jnp.where(update.accepted, new, old),
        (trial_point(state), update.value, system, report),
        (state.x, state.value, state.system, state.report),
    )
    x, value, system, damping = materialize(
        (x, value, system, _next_damping(settings, state, update, turned))
    )
    found = _find_step(settings, system, damping, solve)

    # If the system was indefinite, an infinite value makes the next trial point be accepted whatever its value is. If
    # the damping exceeded its limit, x stays and the value is kept, so that the multipliers can be updated there.
    value_after = jnp.where(found.broken & ~first & ~found.stuck, jnp.inf, value)
    best = jnp.minimum(update.relative_violation, state.best_violation)
    best = jnp.where(update.accepted, best, state.best_violation)
    status = _next_status(settings, state, update, best, first & ~jnp.isfinite(value))
    return SolverState(
        x=x,
        step=found.step,
        multipliers=update.multipliers,
        penalty=update.penalty,
        damping=found.damping,
        value=value_after,
        system=system,
        report=report,
        updated_violation=jnp.where(
            update.ended, update.relative_violation, state.updated_violation
        ),
        best_violation=best,
        inner_iterations=jnp.where(update.ended | turned, 0, state.inner_iterations + 1),
        updates_without_progress=update.updates_without_progress,
        iterations=state.iterations + 1,
        restoration=update.restoration,
        status=status.astype(state.status.dtype),
    )


def _next_damping(
    settings: Settings, state: SolverState, update: TrialUpdate, turned: Array
) -> Array:
    """Return the next damping: smaller after an accepted step, larger after a refused one.

    An accepted step divides the damping by 4, a refused one multiplies it by 8. It is reset to its initial value when
    the restoration begins or ends.
    """
    smaller = jnp.maximum(state.damping / 4, 1e-6)
    larger = jnp.maximum(state.damping, settings.damping_floor) * 8
    return jnp.where(turned, settings.damping, jnp.where(update.accepted, smaller, larger))


def _find_step(
    settings: Settings, system: Any, damping: Array, solve: Callable[[Any, Array], Any]
) -> _Step:
    """Compute the Gauss-Newton step, scaled as a whole so that no variable changes by more than the limit."""
    step = materialize(solve(system, damping))
    length = _largest(step)
    factor = jnp.minimum(1, settings.step_limit / jnp.maximum(length, 1e-12))
    broken = ~jnp.isfinite(length)
    stuck = damping > settings.damping_limit
    factor = jnp.where(stuck | broken, 0, factor)
    step = jax.tree.map(lambda change: jnp.where(factor > 0, factor * change, 0), step)
    damping = jnp.where(stuck, settings.damping, jnp.where(broken, damping * 100, damping))
    return _Step(step, damping, broken, stuck)


def _next_status(
    settings: Settings,
    state: SolverState,
    update: TrialUpdate,
    best_violation: Array,
    has_failed: Array,
) -> Array:
    """Return the status after this iteration; conditions that are tested later take precedence."""
    iterations = state.iterations + 1
    is_over = iterations >= settings.iteration_limit
    status = jnp.where(is_over, int(SolverStatus.ITERATION_LIMIT), int(SolverStatus.RUNNING))

    # log(course) falls linearly from log(course_ratio) at `course_start` to 0 at the iteration limit.
    span = jnp.maximum(settings.iteration_limit - settings.course_start, 1)
    elapsed = (iterations - settings.course_start) / span
    course = jnp.log(settings.course_ratio) * (1 - elapsed)
    is_off_course = (elapsed >= 0) & (jnp.log(best_violation) > course)
    is_stale = update.updates_without_progress >= settings.patience
    status = jnp.where(is_stale | is_off_course, int(SolverStatus.STAGNATED), status)

    status = jnp.where(has_failed, int(SolverStatus.NUMERICAL_FAILURE), status)
    return jnp.where(update.feasible, int(SolverStatus.FEASIBLE), status)


def _zero_if(condition: Array, values: Any) -> Any:
    """Return a pytree of arrays, or zeros if the condition holds."""
    return jax.tree.map(lambda value: jnp.where(condition, 0, value), values)


def _largest(step: Any) -> Array:
    """Return the largest change of one variable in a step; NaN if any change is NaN."""
    return jnp.stack([jnp.abs(leaf).max() for leaf in jax.tree.leaves(step)]).max()
