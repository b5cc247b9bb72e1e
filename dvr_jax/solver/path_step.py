"""The step of a path's quadratic program: from the lane's point, or corrected at a trial point.

A correction at the trial point x + d uses the same L, Y and S (`dvr_jax.solver.path_program`) as the step d. It
minimizes the same function of the whole step d + e, so that c is the gradient of cost, curvature and damping at x + d
plus ``p J_h^T h(x + d)``, and g are the values of the rows there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import Horizon
from dvr_jax.nlp.curvature import times_curvature
from dvr_jax.nlp.evaluation import FlatResiduals, number_of_flat_rows, row_scales, unflatten
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import empty_parts
from dvr_jax.nlp.working_rows import take_rows
from dvr_jax.solver.banded import ReducedSides, reduce_sides, solve_reduced
from dvr_jax.solver.path_matrix import EQUALITY_BLOCKS, penalized_system
from dvr_jax.solver.path_program import QuadraticProgram
from dvr_jax.solver.quadratic_program import solve_nonnegative
from dvr_jax.solver.sequential import LaneState, SequentialSettings


class DualSolution(NamedTuple):
    """Solution of a lane's quadratic program."""

    step: Variables
    """Step from the lane's point."""

    multipliers: Float[Array, " rows"]
    """Multipliers of the working rows."""

    equality_multipliers: Float[Array, " equalities"]
    """Multipliers of the equalities."""


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
    system = penalized_system(problem, trial, settings, horizon, program.jacobians, rows.equality)
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
