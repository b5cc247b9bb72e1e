"""An augmented-Lagrangian Gauss-Newton method for one lane, whatever the problem: pure functions under `vmap`.

With costs r (half their sum of squares), equalities h = 0 and inequalities g <= 0, penalties p and multipliers y, z >=
0:

    L(x) = 1/2 |r|^2 + y.h + p/2 |h|^2 + 1/(2 p) sum(max(0, z + p g)^2 - z^2)

(Rockafellar 1973; Bertsekas 1982.) An iteration looks at a trial point. It becomes the lane's point if L fell, else the
damping grows (`judge_trial`); then a Gauss-Newton step, which keeps J^T J of costs, equalities and active inequalities,
leads to the next trial point (`next_trial`). When the steps of a subproblem have become small, multipliers are updated

    y <- y + p h,        z <- max(0, z + p g),

and the penalty grows if the violation did not fall enough.

What counts is feasibility. The first subproblem that ends near it is followed by a restoration: some iterations in
which the costs' gradient is left out and their Hessian is kept, so that the lane goes to the feasible points that the
costs' metric calls closest (as the restoration phases of filter methods: Fletcher and Leyffer 2002). If it does not
arrive, the method goes on with costs and multipliers.

Constraint rows come as a sequence of arrays, one for each kind; ``equalities`` says which kinds are equalities.
Variables, steps and systems are trees of arrays that only the caller knows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize


class SolverStatus(IntEnum):
    """What has become of a lane."""

    RUNNING = 0
    """The lane goes on."""

    FEASIBLE = 1
    """All violations are within their tolerances. No other status says so."""

    STAGNATED = 2
    """The violation falls too slowly to arrive within the iteration limit."""

    ITERATION_LIMIT = 3
    """The iteration limit is reached."""

    NUMERICAL_FAILURE = 4
    """The first point already has no finite value."""


class RestorationPhase(IntEnum):
    """Where a lane is with respect to its restoration."""

    BEFORE = 0
    DURING = 1
    AFTER = 2


class Settings(NamedTuple):
    """Settings of the method; numbers, so that changing one needs no new compilation."""

    penalty: float = 3e3
    """Initial penalty [1/m^2]."""

    penalty_growth: float = 5.0
    """Factor of the penalty where the violation did not fall to `sufficient_decrease` of its last value."""

    penalty_limit: float = 1e7
    """Largest penalty [1/m^2]."""

    sufficient_decrease: float = 0.5
    """Share of its last value to which the violation has to fall."""

    step_limit: float = 0.5
    """Largest change of one variable in one iteration; the whole step is scaled."""

    step_tolerance: float = 1e-2
    """A subproblem has ended when no variable moved more than this ..."""

    step_damping: float = 1.0
    """... in a step with at most this damping, since a step that damping has shortened says nothing ..."""

    inner_limit: int = 6
    """... or after so many iterations."""

    damping: float = 1e-3
    """Initial damping, added to the diagonal."""

    damping_floor: float = 0.5
    """Least damping after a refused step, before it grows: below the curvature of the costs it changes nothing."""

    damping_limit: float = 1e4
    """Damping from which on no step helps any more."""

    final_step: float = 1e-1
    """A feasible lane ends when its last accepted step was no longer than this."""

    iteration_limit: int = 40
    """Most iterations."""

    restoration_ratio: float = 10.0
    """The first subproblem that ends outside the tolerances and within this multiple of them is followed by the
    restoration. A ratio of 0 does without it: for optima rather than feasible points."""

    restoration_limit: int = 4
    """Iterations of the restoration, or more until one is accepted."""

    patience: int = 5
    """A lane stagnates after so many multiplier updates in a row without a violation 10 % below the best."""

    course_start: int = 10
    """A lane also stagnates when its least violation lies above a course: from this iteration on ..."""

    course_ratio: float = 60.0
    """... the course falls, as a straight line in its logarithm, from this multiple of the tolerance to the tolerance
    at the iteration limit."""


class SolverState(NamedTuple):
    """One lane of the method."""

    x: Any
    """Last accepted point, a tree of arrays."""

    step: Any
    """Step to the trial point."""

    multipliers: tuple[Array, ...]
    """Multipliers y and z of all rows, one array for each kind of row."""

    penalty: Float[Array, "*lanes"]
    """Common penalty p [1/m^2]."""

    damping: Float[Array, "*lanes"]
    """Damping of the next step."""

    value: Float[Array, "*lanes"]
    """Augmented Lagrangian at `x` under the present multipliers and penalty; infinite before the first iteration."""

    system: Any
    """Gauss-Newton system at `x`, likewise."""

    report: Any
    """What the caller wants to know of `x`: a tree of arrays."""

    updated_violation: Float[Array, "*lanes"]
    """Relative violation at the last multiplier update."""

    best_violation: Float[Array, "*lanes"]
    """Least relative violation so far."""

    inner_iterations: Int[Array, "*lanes"]
    """Iterations since the last multiplier update."""

    updates_without_progress: Int[Array, "*lanes"]
    """Multiplier updates in a row without progress."""

    iterations: Int[Array, "*lanes"]
    """Iterations since the start."""

    restoration: Int[Array, "*lanes"]
    """A `RestorationPhase`."""

    status: Int[Array, "*lanes"]
    """A `SolverStatus`."""


class TrialUpdate(NamedTuple):
    """The verdict on a lane's trial point, and what follows from it for the multipliers."""

    accepted: Bool[Array, ""]
    """True where the trial point becomes the lane's point."""

    feasible: Bool[Array, ""]
    """True where the lane has arrived."""

    ended: Bool[Array, ""]
    """True where a subproblem ended and multipliers were updated."""

    relative_violation: Float[Array, ""]
    """Largest violation at the trial point as a multiple of its tolerance."""

    multipliers: tuple[Array, ...]
    penalty: Float[Array, ""]
    value: Float[Array, ""]
    """At the trial point, under the new multipliers and penalty."""

    multiplier_estimate: tuple[Array, ...]
    """Derivative of the Lagrangian by each row: y + p h, and max(0, z + p g)."""

    active_penalty: tuple[Array, ...]
    """The penalty of each row where it is active, else 0."""

    updates_without_progress: Int[Array, ""]
    restoration: Int[Array, ""]


