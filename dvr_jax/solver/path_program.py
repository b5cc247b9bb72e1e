"""The quadratic program of a path at one point, eliminated down to its inequalities.

With the factor ``L L^T = H + damping I + p J_h^T J_h`` of the bordered system, the gradient c and the derivatives J of
the R working rows (`dvr_jax.nlp.working_rows`),

    Y = L^-1 J^T,        S = Y^T Y + 1/p I,        b = Y^T L^-1 c - g,

`solve_nonnegative` returns the multipliers y, and the step is ``d = -L^-T (L^-1 c + Y y)``. A correction at the trial
point x + d uses the same L, Y and S. It minimizes the same function of the whole step d + e, so that c is the gradient
of cost and damping at x + d plus ``p J_h^T h(x + d)``, and g are the values of the rows there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, ConstraintKind, Horizon
from dvr_jax.nlp.evaluation import (
    FlatResiduals,
    gauss_newton_system,
    horizon_of,
    number_of_flat_rows,
    row_scales,
    unflatten,
)
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry
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
from dvr_jax.solver.banded import (
    BorderedFactor,
    ReducedSides,
    factorize_bordered,
    reduce_sides,
    solve_reduced,
)
from dvr_jax.solver.quadratic_program import solve_nonnegative
from dvr_jax.solver.sequential import LaneState, SequentialSettings
from dvr_jax.workcell.model import WorkcellModel

EQUALITY_BLOCKS = [block for block in CONSTRAINT_BLOCKS if block.kind is ConstraintKind.EQUALITY]
"""The constraint blocks whose rows are equalities."""

ALWAYS = 10.0
"""Score of a row that had a multiplier in the last quadratic program [m or rad]; it stays a working row."""


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


class DualSolution(NamedTuple):
    """Solution of a lane's quadratic program."""

    step: Variables
    multipliers: Array


def empty_program(horizon: Horizon, zeros: Callable[..., np.ndarray]) -> QuadraticProgram:
    """Return a placeholder for the quadratic programs of a batch; the first evaluation of a lane replaces it.

    Args:
        horizon: Sizes of the NLPs.
        zeros: Function that returns an array of zeros of a shape, with a leading axis of lanes.
    """
    shapes = number_of_flat_rows(horizon)
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


def _had_multiplier(program: QuadraticProgram, rows: FlatResiduals) -> FlatResiduals:
    """Return 1 for every inequality of one lane that had a multiplier in the last quadratic program, else 0."""
    nothing = jax.tree.map(jnp.zeros_like, rows)
    values = jnp.asarray(program.has_multiplier, rows.inequality.dtype)
    return put_rows(values, program.rows, nothing)


def _scores(
    horizon: Horizon, program: QuadraticProgram, rows: FlatResiduals, had: FlatResiduals
) -> FlatResiduals:
    """Return the score of every inequality of one lane, by which working rows are chosen.

    Args:
        horizon: Sizes of the NLP.
        program: The last quadratic program.
        rows: Values of all rows.
        had: 1 for every inequality that had a multiplier in that program, else 0.
    """
    # A row that the refused step ran into counts with its value there. The scales bring meters and radians to a common
    # scale, and a row with a multiplier stays.
    scales = row_scales(horizon, rows.inequality.dtype)
    collision = jnp.maximum(rows.collision, program.refused.collision)
    inequality = jnp.maximum(rows.inequality, program.refused.inequality) * scales.inequality
    return rows._replace(
        collision=jnp.where(had.collision > 0, ALWAYS, collision),
        inequality=jnp.where(had.inequality > 0, ALWAYS, inequality),
    )


def linearize(
    model: WorkcellModel,
    problems: Problem,
    settings: SequentialSettings,
    states: LaneState,
    chunks: tuple[SliceGeometry, ...],
    jacobians: dict[str, Any],
    rows: FlatResiduals,
) -> QuadraticProgram:
    """Return the quadratic programs at the points of all lanes, which have just been evaluated.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        chunks: Geometry of the slices of their points.
        jacobians: Derivatives of each block's rows, by block name.
        rows: Values of all rows.
    """
    x = states.x
    horizon = horizon_of(model, problems, x)

    # The inequalities, and their derivatives.
    had = jax.vmap(_had_multiplier)(states.model, rows)
    scores = jax.vmap(_scores, in_axes=(None, 0, 0, 0))(horizon, states.model, rows, had)
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
        had: FlatResiduals,
    ) -> QuadraticProgram:
        """Factorize the matrix of one lane, and do the forward sweep for the derivatives of its working rows."""
        system = _system(problem, state.x, settings, horizon, jacobians, rows.equality)
        factor = materialize(factorize_bordered(system, state.damping))
        sides = reduce_sides(factor, derivatives.by_joints, derivatives.by_parameters)
        flat = sides.of_joints.reshape(-1, sides.of_joints.shape[-1])
        matrix = flat.T @ flat + sides.of_parameters.T @ sides.of_parameters
        matrix += jnp.eye(len(matrix), dtype=matrix.dtype) / settings.equality_penalty
        return state.model._replace(
            factor=factor,
            jacobians=jacobians,
            sides=sides,
            matrix=matrix,
            rows=index,
            has_multiplier=take_rows(had, index) > 0,
        )

    return materialize(
        jax.vmap(eliminate)(problems, states, of_equalities, index, derivatives, rows, had)
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


def solve_program(
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
