"""One iteration of sequential quadratic programming on a batch of path NLPs of the same shape, one lane for each NLP.

As in `dvr_jax.solver.iteration`, the geometry of all lanes' trial points is computed by `measure_chunk`, and a second
compiled program does everything else. That program evaluates all rows at the trial points and judges these
(`dvr_jax.solver.sequential`). Lanes with an accepted point get a new quadratic program; the others keep theirs.

The quadratic program of a lane is eliminated down to its inequalities. With the factor ``L L^T = H + damping I +
p J_h^T J_h`` of the bordered system, the gradient c and the derivatives J of the R working rows,

    Y = L^-1 J^T,        S = Y^T Y + 1/p I,        b = Y^T L^-1 c - g,

`solve_nonnegative` returns the multipliers y, and the step is ``d = -L^-T (L^-1 c + Y y)``. A correction at the trial
point x + d uses the same L, Y and S. It minimizes the same function of the whole step d + e, so that c is the gradient
of cost and damping at x + d plus ``p J_h^T h(x + d)``, and g are the values of the rows there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, ConstraintKind, Horizon
from dvr_jax.nlp.cost import cost, curvature
from dvr_jax.nlp.evaluation import (
    TOLERANCES,
    FlatResiduals,
    evaluate_constraints,
    flatten,
    gauss_newton_system,
    horizon_of,
    number_of_flat_rows,
    relative_violation,
    row_scales,
    unflatten,
    violations_of,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, Slices
from dvr_jax.nlp.system import BorderedSystem
from dvr_jax.nlp.working_rows import (
    RowDerivatives,
    RowIndex,
    choose_rows,
    put_rows,
    row_derivatives,
    take_rows,
    working_rows_of,
)
from dvr_jax.runtime.compilation import Program
from dvr_jax.solver.banded import (
    BorderedFactor,
    ReducedSides,
    factorize_bordered,
    reduce_sides,
    solve_reduced,
)
from dvr_jax.solver.iteration import cut_into_chunks, join_chunks, measure_chunk
from dvr_jax.solver.quadratic_program import solve_nonnegative
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

EQUALITY_BLOCKS = [block for block in CONSTRAINT_BLOCKS if block.kind is ConstraintKind.EQUALITY]
"""The constraint blocks whose rows are equalities."""

ALWAYS = 10.0
"""Score of a row that had a multiplier in the last quadratic program [m or rad]; it stays a working row."""


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


LEAST_SCALE = 0.05
"""A lower bound of the scales of all rows."""


class QuadraticProgram(NamedTuple):
    """The quadratic program of one lane, eliminated down to its R working rows."""

    factor: BorderedFactor
    """Factor of the matrix of all variables."""

    jacobians: dict[str, Any]
    """Derivatives of the equalities, by block name."""

    sides: ReducedSides
    """Derivatives of the working rows after the forward sweep, the columns of Y."""

    matrix: Float[Array, "*lanes rows rows"]
    """The matrix S of the dual."""

    rows: RowIndex
    """The working rows."""

    has_multiplier: Bool[Array, "*lanes rows"]
    """Whether a working row had a positive multiplier."""

    refused: FlatResiduals
    """Values of all inequalities at the trial point that was refused last, since the lane moved; -infinite if none."""


class Trial(NamedTuple):
    """What is known of a lane's trial point."""

    cost: Array
    rows: FlatResiduals
    violation: Array
    report: dict[str, Array]
    verdict: Array


