"""One iteration of sequential quadratic programming on a batch of path NLPs of the same shape, one lane for each NLP.

As in `dvr_jax.solver.iteration`, the geometry of all lanes' trial points is computed by `measure_chunk`, and a second
compiled program does everything else. That program evaluates all rows at the trial points and judges these
(`dvr_jax.solver.sequential`). Lanes with an accepted point get a new quadratic program (`dvr_jax.solver.path_program`);
the others keep theirs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.nlp.blocks import Horizon
from dvr_jax.nlp.cost import cost, curvature
from dvr_jax.nlp.curvature import times_curvature
from dvr_jax.nlp.evaluation import (
    TOLERANCES,
    FlatResiduals,
    evaluate_constraints,
    flatten,
    horizon_of,
    relative_violation,
    violations_of,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, Slices
from dvr_jax.runtime.compilation import Program
from dvr_jax.solver.iteration import cut_into_chunks, join_chunks
from dvr_jax.solver.path_program import (
    QuadraticProgram,
    empty_program,
    linearize,
)
from dvr_jax.solver.path_step import solve_program
from dvr_jax.solver.sequential import (
    BestPoint,
    LaneState,
    SequentialSettings,
    Verdict,
    after_judgement,
    judge,
    trial_point,
    with_step,
)
from dvr_jax.solver.state import SolverStatus
from dvr_jax.workcell.model import WorkcellModel

RESTARTED = (
    "step",
    "cost",
    "violation",
    "trial_violation",
    "damping",
    "funnel",
    "corrections",
    "best",
    "report",
    "kkt_residual",
    "is_closing",
    "iterations",
    "status",
)
"""Fields of `LaneState` that change when a lane is restarted or ends at the limit of its restarts."""


class Trial(NamedTuple):
    """What is known of a lane's trial point."""

    cost: Array
    rows: FlatResiduals
    violation: Array
    report: dict[str, Array]
    verdict: Array


def initial_states(
    model: WorkcellModel, problems: Problem, x: Variables, settings: SequentialSettings
) -> LaneState:
    """Return the states of lanes before their first evaluation, as NumPy arrays.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        x: Starting points of the problems.
        settings: Settings of the method.
    """
    B = len(x.q)
    dtype = x.q.dtype
    horizon = horizon_of(model, problems, x)

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((B, *shape), dtype)

    infinity = np.full(B, np.inf, dtype)
    count = np.zeros(B, np.int32)
    return LaneState(
        x=x,
        step=Variables(np.zeros_like(x.q), np.zeros_like(x.m)),
        model=empty_program(horizon, zeros),
        cost=infinity,
        violation=infinity,
        trial_violation=infinity,
        predicted_decrease=zeros(),
        damping=np.full(B, settings.damping, dtype),
        funnel=np.full(B, settings.funnel, dtype),
        allowed=infinity,
        corrections=count,
        best=BestPoint(x, infinity, dict.fromkeys(TOLERANCES, infinity)),
        report=dict.fromkeys(TOLERANCES, infinity),
        kkt_residual=infinity,
        is_closing=np.zeros(B, bool),
        iterations=count.copy(),
        status=count.copy(),
    )


def _try_points(
    model: WorkcellModel,
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    chunks: tuple[SliceGeometry, ...],
) -> tuple[Trial, dict[str, Any]]:
    """Evaluate all rows at the trial points and judge these.

    Returns:
        What is known of the trial points, and the derivatives of each block's rows there.
    """
    x = trial_point(states)
    horizon = horizon_of(model, problems, x)
    slices = len(x.q) * horizon.slices * horizon.samples
    evaluations = materialize(evaluate_constraints(model, problems, x, join_chunks(chunks, slices)))
    report = violations_of(evaluations)
    rows = jax.vmap(flatten)({name: evaluation.rows for name, evaluation in evaluations.items()})
    costs = jax.vmap(cost)(problems, x)
    violation = relative_violation(report)

    def judge_lane(state: LaneState, cost: Array, violation: Array) -> Array:
        return judge(settings, state, cost, violation)

    verdict = jax.vmap(judge_lane)(states, costs, violation)
    jacobians = {name: evaluation.jacobian for name, evaluation in evaluations.items()}
    return Trial(costs, rows, violation, report, verdict), jacobians


