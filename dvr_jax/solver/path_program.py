"""The quadratic program of a path at one point, eliminated down to its inequalities.

With the factor L of the matrix (`dvr_jax.solver.path_matrix`), the gradient c and the derivatives J of the R working
rows (`dvr_jax.nlp.working_rows`),

    Y = L^-1 J^T,        S = Y^T Y + 1/p I,        b = Y^T L^-1 c - g,

`solve_nonnegative` returns the multipliers y, and the step is ``d = -L^-T (L^-1 c + Y y)``. Steps and their corrections
are computed in `dvr_jax.solver.path_step`.
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
from dvr_jax.nlp.blocks import Horizon
from dvr_jax.nlp.curvature import constraint_curvature
from dvr_jax.nlp.evaluation import (
    FlatResiduals,
    evaluation_input,
    horizon_of,
    number_of_flat_rows,
    row_scales,
)
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.slices import SliceGeometry
from dvr_jax.nlp.system import Curvature
from dvr_jax.nlp.working_rows import (
    RowDerivatives,
    RowIndex,
    choose_rows,
    put_rows,
    row_derivatives,
    take_multipliers,
    working_rows_of,
)
from dvr_jax.solver.banded import (
    BorderedFactor,
    ReducedSides,
    reduce_sides,
)
from dvr_jax.solver.iteration import join_chunks
from dvr_jax.solver.path_matrix import (
    EQUALITY_BLOCKS,
    factorize_convexified,
    penalized_system,
    row_weights,
)
from dvr_jax.solver.sequential import LaneState, SequentialSettings
from dvr_jax.workcell.model import WorkcellModel

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
        system = penalized_system(problem, state.x, settings, horizon, jacobians, rows.equality)
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
