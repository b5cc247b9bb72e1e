"""The quadratic program of a path at one point, eliminated down to its inequalities.

With the factor L of the matrix (`dvr_jax.solver.path_matrix`), the gradient c and the derivatives J of the R working
rows (`dvr_jax.nlp.working_rows`),

    Y = L^-1 J^T,        S = Y^T Y + 1/p I,        b = Y^T L^-1 c - g,

`solve_nonnegative` returns the multipliers y, and the step is ``d = -L^-T (L^-1 c + Y y)``. A correction at the trial
point x + d uses the same L, Y and S. It minimizes the same function of the whole step d + e, so that c is the gradient
of cost, curvature and damping at x + d plus ``p J_h^T h(x + d)``, and g are the values of the rows there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, ConstraintKind, Horizon
from dvr_jax.nlp.curvature import constraint_curvature, times_curvature
from dvr_jax.nlp.evaluation import (
    FlatResiduals,
    evaluation_input,
    gauss_newton_system,
    horizon_of,
    number_of_flat_rows,
    row_scales,
    unflatten,
)
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry
from dvr_jax.nlp.system import BorderedSystem, Curvature, empty_parts
from dvr_jax.nlp.working_rows import (
    RowDerivatives,
    RowIndex,
    choose_rows,
    put_rows,
    row_derivatives,
    take_multipliers,
    take_rows,
    working_rows_of,
)
from dvr_jax.solver.banded import (
    BorderedFactor,
    ReducedSides,
    reduce_sides,
    solve_reduced,
)
from dvr_jax.solver.iteration import join_chunks
from dvr_jax.solver.path_matrix import factorize_convexified, row_weights
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

    multipliers: Float[Array, "*lanes rows"]
    """Multipliers of the working rows in the last quadratic program."""

    equality_multipliers: Float[Array, "*lanes equalities"]
    """Multipliers of the equalities."""

    curvature: Curvature
    """Curvature of the constraints in the matrix."""

    weights: Float[Array, "*lanes rows"]
    """Penalties of the working rows in the matrix."""

    refused: FlatResiduals
    """Values of all inequalities at the trial point that was refused last, since the lane moved; -infinite if none."""


class DualSolution(NamedTuple):
    """Solution of a lane's quadratic program."""

    step: Variables
    """Step from the lane's point."""

    multipliers: Float[Array, " rows"]
    """Multipliers of the working rows."""

    equality_multipliers: Float[Array, " equalities"]
    """Multipliers of the equalities."""


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
        multipliers=zeros(rows),
        equality_multipliers=zeros(*shapes.equality),
        curvature=Curvature(
            zeros(horizon.slices, D, D),
            zeros(horizon.slices, D, D),
            zeros(horizon.slices, D, M),
            zeros(M, M),
        ),
        weights=zeros(rows),
        refused=lowest,
    )


def _all_multipliers(program: QuadraticProgram, rows: FlatResiduals) -> FlatResiduals:
    """Return the multipliers of all rows of one lane in the last quadratic program."""
    nothing = jax.tree.map(jnp.zeros_like, rows)
    found = put_rows(program.multipliers, program.rows, nothing)
    return found._replace(equality=program.equality_multipliers)


