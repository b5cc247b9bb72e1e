r"""Sequential quadratic programming for optimal paths: the part that does not depend on the structure of the problem.

The method minimizes a cost f subject to equalities h = 0 and inequalities g <= 0, from a start at which the constraints
nearly hold. All functions treat a single *lane*, which is one NLP with its point x. At x, the quadratic program

    minimize  grad f . d + 1/2 d^T (H + damping I) d + p/2 |h + J_h d|^2    subject to  g + J_g d <= 0

gives the step d. H is the Hessian of the Lagrangian (`dvr_jax.solver.path_matrix`), that of the cost alone, or its
Gauss-Newton matrix. Without the curvature of the constraints, steps converge linearly at best, and overshoot where it
is larger than that of the cost. The penalty p of the linearized equalities is so large that the step satisfies them.
The quadratic program contains the inequalities that are near, so that a step does not run into those that are not
active yet. Its dual has one variable for each of them (`dvr_jax.solver.quadratic_program`).

Constraints are curved, so x + d violates them in the second order of d. The step is therefore *corrected*: the
quadratic program is solved again with the values of the constraints at x + d, and with the derivatives at x (a
second-order correction; Nocedal and Wright, Numerical Optimization, section 18.3). A correction needs one evaluation of
the constraints and no derivatives. No merit function has to weigh violations against the cost. Instead, a trial point
is accepted if

- its violation is within a *funnel*, a bound that shrinks with the iterations (Gould and Toint 2010), and
- its cost has decreased by a fraction of what the quadratic program predicts, or its violation has been halved.

Otherwise the damping grows and a shorter step is found from x. A lane that violates the constraints and finds only very
short steps has strayed to where no step restores them; it goes back to its best point with a narrower funnel. The lane
ends at x if its damping is small and the quadratic program predicts almost no decrease: the *KKT residual* is

    residual = 1/2 d^T (H + damping I) d / f.

Where all constraints hold, this is the decrease of the cost that the quadratic program predicts. Without constraints it
is half the squared Newton decrement (Boyd and Vandenberghe, Convex Optimization, section
9.5) as a fraction of the cost. It is zero only if d is, and then the multipliers of the quadratic program satisfy the
KKT conditions of the NLP. It does not depend on the units of the variables. With much damping it is small everywhere,
and counts as infinite.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.solver.state import SolverStatus

TINY_COST = 1e-9
"""Costs below this count as this number where something is compared with the cost."""


class Verdict(IntEnum):
    """What happens to a lane after its trial point was evaluated."""

    ACCEPTED = 0
    """The trial point becomes the lane's point, and its constraints are linearized."""

    CORRECTED = 1
    """The step is corrected with the values of the constraints at the trial point."""

    REFUSED = 2
    """The lane returns to its point, to find a shorter step there."""


class SequentialSettings(NamedTuple):
    """Settings of the method. Violations are the largest ones as multiples of their tolerances."""

    equality_penalty: float = 1e5
    """Penalty of the linearized equalities [1/m^2]; the step satisfies them up to a hundredth of their tolerance."""

    damping: float = 1e-2
    """Initial damping."""

    damping_growth: float = 6.0
    """Factor by which the damping grows after a refused trial point."""

    damping_shrinkage: float = 4.0
    """Divisor of the damping after a step that needed at most one correction and decreased the cost as predicted."""

    easy_corrections: int = 1
    """Largest number of corrections of a step after which the damping shrinks."""

    damping_floor: float = 1e-5
    """Smallest damping."""

    damping_restart: float = 1e-4
    """Smaller dampings are raised to this number before they grow."""

    damping_limit: float = 1e3
    """The lane ends when the damping exceeds this number."""

    stray_damping: float = 50.0
    """A lane that violates the constraints returns to its best point when the damping exceeds this number."""

    retreat_damping: float = 0.1
    """Damping after such a return."""

    retreat_funnel: float = 0.25
    """Factor of the bound of accepted violations at such a return."""

    kkt_damping: float = 1e-4
    """Largest damping for which the KKT residual is known."""

    kkt_tolerance: float = 3e-3
    """Largest KKT residual of an optimal point."""

    decrease_tolerance: float = 2e-4
    """The lane ends where the constraints hold and the predicted change of the cost is at most this fraction of it."""

    refusal_tolerance: float = 2e-3
    """The lane also ends after a refused step whose predicted change of the cost was at most this fraction of it. Such
    steps are refused where a distance has a kink."""

    step_limit: float = 0.5
    """Largest change of one variable in one step [m or rad]; a longer step is scaled as a whole."""

    funnel: float = 40.0
    """Initial bound of the violation of accepted points."""

    funnel_shrinkage: float = 0.9
    """Factor by which the bound shrinks after each accepted point."""

    violation_limit: float = 0.8
    """Smallest value of the bound, and largest violation of an optimal point, unless the start violates the constraints
    by more. A row with a large multiplier keeps a violation, the multiplier divided by `equality_penalty`."""

    corrected_violation: float = 0.3
    """Largest violation that is not corrected. An optimum uses up whatever violation is allowed."""

    sufficient_decrease: float = 0.1
    """Fraction of the predicted decrease that the cost has to decrease by."""

    corrections: int = 2
    """Largest number of corrections of one step."""

    correction_progress: float = 0.6
    """A step is corrected again only if the last correction decreased the violation to this fraction."""

    correction_limit: float = 60.0
    """Largest violation that is corrected."""

    iteration_limit: int = 100
    """Largest number of evaluations of the constraints."""


