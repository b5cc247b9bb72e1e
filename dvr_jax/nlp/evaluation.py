"""Evaluate all constraint blocks of NLPs: compute their rows, their violations and the Gauss-Newton system.

This module defines what "feasible" means for solver, data set, search and benchmarks: every violation of every block,
in meters or radians, is within its tolerance. The largest single violation counts, and not a sum of scaled violations,
because such a sum grows with the number of slices. A path must also be feasible between its samples
(`dvr_jax.solver.continuous_collision`), and a motion is a solution only if the independent check accepts it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS, HandPoses
from dvr_jax.nlp.blocks import (
    COLLISION,
    CONSTRAINT_BLOCKS,
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    SwitchGeometry,
)
from dvr_jax.nlp.collision_rows import number_of_rows
from dvr_jax.nlp.cost import add_cost
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import NormalEquations, SliceGeometry
from dvr_jax.nlp.system import BorderedSystem, assemble, empty_parts
from dvr_jax.workcell.model import WorkcellModel

Violations = dict[str, Array]
"""Largest violation of each measure of each block, zero or positive, by the measure's name."""

Evaluations = dict[str, Evaluation]
"""Rows of each block, by the block's name."""

TOLERANCES: dict[str, float] = {
    measure.name: measure.tolerance for block in CONSTRAINT_BLOCKS for measure in block.measures
}
"""Largest violation of a feasible point, by the measure's name."""


class FlatResiduals(NamedTuple):
    """A value for every row of one NLP, in three arrays; fewer arrays need fewer compiled kernels."""

    collision: Any
    """Values of the collision rows (T M, P): M samples for each of the T slices, P distances for each sample."""

    equality: Any
    """Values of the rows of all equalities, one block after the other."""

    inequality: Any
    """Values of the rows of all other inequalities, one block after the other."""


EQUALITIES = FlatResiduals(collision=False, equality=True, inequality=False)
"""Which rows are equalities."""


def horizon_of(model: WorkcellModel, problems: Problem, x: Variables) -> Horizon:
    """Return the sizes of an NLP, with or without batch axes.

    Args:
        model: Arms of the workcell.
        problems: One or more problems.
        x: Their variables.
    """
    rows = number_of_rows(model.structure, problems.prism.shape[-2], problems.fixed_prism.shape[-2])
    return Horizon(
        slices=x.q.shape[-2],
        phases=x.m.shape[-2],
        samples=problems.sample_fraction.shape[-1],
        joints=x.q.shape[-1],
        collision_rows=rows,
        kept_clear=problems.kept_clear.shape[-2],
        tops=problems.top_object.shape[-1],
    )


def evaluate_constraints(
    model: WorkcellModel, problems: Problem, x: Variables, geometry: SliceGeometry
) -> Evaluations:
    """Evaluate all blocks of a batch of B problems.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        x: Their variables.
        geometry: Distances, hands and screws of their L slices (`dvr_jax.nlp.layout.lay_out`).
    """
    given = evaluation_input(model, problems, x, geometry)
    return {block.name: block.evaluate(given) for block in CONSTRAINT_BLOCKS}


def evaluation_input(
    model: WorkcellModel, problems: Problem, x: Variables, geometry: SliceGeometry
) -> EvaluationInput:
    """Return what the rows of all blocks are computed from, for a batch of B problems.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        x: Their variables.
        geometry: Distances, hands and screws of their L slices (`dvr_jax.nlp.layout.lay_out`).
    """
    B, K = x.m.shape[:2]
    samples = geometry.distance.shape[0] // B

    def by_problem(value: Array) -> Array:
        """(..., L) to (..., B, samples)."""
        return value.reshape(*value.shape[:-1], B, samples)

    def at_switch(value: Array) -> Array:
        """(..., L) to (..., B K)."""
        at_ends = by_problem(value)[..., samples // K - 1 :: samples // K]
        return at_ends.reshape(*value.shape[:-1], B * K)

    return EvaluationInput(
        problems=problems,
        x=x,
        distance=geometry.distance.reshape(B, samples, -1),
        switches=SwitchGeometry(
            HandPoses(at_switch(geometry.hands.rotation), at_switch(geometry.hands.position)),
            at_switch(geometry.screws),
        ),
        hands=HandPoses(by_problem(geometry.hands.rotation), by_problem(geometry.hands.position)),
        screws=by_problem(geometry.screws),
        joint_limits=jnp.tile(model.joint_limits, (1, model.structure.number_of_arms)),
    )


def violations_of(evaluations: Evaluations) -> Violations:
    """Return the largest violation of each measure (B,) [m or rad]."""
    violations: Violations = {}
    for block in CONSTRAINT_BLOCKS:
        values = evaluations[block.name].violation
        violations.update(zip((measure.name for measure in block.measures), values, strict=True))
    return violations


def relative_violation(violations: Mapping[str, Array | float]) -> Float[Array, "*batch"]:
    """Return the largest ratio of a violation to its tolerance; a point is feasible if this is at most 1."""
    ratios = [value / TOLERANCES[name] for name, value in violations.items()]
    # On the host single lanes are judged, where NumPy is a hundred times faster.
    xp: Any = jnp if isinstance(ratios[0], jax.Array) else np
    largest = xp.stack(ratios).max(axis=0)
    return xp.where(xp.isnan(largest), xp.inf, largest)


def flatten(rows: Mapping[str, Array]) -> FlatResiduals:
    """Convert values of rows by block name to three arrays."""
    parts: dict[ConstraintKind, list[Array]] = {kind: [] for kind in ConstraintKind}
    for block in _flat_blocks():
        parts[block.kind].append(rows[block.name].reshape(-1))
    return FlatResiduals(
        rows[COLLISION.name],
        jnp.concatenate(parts[ConstraintKind.EQUALITY]),
        jnp.concatenate(parts[ConstraintKind.INEQUALITY]),
    )


def unflatten(flat: FlatResiduals, horizon: Horizon) -> dict[str, Array]:
    """Convert three arrays to values of rows by block name, the inverse of `flatten`.

    Args:
        flat: A value for every row.
        horizon: Sizes of the NLP.
    """
    rows: dict[str, Array] = {COLLISION.name: flat.collision}
    for kind, values in (
        (ConstraintKind.EQUALITY, flat.equality),
        (ConstraintKind.INEQUALITY, flat.inequality),
    ):
        blocks = [block for block in _flat_blocks() if block.kind is kind]
        rows.update(_cut(values, blocks, horizon))
    return rows


def _flat_blocks() -> list[ConstraintBlock]:
    """Return the blocks whose rows are concatenated to one array for each kind: all but the collisions."""
    return [block for block in CONSTRAINT_BLOCKS if block is not COLLISION]


def _cut(values: Array, blocks: Sequence[ConstraintBlock], horizon: Horizon) -> dict[str, Array]:
    shapes = [block.shape(horizon) for block in blocks]
    ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1]
    pieces = jnp.split(values, ends)
    return {
        block.name: piece.reshape(shape)
        for block, piece, shape in zip(blocks, pieces, shapes, strict=True)
    }