def _scores(
    horizon: Horizon, program: QuadraticProgram, rows: FlatResiduals, multipliers: FlatResiduals
) -> FlatResiduals:
    """Return the score of every inequality of one lane, by which working rows are chosen.

    Args:
        horizon: Sizes of the NLP.
        program: The last quadratic program.
        rows: Values of all rows.
        multipliers: Multipliers of all rows in that program.
    """
    # A row that the refused step ran into counts with its value there. The scales bring meters and radians to a common
    # scale, and a row with a multiplier stays.
    scales = row_scales(horizon, rows.inequality.dtype)
    collision = jnp.maximum(rows.collision, program.refused.collision)
    inequality = jnp.maximum(rows.inequality, program.refused.inequality) * scales.inequality
    return rows._replace(
        collision=jnp.where(multipliers.collision > 0, ALWAYS, collision),
        inequality=jnp.where(multipliers.inequality > 0, ALWAYS, inequality),
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
    multipliers = jax.vmap(_all_multipliers)(states.model, rows)
    scores = jax.vmap(_scores, in_axes=(None, 0, 0, 0))(horizon, states.model, rows, multipliers)
    index = materialize(jax.vmap(choose_rows, in_axes=(0, None))(scores, horizon))
    derivatives = materialize(
        row_derivatives(model, problems, x, horizon, chunks, jacobians, index)
    )
    of_equalities = {block.name: jacobians[block.name] for block in EQUALITY_BLOCKS}
    slices = len(x.q) * horizon.slices * horizon.samples
    given = evaluation_input(model, problems, x, join_chunks(chunks, slices))
    curvatures = materialize(
        constraint_curvature(model, given, horizon, chunks, multipliers, index)
    )

    def eliminate(
        problem: Problem,
        state: LaneState,
        jacobians: dict[str, Any],
        index: RowIndex,
        derivatives: RowDerivatives,
        curvature: Curvature,
        rows: FlatResiduals,
        multipliers: FlatResiduals,
    ) -> QuadraticProgram:
        """Factorize the matrix of one lane, and do the forward sweep for the derivatives of its working rows."""
        system = _system(problem, state.x, settings, horizon, jacobians, rows.equality)
        known = take_multipliers(multipliers, index)
        weights = row_weights(known, horizon.phases)
        factor, share = materialize(
            factorize_convexified(system, curvature, derivatives, weights, state.damping)
        )
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
            multipliers=known,
            curvature=jax.tree.map(lambda value: share * value, curvature),
            weights=weights,
        )

    return materialize(
        jax.vmap(eliminate)(
            problems, states, of_equalities, index, derivatives, curvatures, rows, multipliers
        )
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

    # The gradient of cost, curvature, damping and penalized rows at the trial point.
    system = _system(problem, trial, settings, horizon, program.jacobians, rows.equality)
    free = jnp.asarray(problem.parameter_upper > problem.parameter_lower, trial.q.dtype)
    curved = times_curvature(program.curvature, moved)
    of_joints = system.gradient_q + state.damping * moved.q + curved.q
    of_parameters = system.gradient_m + (state.damping * free * moved.m + curved.m).reshape(-1)
    gradient = reduce_sides(program.factor, of_joints[..., None], of_parameters[:, None])
    values = take_rows(rows, program.rows)
    penalized = program.weights * values
    c = ReducedSides(
        gradient.of_joints[..., 0] + program.sides.of_joints @ penalized,
        gradient.of_parameters[..., 0] + program.sides.of_parameters @ penalized,
    )

    # The inequalities at the minimum without them, then their multipliers.
    at_minimum = values - (
        jnp.einsum("pwr,pw->r", program.sides.of_joints, c.of_joints)
        + c.of_parameters @ program.sides.of_parameters
    )
    y = solve_nonnegative(program.matrix, -at_minimum, program.multipliers > 0)

    # The step from the trial point, and from the lane's point.
    side = ReducedSides(
        -(c.of_joints + program.sides.of_joints @ y),
        -(c.of_parameters + program.sides.of_parameters @ y),
    )
    dq, dm = solve_reduced(program.factor, side, horizon.slices)
    step = Variables(moved.q + dq, moved.m + dm.reshape(moved.m.shape))

    # A penalized row also has the multiplier of its penalty, and an equality has none but this one.
    at_step = at_minimum - (program.matrix @ y - y / settings.equality_penalty)
    scale = row_scales(horizon, trial.q.dtype).equality
    change = _equality_changes(problem, trial, horizon, program.jacobians, Variables(dq, dm))
    return DualSolution(
        step,
        jnp.maximum(y + program.weights * at_step, 0),
        settings.equality_penalty * scale * (rows.equality + change),
    )


def _equality_changes(
    problem: Problem, x: Variables, horizon: Horizon, jacobians: dict[str, Any], step: Variables
) -> Float[Array, " equalities"]:
    """Return the products of the equalities' derivatives and a step; its mode parameters are in one row."""
    shapes = number_of_flat_rows(horizon)
    parameters = PARAMETERS * horizon.phases

    def gradient(equality: Array) -> tuple[Array, Array]:
        """Return the transposed product, to which every block adds its part."""
        nothing = FlatResiduals(jnp.zeros(()), equality, jnp.zeros(shapes.inequality))
        estimates = unflatten(nothing, horizon)
        parts = empty_parts(horizon.slices, horizon.joints, parameters, x.q.dtype)
        for block in EQUALITY_BLOCKS:
            estimate = estimates[block.name]
            parts = block.add_to_system(
                parts, problem, x, jacobians[block.name], estimate, jnp.zeros_like(estimate)
            )
        return parts.gradient_q, parts.gradient_m

    zeros = jnp.zeros(shapes.equality, x.q.dtype)
    (change,) = jax.linear_transpose(gradient, zeros)((step.q, step.m))
    return change
