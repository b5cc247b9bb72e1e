"""An augmented-Lagrangian Gauss-Newton method for one lane, whatever the problem: pure functions under `vmap`.

With costs r (half their sum of squares), equalities h = 0 and inequalities g <= 0, penalties p and multipliers y,
z >= 0:

    L(x) = 1/2 |r|^2 + y.h + p/2 |h|^2 + 1/(2 p) sum(max(0, z + p g)^2 - z^2)

(Rockafellar 1973; Bertsekas 1982.) An iteration looks at a trial point. It becomes the lane's point if L fell, else the
damping grows (`judge`); then a Gauss-Newton step, which keeps J^T J of costs, equalities and active inequalities, leads
to the next trial point (`advance`). When the steps of a subproblem have become small, multipliers are updated and the
penalty grows if the violation did not fall enough.

What counts is feasibility. The first subproblem that ends near it is followed by a restoration: some iterations in
which the costs' gradient is left out and their Hessian is kept, so that the lane goes to the feasible points that the
costs' metric calls closest (as the restoration phases of filter methods: Fletcher and Leyffer 2002). If it does not
arrive, the method goes on with costs and multipliers.

Constraint rows come as a tuple of arrays, one for each kind; ``equalities`` says which kinds are equalities."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import materialize

RUNNING, FEASIBLE, STAGNATED, ITERATION_LIMIT, NUMERICAL_FAILURE = 0, 1, 2, 3, 4
"""Status of a lane. Only FEASIBLE says that the violation's tolerances hold."""

BEFORE, DURING, AFTER = 0, 1, 2
"""Where a lane is with respect to its restoration."""


class Settings(NamedTuple):
    """Settings of the method; numbers, so that changing one needs no new compilation."""

    penalty: float = 3e3
    """Initial penalty [1/m^2]."""
    penalty_growth: float = 5.0
    """Factor of the penalty where the violation did not fall to `sufficient_decrease` of its last value."""
    penalty_limit: float = 1e7
    sufficient_decrease: float = 0.5
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
    final_step: float = 1e-1
    """A feasible lane ends when its last accepted step was no longer than this."""
    iteration_limit: int = 40
    restoration_ratio: float = 10.0
    """The first subproblem that ends outside the tolerances and within this multiple of them is followed by the
    restoration ..."""
    restoration_limit: int = 4
    """... of so many iterations, or more until one is accepted. A ratio of 0 does without it: for optima rather than
    feasible points."""
    patience: int = 5
    """A lane stagnates after so many multiplier updates in a row without a violation 10 % below the best ..."""
    course_start: int = 10
    course_ratio: float = 60.0
    """... or when its least violation lies above a course that falls, as a straight line in its logarithm, from
    `course_ratio` times the tolerance after `course_start` iterations to the tolerance at the iteration limit."""


class SolverState(NamedTuple):
    """One lane of the method."""

    x: Any
    """Last accepted point, a tree of arrays."""
    step: Any
    """Step to the trial point."""
    multipliers: tuple[Array, ...]
    penalty: Array
    damping: Array
    value: Array
    """Augmented Lagrangian at `x` under the present multipliers and penalty."""
    system: Any
    """Gauss-Newton system at `x`, likewise."""
    report: Any
    """What the caller wants to know of `x`: a tree of arrays."""
    updated_ratio: Array
    """Violation, as a multiple of its tolerance, at the last multiplier update."""
    best_ratio: Array
    """Least violation so far."""
    inner: Array
    """Iterations since the last multiplier update."""
    stale: Array
    """Multiplier updates in a row without progress."""
    iterations: Array
    restoration: Array
    """BEFORE, DURING or AFTER."""
    status: Array


class TrialUpdate(NamedTuple):
    """The verdict on a lane's trial point, between `judge` and `advance`."""

    accepted: Array
    """True where the trial point becomes the lane's point."""
    feasible: Array
    ended: Array
    """True where a subproblem ended and multipliers were updated."""
    ratio: Array
    multipliers: tuple[Array, ...]
    penalty: Array
    value: Array
    """At the trial point, under the new multipliers and penalty."""
    force: tuple[Array, ...]
    """Derivative of the Lagrangian with respect to each row."""
    curvature: tuple[Array, ...]
    """The penalty of each row where it is active."""
    stale: Array
    restoration: Array