def number_of_flat_rows(horizon: Horizon) -> FlatResiduals:
    """Return the shapes of the three arrays of one NLP."""

    def count(kind: ConstraintKind) -> int:
        return sum(
            math.prod(block.shape(horizon)) for block in _flat_blocks() if block.kind is kind
        )

    return FlatResiduals(
        COLLISION.shape(horizon),
        (count(ConstraintKind.EQUALITY),),
        (count(ConstraintKind.INEQUALITY),),
    )


def row_scales(horizon: Horizon, dtype: jnp.dtype) -> FlatResiduals:
    """Return the penalty of each row relative to the solver's common penalty.

    Args:
        horizon: Sizes of the NLP.
        dtype: Type of the numbers.
    """

    def of_kind(kind: ConstraintKind) -> Array:
        blocks = [block for block in _flat_blocks() if block.kind is kind]
        scales = [
            np.broadcast_to(block.scale(horizon), block.shape(horizon)).reshape(-1)
            for block in blocks
        ]
        return jnp.asarray(np.concatenate(scales), dtype)

    return FlatResiduals(
        jnp.asarray(COLLISION.scale(horizon), dtype),
        of_kind(ConstraintKind.EQUALITY),
        of_kind(ConstraintKind.INEQUALITY),
    )


def gauss_newton_system(
    problem: Problem,
    x: Variables,
    jacobians: Mapping[str, Any],
    multiplier_estimate: Mapping[str, Array],
    active_penalty: Mapping[str, Array],
    gradient_scale: Float[Array, ""] | float = 1.0,
    blocks: Sequence[ConstraintBlock] = CONSTRAINT_BLOCKS,
) -> BorderedSystem:
    """Compute the Gauss-Newton system of the augmented Lagrangian of one NLP.

    Args:
        problem: The NLP, without batch axes.
        x: The point at which the system is computed.
        jacobians: Derivatives of each block's rows, by block name; for the collisions the `NormalEquations` of the
            samples.
        multiplier_estimate: Derivative of the Lagrangian by each row, by block name.
        active_penalty: Penalty of each row where it is active, else 0.
        gradient_scale: Factor of the costs' gradient, whose Hessian stays as it is.
        blocks: The blocks whose rows are part of the system.
    """
    T, D = x.q.shape
    K = len(x.m)
    dtype = x.q.dtype
    parts = empty_parts(T, D, PARAMETERS * K, dtype)
    for block in blocks:
        name = block.name
        parts = block.add_to_system(
            parts,
            problem,
            x,
            jacobians[name],
            multiplier_estimate[name],
            active_penalty[name],
        )
    parts = add_cost(parts, problem, x, jnp.asarray(gradient_scale, dtype))
    return assemble(parts, problem, is_path=T > K)


__all__ = [
    "EQUALITIES",
    "TOLERANCES",
    "Evaluations",
    "FlatResiduals",
    "NormalEquations",
    "Violations",
    "evaluate_constraints",
    "evaluation_input",
    "flatten",
    "gauss_newton_system",
    "horizon_of",
    "number_of_flat_rows",
    "relative_violation",
    "row_scales",
    "unflatten",
    "violations_of",
]