def _advance(
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    trials: Trial,
    horizon: Horizon,
) -> LaneState:
    """Solve the quadratic program of every lane, which gives its next trial point."""

    def advance_lane(problem: Problem, state: LaneState, trial: Trial) -> LaneState:
        corrected = trial.verdict == Verdict.CORRECTED
        at = jax.tree.map(
            lambda new, old: jnp.where(corrected, new, old), trial_point(state), state.x
        )
        solution = solve_program(problem, state, at, trial.rows, settings, horizon)
        refused = trial.verdict == Verdict.REFUSED
        program = state.model._replace(
            multipliers=jnp.where(refused, state.model.multipliers, solution.multipliers),
            equality_multipliers=jnp.where(
                refused, state.model.equality_multipliers, solution.equality_multipliers
            ),
        )

        def curved(step: Variables) -> Array:
            # Half the product of the constraints' curvature with a step on both sides.
            change = times_curvature(state.model.curvature, step)
            return 0.5 * (jnp.sum(change.q * step.q) + jnp.sum(change.m * step.m))

        def predict(step: Variables) -> Array:
            # The cost is quadratic. Corrections of the step will change it by the curvature of the constraints.
            return cost(problem, jax.tree.map(jnp.add, state.x, step)) + curved(step)

        squares = jnp.sum(solution.step.q**2) + jnp.sum(solution.step.m**2)
        return with_step(
            settings,
            state._replace(model=program),
            trial.verdict,
            solution.step,
            curvature(problem, solution.step)
            + curved(solution.step)
            + 0.5 * state.damping * squares,
            predict,
        )

    return jax.vmap(advance_lane)(problems, states, trials)


def _with_refused_rows(states: LaneState, new: LaneState, trials: Trial) -> LaneState:
    """Remember the rows of refused trial points, and forget them once a lane has moved."""

    def remember(state: LaneState, new: LaneState, trial: Trial) -> FlatResiduals:
        old = new.model.refused
        moved = (trial.verdict == Verdict.ACCEPTED) & (jnp.abs(state.step.q).max() > 0)
        refused = trial.verdict == Verdict.REFUSED

        def choose(seen: Array, value: Array) -> Array:
            kept = jnp.where(moved, -jnp.inf, seen)
            return jnp.where(refused, value, kept)

        return old._replace(
            collision=choose(old.collision, trial.rows.collision),
            inequality=choose(old.inequality, trial.rows.inequality),
        )

    refused = jax.vmap(remember)(states, new, trials)
    return new._replace(model=new.model._replace(refused=refused))


@Program
def step(
    model: WorkcellModel,
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    chunks: tuple[SliceGeometry, ...],
) -> tuple[LaneState, tuple[Slices, ...]]:
    """Do the part of an iteration that follows the computation of the geometry, in one compiled program.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        chunks: Geometry of the slices of their trial points.

    Returns:
        The new states, and the slices of the next trial points, cut into chunks.
    """
    trials, jacobians = materialize(_try_points(model, problems, settings, states, chunks))
    horizon = horizon_of(model, problems, states.x)
    is_running = states.status == SolverStatus.RUNNING

    def after(state: LaneState, trial: Trial) -> LaneState:
        return after_judgement(
            settings, state, trial.verdict, trial.cost, trial.violation, trial.report
        )

    judged = jax.vmap(after)(states, trials)
    judged = materialize(_with_refused_rows(states, judged, trials))

    # Derivatives are computed only if a lane was moved to a new point.
    accepted = (trials.verdict == Verdict.ACCEPTED) & is_running

    def linearized() -> QuadraticProgram:
        return linearize(model, problems, settings, judged, chunks, jacobians, trials.rows)

    programs = jax.lax.cond(jnp.any(accepted), linearized, lambda: judged.model)
    judged = judged._replace(model=_choose_lanes(accepted, programs, judged.model))

    new = _advance(problems, settings, judged, trials, horizon)
    states = materialize(_choose_lanes(is_running, new, states))
    return states, cut_into_chunks(lay_out(problems, trial_point(states)))


def _choose_lanes(condition: Array, new: Any, old: Any) -> Any:
    """Return the new values of some lanes and the old values of all others."""

    def choose(new: Array, old: Array) -> Array:
        return jnp.where(condition.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    return jax.tree.map(choose, new, old)


def restart(states: LaneState, index: int, settings: SequentialSettings) -> None:
    """Start a lane that has ended again from its point; the next evaluation linearizes the constraints there.

    Args:
        states: States of the lanes, of which the fields `RESTARTED` are changed in place.
        index: Index of the lane.
        settings: Settings of the method.
    """
    for step in states.step:
        step[index] = 0
    for value in (
        states.cost,
        states.violation,
        states.trial_violation,
        states.best.cost,
        states.kkt_residual,
    ):
        value[index] = np.inf
    states.damping[index] = float(settings.damping)
    states.funnel[index] = float(settings.funnel)
    states.corrections[index] = 0
    states.is_closing[index] = False
    states.iterations[index] = 0
    states.status[index] = SolverStatus.RUNNING


__all__ = ["RESTARTED", "QuadraticProgram", "initial_states", "restart", "step"]