def trial_point(lane: SolverState) -> Any:
    """The point to be looked at next."""
    return jax.tree.map(jnp.add, lane.x, lane.step)


def update_multipliers(
    multipliers: Sequence[Array], c: Sequence[Array], p: Sequence[Array], equalities: Sequence[bool]
) -> tuple[Array, ...]:
    """First-order update ``y + p h`` and ``max(0, z + p g)``."""
    updated = [y + penalty * value for y, value, penalty in zip(multipliers, c, p, strict=True)]
    return tuple(new if is_h else jnp.maximum(new, 0) for new, is_h in zip(updated, equalities, strict=True))


def forces(
    multipliers: Sequence[Array], c: Sequence[Array], p: Sequence[Array], equalities: Sequence[bool]
) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
    """Per row the derivative of the Lagrangian and its curvature (the penalty where active), and the rows' total."""
    force, curvature, total = [], [], jnp.zeros(())
    for y, value, penalty, is_h in zip(multipliers, c, p, equalities, strict=True):
        push = y + penalty * value
        if is_h:
            total += _sum((y + 0.5 * penalty * value) * value)
            curvature.append(jnp.broadcast_to(penalty, value.shape))
        else:
            push = jnp.maximum(push, 0)
            total += _sum((push * push - y * y) * materialize(0.5 / penalty))
            curvature.append(jnp.where(push > 0, penalty, 0))
        force.append(push)
    return tuple(force), tuple(curvature), total


def _sum(value: Array) -> Array:
    """Sum of all entries, as products with ones: XLA's CPU backend adds up one by one what a product adds up in
    parallel.

    Under `vmap` lanes become rows of one product, which may add up its last rows in another order: a lane's sum depends
    on its place by a few units of the last digit, a millionth of what `judge` lets pass."""
    value = materialize(value)
    while value.ndim:
        value = value @ jnp.ones(value.shape[-1], value.dtype)
    return value


def judge(
    settings: Settings,
    lane: SolverState,
    cost: Array,
    c: Sequence[Array],
    scales: Sequence[Array],
    equalities: Sequence[bool],
    ratio: Array,
) -> TrialUpdate:
    """Accept or refuse a lane's trial point, and update its multipliers.

    Args:
        cost: half the sum of squared costs at the trial point.
        c: constraint rows there.
        scales: penalty of each kind of row relative to the common one.
        ratio: largest violation there as a multiple of its tolerance.
    """
    p = tuple(lane.penalty * scale for scale in scales)
    restoring = lane.restoration == DURING
    value = _unless(restoring, cost) + forces(_unless(restoring, lane.multipliers), c, p, equalities)[2]
    # Equal values count as success: at convergence steps are lost in rounding. NaN does not.
    accepted = value <= lane.value + 1e-9 * jnp.abs(lane.value)
    moved = _largest(lane.step)
    feasible = accepted & (ratio <= 1) & (moved <= settings.final_step)
    first = jnp.isinf(lane.value)
    small = (moved <= settings.step_tolerance) & (lane.damping <= settings.step_damping)
    ended = accepted & ~first & ~restoring & (small | (lane.inner + 1 >= settings.inner_limit))
    near = (ratio > 1) & (ratio <= settings.restoration_ratio)
    enters = ended & near & (lane.restoration == BEFORE)
    leaves = accepted & restoring & (lane.inner + 1 >= settings.restoration_limit)
    restoration = jnp.where(enters, DURING, jnp.where(leaves, AFTER, lane.restoration))

    # Multiplier update, from the rows at hand: x has just become the trial point.
    updated = update_multipliers(lane.multipliers, c, p, equalities)
    multipliers = tuple(jnp.where(ended, new, old) for new, old in zip(updated, lane.multipliers, strict=True))
    slow = ratio > settings.sufficient_decrease * lane.updated_ratio
    penalty = jnp.where(
        ended & slow, jnp.minimum(lane.penalty * settings.penalty_growth, settings.penalty_limit), lane.penalty
    )
    stale = jnp.where(ended, jnp.where(ratio < 0.9 * lane.best_ratio, 0, lane.stale + 1), lane.stale)
    p = tuple(penalty * scale for scale in scales)
    restoring = restoration == DURING
    force, curvature, total = forces(_unless(restoring, multipliers), c, p, equalities)
    value = jnp.where(ended | leaves, _unless(restoring, cost) + total, value)
    return TrialUpdate(
        accepted, feasible, ended, ratio, multipliers, penalty, value, force, curvature, stale, restoration
    )