class BestPoint(NamedTuple):
    """The point of least cost among those whose violation is within its limit."""

    x: Any
    cost: Float[Array, "*lanes"]
    """Cost; infinite if there is no such point."""
    report: Any
    """`LaneState.report` of this point."""


class LaneState(NamedTuple):
    """The state of one lane between two evaluations of its constraints."""

    x: Any
    """Last accepted point, a pytree of arrays."""

    step: Any
    """Step from `x` to the trial point; zero if the constraints are to be linearized at `x`."""

    model: Any
    """The quadratic program at `x`, of a structure that only the caller knows."""

    cost: Float[Array, "*lanes"]
    """Cost at `x`; infinite before the first evaluation."""

    violation: Float[Array, "*lanes"]
    """Largest violation at `x`."""

    trial_violation: Float[Array, "*lanes"]
    """Largest violation at the trial point before the last correction."""

    predicted_decrease: Float[Array, "*lanes"]
    """Decrease of the cost that the quadratic program at `x` predicts; negative if the step restores feasibility at a
    higher cost."""

    damping: Float[Array, "*lanes"]
    """Damping of the quadratic program."""

    funnel: Float[Array, "*lanes"]
    """Bound of the violation of accepted points."""

    allowed: Float[Array, "*lanes"]
    """Largest violation of a point that satisfies the constraints: that of the start, from `violation_limit` to 1."""

    corrections: Int[Array, "*lanes"]
    """Number of corrections of the present step."""

    best: BestPoint
    """The best point that the lane has visited."""

    report: Any
    """Numbers about `x` that the caller wants to keep, a pytree of arrays; here the violation of each measure."""

    kkt_residual: Float[Array, "*lanes"]
    """KKT residual of `x`; infinite if it is not known."""

    is_closing: Bool[Array, "*lanes"]
    """Whether the lane has gone back to its best point, where only the KKT residual is still to be computed."""

    iterations: Int[Array, "*lanes"]
    """Number of evaluations of the constraints."""

    status: Int[Array, "*lanes"]
    """Whether the lane is still iterated, a `SolverStatus`."""


def trial_point(state: LaneState) -> Any:
    """Return the trial point of a lane, its point plus its step."""
    return jax.tree.map(jnp.add, state.x, state.step)