class DualSolution(NamedTuple):
    """Solution of a lane's quadratic program."""

    step: Variables
    multipliers: Array


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
    shapes = number_of_flat_rows(horizon)

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((B, *shape), dtype)

    infinity = np.full(B, np.inf, dtype)
    count = np.zeros(B, np.int32)
    return LaneState(
        x=x,
        step=Variables(np.zeros_like(x.q), np.zeros_like(x.m)),
        model=_empty_program(horizon, zeros, shapes),
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


def _empty_program(horizon: Horizon, zeros: Any, shapes: FlatResiduals) -> QuadraticProgram:
    """Return a placeholder; the first evaluation of a lane replaces it."""
    K = horizon.phases
    D = horizon.joints
    M = PARAMETERS * K
    width = 2 * D
    pairs = -(-horizon.slices // 2)
    number = working_rows_of(horizon)
    rows = number.collision + number.other
    B = len(zeros())
    lowest = FlatResiduals(
        zeros(*shapes.collision) - np.inf, zeros(0), zeros(*shapes.inequality) - np.inf
    )
    return QuadraticProgram(
        factor=BorderedFactor(
            zeros(pairs, width, width),
            zeros(pairs, width, width),
            zeros(pairs, width, M),
            zeros(M, M),
        ),
        jacobians={block.name: block.empty_jacobian(horizon, zeros) for block in EQUALITY_BLOCKS},
        sides=ReducedSides(zeros(pairs, width, rows), zeros(M, rows)),
        matrix=zeros(rows, rows),
        rows=RowIndex(
            np.zeros((B, number.collision), np.int32), np.zeros((B, number.other), np.int32)
        ),
        has_multiplier=np.zeros((B, rows), bool),
        refused=lowest,
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


def _scores(horizon: Horizon, program: QuadraticProgram, rows: FlatResiduals) -> FlatResiduals:
    """Return the score of every inequality of one lane, by which working rows are chosen."""
    # A row that the refused step ran into counts with its value there, and one with a multiplier stays.
    highest = rows._replace(
        collision=jnp.maximum(rows.collision, program.refused.collision),
        inequality=jnp.maximum(rows.inequality, program.refused.inequality),
    )
    kept = jnp.where(program.has_multiplier, ALWAYS, take_rows(highest, program.rows))
    scores = put_rows(kept, program.rows, highest)

    # The scales bring meters and radians to a common scale.
    scales = row_scales(horizon, rows.inequality.dtype)
    return scores._replace(inequality=scores.inequality * scales.inequality)


def _linearize(
    model: WorkcellModel,
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    chunks: tuple[SliceGeometry, ...],
    jacobians: dict[str, Any],
    rows: FlatResiduals,
) -> QuadraticProgram:
    """Return the quadratic programs at the points of all lanes, which have just been evaluated."""
    x = states.x
    horizon = horizon_of(model, problems, x)

    # The inequalities, and their derivatives.
    scores = jax.vmap(_scores, in_axes=(None, 0, 0))(horizon, states.model, rows)
    index = materialize(jax.vmap(choose_rows, in_axes=(0, None))(scores, horizon))
    derivatives = materialize(
        row_derivatives(model, problems, x, horizon, chunks, jacobians, index)
    )
    of_equalities = {block.name: jacobians[block.name] for block in EQUALITY_BLOCKS}

    def eliminate(
        problem: Problem,
        state: LaneState,
        jacobians: dict[str, Any],
        index: RowIndex,
        derivatives: RowDerivatives,
        rows: FlatResiduals,
        scores: FlatResiduals,
    ) -> QuadraticProgram:
        """Factorize the matrix of one lane, and do the forward sweep for the derivatives of its working rows."""
        system = _system(problem, state.x, settings, horizon, jacobians, rows.equality)
        factor = materialize(factorize_bordered(system, state.damping))
        sides = reduce_sides(factor, derivatives.by_joints, derivatives.by_parameters)
        flat = sides.of_joints.reshape(-1, sides.of_joints.shape[-1])
        matrix = flat.T @ flat + sides.of_parameters.T @ sides.of_parameters
        matrix += jnp.eye(len(matrix), dtype=matrix.dtype) / settings.equality_penalty
        had_multiplier = take_rows(scores, index) >= LEAST_SCALE * ALWAYS
        return state.model._replace(
            factor=factor,
            jacobians=jacobians,
            sides=sides,
            matrix=matrix,
            rows=index,
            has_multiplier=had_multiplier,
        )

    return materialize(
        jax.vmap(eliminate)(problems, states, of_equalities, index, derivatives, rows, scores)
    )


def _system(
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


def _solve_program(
    problem: Problem,
    state: LaneState,
    trial: Variables,
    rows: FlatResiduals,
    settings: SequentialSettings,
    horizon: Horizon,
) -> DualSolution:
    """Solve the quadratic program of one lane with the values of all rows at a trial point.

    Args:
        problem: The NLP.
        state: The lane.
        trial: The trial point, or the lane's point.
        rows: Values of all rows there.
        settings: Settings of the method.
        horizon: Sizes of the NLP.
    """
    program: QuadraticProgram = state.model
    moved = jax.tree.map(jnp.subtract, trial, state.x)

    # The gradient of cost, damping and penalized equalities at the trial point.
    system = _system(problem, trial, settings, horizon, program.jacobians, rows.equality)
    free = jnp.asarray(problem.parameter_upper > problem.parameter_lower, trial.q.dtype)
    of_joints = system.gradient_q + state.damping * moved.q
    of_parameters = system.gradient_m + state.damping * (free * moved.m).reshape(-1)
    gradient = reduce_sides(program.factor, of_joints[..., None], of_parameters[:, None])
    c = jax.tree.map(lambda value: value[..., 0], gradient)

    # The inequalities at the minimum without them, then their multipliers.
    at_minimum = take_rows(rows, program.rows) - (
        jnp.einsum("pwr,pw->r", program.sides.of_joints, c.of_joints)
        + c.of_parameters @ program.sides.of_parameters
    )
    y = solve_nonnegative(program.matrix, -at_minimum, program.has_multiplier)

    # The step from the trial point, and from the lane's point.
    side = ReducedSides(
        -(c.of_joints + program.sides.of_joints @ y),
        -(c.of_parameters + program.sides.of_parameters @ y),
    )
    dq, dm = solve_reduced(program.factor, side, horizon.slices)
    step = Variables(moved.q + dq, moved.m + dm.reshape(moved.m.shape))
    return DualSolution(step, y)


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
        solution = _solve_program(problem, state, at, trial.rows, settings, horizon)
        program = state.model._replace(
            has_multiplier=jnp.where(
                trial.verdict == Verdict.REFUSED,
                state.model.has_multiplier,
                solution.multipliers > 0,
            )
        )

        def predict(step: Variables) -> Array:
            # The cost is quadratic, so that the prediction is exact.
            return cost(problem, jax.tree.map(jnp.add, state.x, step))

        squares = jnp.sum(solution.step.q**2) + jnp.sum(solution.step.m**2)
        return with_step(
            settings,
            state._replace(model=program),
            trial.verdict,
            solution.step,
            curvature(problem, solution.step) + 0.5 * state.damping * squares,
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

    def linearize() -> QuadraticProgram:
        return _linearize(model, problems, settings, judged, chunks, jacobians, trials.rows)

    programs = jax.lax.cond(jnp.any(accepted), linearize, lambda: judged.model)
    judged = judged._replace(model=_choose_lanes(accepted, programs, judged.model))

    new = _advance(problems, settings, judged, trials, horizon)
    states = materialize(_choose_lanes(is_running, new, states))
    return states, cut_into_chunks(lay_out(problems, trial_point(states)))


def _choose_lanes(condition: Array, new: Any, old: Any) -> Any:
    """Return the new values of some lanes and the old values of all others."""

    def choose(new: Array, old: Array) -> Array:
        return jnp.where(condition.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    return jax.tree.map(choose, new, old)


def iterate(
    model: WorkcellModel,
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    chunks: tuple[Slices, ...],
) -> tuple[LaneState, tuple[Slices, ...]]:
    """Do one iteration of a batch of NLPs by calling the compiled programs one after the other.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        chunks: Slices of the trial points (`lay_out_chunks`).

    Returns:
        The new states, and the slices of the next trial points, cut into chunks.
    """
    return step(
        model, problems, settings, states, tuple(measure_chunk(model, chunk) for chunk in chunks)
    )


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


__all__ = ["RESTARTED", "QuadraticProgram", "initial_states", "iterate", "restart", "step"]