class LagrangianRows(NamedTuple):
    """What the constraint rows contribute to the augmented Lagrangian."""

    multiplier_estimate: tuple[Array, ...]
    active_penalty: tuple[Array, ...]
    value: Float[Array, ""]
    """Sum over all rows."""


def trial_point(state: SolverState) -> Any:
    """The point to be looked at next."""
    return jax.tree.map(jnp.add, state.x, state.step)


def update_multipliers(
    multipliers: Sequence[Array],
    rows: Sequence[Array],
    penalties: Sequence[Array],
    equalities: Sequence[bool],
) -> tuple[Array, ...]:
    """First-order update ``y + p h`` and ``max(0, z + p g)``.

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
    """Multiplier estimate and active penalty of every row, and what all rows add to the augmented Lagrangian.

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
    """Sum of all entries, as products with ones: XLA's CPU backend adds up one by one what a product adds up in
    parallel.

    Under `vmap` lanes become rows of one product, which may add up its last rows in another order: a lane's sum
    depends on its place by a few units of the last digit, a millionth of what `judge_trial` lets pass.
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
    scales: Sequence[Array],
    equalities: Sequence[bool],
    relative_violation: Float[Array, ""],
) -> TrialUpdate:
    """Accept or refuse a lane's trial point, and update its multipliers.

    Args:
        settings: Of the method.
        state: The lane.
        cost: Half the sum of squared costs at the trial point.
        rows: Constraint rows there.
        scales: Penalty of each kind of row relative to the common one.
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
    """Phase of the restoration after this iteration."""
    is_near = (relative_violation > 1) & (relative_violation <= settings.restoration_ratio)
    enters = ended & is_near & (state.restoration == RestorationPhase.BEFORE)
    restoring = state.restoration == RestorationPhase.DURING
    leaves = accepted & restoring & (state.inner_iterations + 1 >= settings.restoration_limit)
    after = jnp.where(leaves, int(RestorationPhase.AFTER), state.restoration)
    return jnp.where(enters, int(RestorationPhase.DURING), after)


class _Step(NamedTuple):
    """The next step, and what became of its damping."""

    step: Any
    damping: Array
    broken: Array
    """True where the system was indefinite."""

    stuck: Array
    """True where no step helps any more."""


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
        report: What the caller wants to keep of the trial point.
        solve: Step of a system with a damping, of the structure of `SolverState.x`; NaN where it is indefinite.
    """
    first = jnp.isinf(state.value)
    turned = update.restoration != state.restoration
    x, value, system, report = jax.tree.map(
        lambda new, old: jnp.where(update.accepted, new, old),
        (trial_point(state), update.value, system, report),
        (state.x, state.value, state.system, state.report),
    )
    x, value, system, damping = materialize(
        (x, value, system, _next_damping(settings, state, update, turned))
    )
    found = _find_step(settings, system, damping, solve)

    # From an indefinite system any trial point is accepted next; where nothing helps, x stays and multipliers move on.
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
    """A quarter after an accepted step, eight times as much after a refused one, anew where the restoration turns."""
    smaller = jnp.maximum(state.damping / 4, 1e-6)
    larger = jnp.maximum(state.damping, settings.damping_floor) * 8
    return jnp.where(turned, settings.damping, jnp.where(update.accepted, smaller, larger))


def _find_step(
    settings: Settings, system: Any, damping: Array, solve: Callable[[Any, Array], Any]
) -> _Step:
    """Gauss-Newton step, scaled as a whole so that no variable changes by more than the limit."""
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
    """Status after this iteration; what comes later in this list wins."""
    iterations = state.iterations + 1
    is_over = iterations >= settings.iteration_limit
    status = jnp.where(is_over, int(SolverStatus.ITERATION_LIMIT), int(SolverStatus.RUNNING))

    span = jnp.maximum(settings.iteration_limit - settings.course_start, 1)
    elapsed = (iterations - settings.course_start) / span
    course = jnp.log(settings.course_ratio) * (1 - elapsed)
    is_off_course = (elapsed >= 0) & (jnp.log(best_violation) > course)
    is_stale = update.updates_without_progress >= settings.patience
    status = jnp.where(is_stale | is_off_course, int(SolverStatus.STAGNATED), status)

    status = jnp.where(has_failed, int(SolverStatus.NUMERICAL_FAILURE), status)
    return jnp.where(update.feasible, int(SolverStatus.FEASIBLE), status)


def _zero_if(condition: Array, values: Any) -> Any:
    """A tree of arrays, or zeros where the condition holds."""
    return jax.tree.map(lambda value: jnp.where(condition, 0, value), values)


def _largest(step: Any) -> Array:
    """Largest change of one variable; NaN if any is."""
    return jnp.stack([jnp.abs(leaf).max() for leaf in jax.tree.leaves(step)]).max()