def judge(
    settings: SequentialSettings,
    state: LaneState,
    cost: Float[Array, ""],
    violation: Float[Array, ""],
) -> Int[Array, ""]:
    """Decide what happens to a lane after its trial point was evaluated.

    Args:
        settings: Settings of the method.
        state: The lane.
        cost: Cost at the trial point.
        violation: Largest violation at the trial point.

    Returns:
        A `Verdict`.
    """
    is_first = jnp.isinf(state.cost)
    is_at_point = _largest(state.step) == 0

    # A violation is corrected as long as corrections make progress.
    wanted = jnp.maximum(settings.corrected_violation, 0.5 * state.violation)
    progresses = violation <= settings.correction_progress * state.trial_violation
    corrects = (violation > jnp.minimum(state.funnel, wanted)) & progresses
    corrects &= violation <= settings.correction_limit
    corrects &= state.corrections < settings.corrections

    # The cost has to decrease by a part of the predicted decrease, or to increase at most by twice the predicted
    # increase. A point that violates the constraints is also accepted for a large decrease of its violation.
    promised = state.predicted_decrease
    share = jnp.where(promised > 0, settings.sufficient_decrease, 2.0)
    decreases = cost <= state.cost - share * promised
    restores = (violation <= 0.5 * state.violation) & (state.violation > state.allowed)
    accepts = (violation <= state.funnel) & (decreases | restores)
    accepts |= is_first | is_at_point

    verdict = jnp.where(accepts, int(Verdict.ACCEPTED), int(Verdict.REFUSED))
    return jnp.where(corrects & ~is_first & ~is_at_point, int(Verdict.CORRECTED), verdict).astype(
        jnp.int32
    )


def after_judgement(
    settings: SequentialSettings,
    state: LaneState,
    verdict: Int[Array, ""],
    cost: Float[Array, ""],
    violation: Float[Array, ""],
    report: Any,
) -> LaneState:
    """Return the state of a lane with a new point and damping; its next step is still to be found.

    Args:
        settings: Settings of the method.
        state: The lane.
        verdict: A `Verdict` on its trial point.
        cost: Cost at the trial point.
        violation: Largest violation there.
        report: Numbers about the trial point that the caller wants to keep.
    """
    accepted = verdict == Verdict.ACCEPTED
    corrected = verdict == Verdict.CORRECTED
    moved = accepted & ~jnp.isinf(state.cost) & (_largest(state.step) > 0)

    x, best_cost, largest, kept = _choose(
        accepted,
        (trial_point(state), cost, violation, report),
        (state.x, state.cost, state.violation, state.report),
    )

    # The damping shrinks after a step that kept its promise, and grows after a refused one.
    share = jnp.where(state.predicted_decrease > 0, 0.5, 1.5)
    keeps_promise = state.cost - cost >= share * state.predicted_decrease
    shrinks = moved & keeps_promise & (state.corrections <= settings.easy_corrections)
    shrunk = jnp.maximum(state.damping / settings.damping_shrinkage, settings.damping_floor)
    grown = jnp.maximum(state.damping, settings.damping_restart) * settings.damping_growth
    damping = jnp.where(shrinks, shrunk, state.damping)
    damping = jnp.where(verdict == Verdict.REFUSED, grown, damping)
    at_start = jnp.clip(violation, settings.violation_limit, 1.0)
    allowed = jnp.where(jnp.isinf(state.cost), at_start, state.allowed)
    tightened = jnp.maximum(allowed, state.funnel * settings.funnel_shrinkage)

    # The best point is the cheapest one of those that satisfy the constraints.
    is_better = accepted & (violation <= allowed) & (cost < state.best.cost)
    best = _choose(is_better, BestPoint(x, best_cost, kept), state.best)

    return state._replace(
        x=x,
        cost=best_cost,
        violation=largest,
        report=kept,
        damping=damping,
        funnel=jnp.where(moved, tightened, state.funnel),
        allowed=allowed,
        trial_violation=jnp.where(corrected, violation, jnp.inf),
        corrections=jnp.where(corrected, state.corrections + 1, 0),
        best=best,
        kkt_residual=jnp.where(moved, jnp.inf, state.kkt_residual),
        iterations=state.iterations + 1,
    )