def advance(
    settings: Settings,
    lane: SolverState,
    judged: TrialUpdate,
    system: Any,
    report: Any,
    solve: Callable[[Any, Array], Any],
) -> SolverState:
    """Move a lane to its trial point if that was accepted, and find the next trial point.

    Args:
        system: Gauss-Newton system at the trial point; while `TrialUpdate.restoration` is DURING, without the gradient of
        the costs.
        report: what the caller wants to keep of it.
        solve: step of a system with a damping, of the structure of `SolverState.x`; NaN where it is indefinite.
    """
    accepted, first = judged.accepted, jnp.isinf(lane.value)
    damping = jnp.where(
        accepted, jnp.maximum(lane.damping / 4, 1e-6), jnp.maximum(lane.damping, settings.damping_floor) * 8
    )
    turned = judged.restoration != lane.restoration
    damping = jnp.where(turned, settings.damping, damping)
    x, value, system, report = jax.tree.map(
        lambda new, old: jnp.where(accepted, new, old),
        (trial_point(lane), judged.value, system, report),
        (lane.x, lane.value, lane.system, lane.report),
    )
    x, value, system, damping = materialize((x, value, system, damping))
    step = materialize(solve(system, damping))
    # One factor for all variables.
    length = _largest(step)
    factor = jnp.minimum(1, settings.step_limit / jnp.maximum(length, 1e-12))
    broken = ~jnp.isfinite(length)
    # No step helps any more: return to x and take the multiplier update there.
    stuck = damping > settings.damping_limit
    factor = jnp.where(stuck | broken, 0, factor)
    step = jax.tree.map(lambda d: jnp.where(factor > 0, factor * d, 0), step)
    damping = jnp.where(stuck, settings.damping, jnp.where(broken, damping * 100, damping))
    iterations = lane.iterations + 1
    status = jnp.where(iterations >= settings.iteration_limit, ITERATION_LIMIT, RUNNING)
    best_ratio = jnp.where(accepted, jnp.minimum(judged.ratio, lane.best_ratio), lane.best_ratio)
    elapsed = (iterations - settings.course_start) / jnp.maximum(settings.iteration_limit - settings.course_start, 1)
    off_course = (elapsed >= 0) & (jnp.log(best_ratio) > jnp.log(settings.course_ratio) * (1 - elapsed))
    status = jnp.where((judged.stale >= settings.patience) | off_course, STAGNATED, status)
    status = jnp.where(first & ~jnp.isfinite(value), NUMERICAL_FAILURE, status)
    status = jnp.where(judged.feasible, FEASIBLE, status)
    return SolverState(
        x=x,
        step=step,
        multipliers=judged.multipliers,
        penalty=judged.penalty,
        damping=damping,
        value=jnp.where(broken & ~first & ~stuck, jnp.inf, value),
        system=system,
        report=report,
        updated_ratio=jnp.where(judged.ended, judged.ratio, lane.updated_ratio),
        best_ratio=best_ratio,
        inner=jnp.where(judged.ended | turned, 0, lane.inner + 1),
        stale=judged.stale,
        iterations=iterations,
        restoration=judged.restoration,
        status=status.astype(lane.status.dtype),
    )


def _unless(condition: Array, values: Any) -> Any:
    """A tree of arrays, or zeros where the condition holds."""
    return jax.tree.map(lambda value: jnp.where(condition, 0, value), values)


def _largest(step: Any) -> Array:
    """Largest change of one variable; NaN if any is."""
    return jnp.stack([jnp.abs(leaf).max() for leaf in jax.tree.leaves(step)]).max()