def with_step(
    settings: SequentialSettings,
    state: LaneState,
    verdict: Int[Array, ""],
    step: Any,
    curvature: Float[Array, ""],
    predict: Callable[[Any], Array],
) -> LaneState:
    """Return the state of a lane with its next step, and end the lane if it has arrived.

    Args:
        settings: Settings of the method.
        state: The lane after `after_judgement`.
        verdict: The `Verdict` on its last trial point.
        step: The step from `state.x` that solves the quadratic program, of a new point or a corrected one.
        curvature: Half the product ``d^T (H + damping I) d`` of this step.
        predict: Function of a step from `state.x` that returns the cost which the quadratic program predicts after it.
    """
    linearized = verdict == Verdict.ACCEPTED
    is_finite = jnp.isfinite(_largest(step))
    scale = jnp.minimum(1.0, settings.step_limit / jnp.maximum(_largest(step), TINY_COST))

    # After a refusal, the constraints are evaluated at the lane's point again, where the step is zero.
    stays = (verdict == Verdict.REFUSED) | ~is_finite
    step = jax.tree.map(lambda value: jnp.where(stays, 0.0, scale * value), step)
    raised = jnp.maximum(state.damping, settings.damping_restart) * settings.damping_growth
    damping = jnp.where(is_finite, state.damping, raised)
    promised = jnp.where(linearized, state.cost - predict(step), state.predicted_decrease)

    # The KKT residual is known where the quadratic program is that of the lane's point, with little damping.
    relative_curvature = jnp.abs(curvature) / jnp.maximum(jnp.abs(state.cost), TINY_COST)
    is_known = linearized & is_finite & (state.damping <= settings.kkt_damping)
    residual = jnp.where(is_known, relative_curvature, state.kkt_residual)

    is_optimal = is_known & (residual <= settings.kkt_tolerance)
    is_optimal &= state.violation <= state.allowed
    # A step that decreases the cost and restores feasibility may change the cost by nothing on balance.
    promises_little = jnp.abs(promised) <= settings.decrease_tolerance * jnp.abs(state.cost)
    promises_little &= relative_curvature <= settings.kkt_tolerance
    is_over = linearized & promises_little & (state.violation <= state.allowed)
    is_refused_gain = jnp.abs(promised) <= settings.refusal_tolerance * jnp.abs(state.cost)
    is_over |= (verdict == Verdict.REFUSED) & is_refused_gain & (state.violation <= state.allowed)
    is_over |= damping > settings.damping_limit
    is_over |= state.iterations >= settings.iteration_limit
    state = state._replace(
        step=step, damping=damping, predicted_decrease=promised, kkt_residual=residual
    )
    strays = (verdict == Verdict.REFUSED) & (damping > settings.stray_damping) & ~is_over
    return _with_status(settings, _after_retreat(settings, state, strays), is_optimal, is_over)


def _after_retreat(settings: SequentialSettings, state: LaneState, strays: Array) -> LaneState:
    """Return a lane that goes back to its best point if it has strayed to where only short steps are accepted.

    A point that violates the constraints may be one from which no step restores them.
    """
    retreats = strays & (state.violation > state.allowed) & jnp.isfinite(state.best.cost)
    x, step = _choose(
        retreats,
        (state.best.x, jax.tree.map(jnp.zeros_like, state.step)),
        (state.x, state.step),
    )
    narrowed = jnp.maximum(state.allowed, settings.retreat_funnel * state.funnel)
    return state._replace(
        x=x,
        step=step,
        damping=jnp.where(retreats, settings.retreat_damping, state.damping),
        funnel=jnp.where(retreats, narrowed, state.funnel),
    )


def _with_status(
    settings: SequentialSettings, state: LaneState, is_optimal: Array, is_over: Array
) -> LaneState:
    """Return a lane with its new status.

    A lane that ends without an optimal point goes back to its best one. The constraints are linearized there once more
    with the damping `kkt_damping`, so that the KKT residual of every solution is known.
    """
    has_best = jnp.isfinite(state.best.cost)
    closes = is_over & ~is_optimal & ~state.is_closing & has_best
    x, step = _choose(
        closes,
        (state.best.x, jax.tree.map(jnp.zeros_like, state.step)),
        (state.x, state.step),
    )

    running = int(SolverStatus.RUNNING)
    ended = jnp.where(has_best, running, int(SolverStatus.ITERATION_LIMIT))
    status = jnp.where(is_over, ended, running)
    status = jnp.where(state.is_closing, int(SolverStatus.FEASIBLE), status)
    status = jnp.where(is_optimal, int(SolverStatus.OPTIMAL), status)
    return state._replace(
        x=x,
        step=step,
        damping=jnp.where(closes, settings.kkt_damping, state.damping),
        is_closing=state.is_closing | closes,
        status=status.astype(jnp.int32),
    )


def _largest(tree: Any) -> Array:
    """Return the largest absolute entry of a pytree; NaN if there is one."""
    return jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(tree)]).max()


def _choose(condition: Array, new: Any, old: Any) -> Any:
    """Return the new or the old pytree."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
