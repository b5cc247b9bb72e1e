"""The inequalities that a path may run into: which they are, and their derivatives by all variables of the NLP.

A path has tens of thousands of inequalities, most of them distances that are far from zero. The quadratic program of an
iteration (`dvr_jax.solver.sequential`) contains only those with the largest values, the *working rows*. Their
derivatives are stored as right-hand sides of the bordered system: one column for each row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import COLLISION, CONSTRAINT_BLOCKS, ConstraintKind, Horizon
from dvr_jax.nlp.evaluation import FlatResiduals, number_of_flat_rows, unflatten
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, distance_jacobian, take_geometry
from dvr_jax.nlp.system import empty_parts
from dvr_jax.workcell.model import WorkcellModel

COLLISIONS_PER_PHASE = 14
"""Number of working rows of a phase that are distances. At an optimum, five to ten of them have a multiplier. With 24
of them, and 20 others, an iteration takes longer, and no more paths reach their KKT residual."""

OTHERS_PER_PHASE = 14
"""Number of working rows of a phase that are other inequalities."""

FARTHEST = -0.1
"""Distances of more than 10 cm are no working rows [m]; a step can hardly make them touch."""

NEAREST = 0.05
"""Scores above this are not told apart [m]; all of them belong to the largest ones."""

BISECTIONS = 12
"""Number of bisections of the range of the scores, which leave less than 0.1 mm of it."""

GROUP = 16
"""The pairs of bodies of a sample are searched in groups of this many."""

INEQUALITY_BLOCKS = [
    block for block in CONSTRAINT_BLOCKS if block.kind is ConstraintKind.INEQUALITY
]
"""The constraint blocks whose rows are inequalities."""


class RowIndex(NamedTuple):
    """Which inequalities are working rows."""

    collision: Int[Array, "*batch distances"]
    """Indices of distances: the sample times P plus the pair of bodies. Places without a row have the next index."""

    other: Int[Array, "*batch others"]
    """Indices among all other inequalities (`FlatResiduals.inequality`)."""


class RowCounts(NamedTuple):
    """Number of working rows of each kind."""

    collision: int
    other: int


class RowDerivatives(NamedTuple):
    """Derivatives of R working rows, the distances first."""

    by_joints: Float[Array, "*batch slices joints rows"]
    by_parameters: Float[Array, "*batch parameters rows"]


def working_rows_of(horizon: Horizon) -> RowCounts:
    """Return the numbers of working rows of an NLP."""
    shapes = number_of_flat_rows(horizon)
    return RowCounts(
        min(COLLISIONS_PER_PHASE * horizon.phases, math.prod(shapes.collision)),
        min(OTHERS_PER_PHASE * horizon.phases, math.prod(shapes.inequality)),
    )


def choose_rows(scores: FlatResiduals, horizon: Horizon) -> RowIndex:
    """Return the inequalities of one NLP with the largest scores.

    Args:
        scores: A number for every row; those of the equalities are not used.
        horizon: Sizes of the NLP.
    """
    number = working_rows_of(horizon)
    others = jax.lax.top_k(scores.inequality, number.other)[1].astype(jnp.int32)
    return RowIndex(_largest_distances(scores.collision, number.collision), others)


def _largest_distances(
    scores: Float[Array, "samples pairs"], number: int
) -> Int[Array, " distances"]:
    """Return the indices of the largest scores; the index after the last row where fewer exceed `FARTHEST`.

    Sorting tens of thousands of numbers takes ten times as long as all the rest of an iteration. Bisection finds a
    threshold that nearly as many scores as wanted exceed, and these are then gathered.
    """

    def halve(_: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bounds
        middle = 0.5 * (low + high)
        # Sums of float32 along the first axis are the quickest way to count.
        is_low = jnp.sum((scores > middle).astype(jnp.float32), axis=0).sum() > number
        return jnp.where(is_low, middle, low), jnp.where(is_low, high, middle)

    bounds = (jnp.asarray(FARTHEST, scores.dtype), jnp.asarray(NEAREST, scores.dtype))
    _, threshold = jax.lax.fori_loop(0, BISECTIONS, halve, bounds)
    return _true_entries(materialize(scores > threshold), number)


def _true_entries(mask: Bool[Array, "samples pairs"], number: int) -> Int[Array, " entries"]:
    """Return the indices of the entries that are true, at most `number`; the index after the last entry thereafter.

    The entry with the number i lies in the first sample up to which there are more than i true entries. Within the
    sample, its group is found in the same way, and then its place in the group.

    Args:
        mask: The entries.
        number: How many indices are returned.
    """
    samples, pairs = mask.shape
    groups = -(-pairs // GROUP)
    counted = mask.astype(jnp.float32)
    group_of_pair = np.arange(pairs)[:, None] // GROUP
    in_groups = materialize(counted @ np.asarray(group_of_pair == np.arange(groups), np.float32))
    in_samples = materialize(in_groups.sum(1))

    # Each level passes on how many true entries of the chosen part come before the wanted one.
    wanted = jnp.arange(number, dtype=jnp.float32)
    sample, rest = _place(jnp.broadcast_to(in_samples, (number, samples)), wanted)
    chosen = jnp.minimum(sample, samples - 1)
    group, rest = _place(in_groups[chosen], rest)
    first = group * GROUP
    pair = first[:, None] + jnp.arange(GROUP)
    entries = jnp.asarray(counted).at[chosen[:, None], pair].get(mode="fill", fill_value=0)
    place, _ = _place(entries, rest)

    index = sample * pairs + first + place
    return jnp.where(wanted < in_samples.sum(), index, mask.size).astype(jnp.int32)


def _place(
    counts: Float[Array, "wanted parts"], number: Float[Array, " wanted"]
) -> tuple[Int[Array, " wanted"], Float[Array, " wanted"]]:
    """Return the first part up to which there are more than a number of entries, and the number less those before it.

    Args:
        counts: Number of entries in each part.
        number: Number of entries that come before the wanted one.
    """
    parts = counts.shape[1]
    sums = counts @ np.triu(np.ones((parts, parts), np.float32))
    is_before = sums <= number[:, None]
    before = jnp.sum(jnp.where(is_before, counts, 0), axis=1)
    return jnp.sum(is_before, axis=1), number - before


def take_rows(rows: FlatResiduals, index: RowIndex) -> Float[Array, " rows"]:
    """Return the values of the working rows of one NLP; `FARTHEST` for places without a row.

    Args:
        rows: Values of all rows.
        index: The working rows.
    """
    flat = jnp.asarray(rows.collision).reshape(-1)
    distances = flat.at[index.collision].get(mode="fill", fill_value=FARTHEST)
    return jnp.concatenate([distances, rows.inequality[index.other]])


def take_multipliers(multipliers: FlatResiduals, index: RowIndex) -> Float[Array, " rows"]:
    """Return the multipliers of the working rows of one NLP; 0 for places without a row.

    Args:
        multipliers: Multipliers of all rows.
        index: The working rows.
    """
    return jnp.maximum(take_rows(multipliers, index), 0)


def put_rows(values: Float[Array, " rows"], index: RowIndex, into: FlatResiduals) -> FlatResiduals:
    """Return all rows of one NLP with new values of the working rows, the inverse of `take_rows`.

    Args:
        values: New values of the working rows.
        index: The working rows.
        into: Values of all rows.
    """
    split = len(index.collision)
    flat = (
        jnp.asarray(into.collision).reshape(-1).at[index.collision].set(values[:split], mode="drop")
    )
    return into._replace(
        collision=flat.reshape(into.collision.shape),
        inequality=jnp.asarray(into.inequality).at[index.other].set(values[split:]),
    )


def row_derivatives(
    model: WorkcellModel,
    problems: Problem,
    x: Variables,
    horizon: Horizon,
    chunks: Sequence[SliceGeometry],
    jacobians: dict[str, object],
    index: RowIndex,
) -> RowDerivatives:
    """Compute the derivatives of the working rows of a batch of B problems.

    Args:
        model: Arms of the workcell.
        problems: The problems.
        x: The points.
        horizon: Sizes of the NLPs.
        chunks: Geometry of the slices of all points, in chunks of one size.
        jacobians: Derivatives of each block's rows, by block name.
        index: The working rows of each problem.
    """
    by_columns = materialize(_by_columns(model, horizon, chunks, index.collision))
    collisions = jax.vmap(_collision_derivatives, in_axes=(0, 0, 0, None))(
        problems, index.collision, by_columns, horizon
    )

    def others_of(
        problem: Problem, x: Variables, jacobians: dict[str, object], rows: Array
    ) -> RowDerivatives:
        return _other_derivatives(problem, x, horizon, jacobians, rows)

    others = jax.vmap(others_of)(problems, x, jacobians, index.other)
    joined = jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=-1), collisions, others)

    # Pinned parameters do not move.
    free = jnp.asarray(problems.parameter_upper > problems.parameter_lower, x.q.dtype)
    free = free.reshape(len(free), -1, 1)
    return RowDerivatives(joined.by_joints, joined.by_parameters * free)


def samples_of_rows(
    index: Int[Array, "batch distances"], horizon: Horizon
) -> Int[Array, "batch distances"]:
    """Return the sample of each row among the samples of all problems; places without a row have a wrong one.

    Args:
        index: Indices of the distances of each problem.
        horizon: Sizes of the NLPs.
    """
    samples = horizon.slices * horizon.samples
    return index // horizon.collision_rows + samples * jnp.arange(len(index))[:, None]


def _by_columns(
    model: WorkcellModel, horizon: Horizon, chunks: Sequence[SliceGeometry], index: Array
) -> Float[Array, "batch distances columns"]:
    """Return the derivatives of the rows -distance by the columns of their slices (`dvr_jax.nlp.slices`)."""
    B, number = index.shape
    samples = horizon.slices * horizon.samples
    slices = samples_of_rows(index, horizon).reshape(-1)
    rows = (index % horizon.collision_rows).reshape(-1, 1)
    is_row = index.reshape(-1) < samples * horizon.collision_rows

    # A chunk contributes the rows of its own slices.
    size = chunks[0].distance.shape[0]
    total = jnp.zeros(())
    for position, chunk in enumerate(chunks):
        local = slices - position * size
        is_own = (local >= 0) & (local < size) & is_row
        taken = materialize(take_geometry(chunk, jnp.clip(local, 0, size - 1)))
        found = distance_jacobian(model, taken, rows)[..., 0]
        total = total - jnp.where(is_own[:, None], found, 0)
    return total.reshape(B, number, -1)


def _collision_derivatives(
    problem: Problem, index: Array, by_columns: Array, horizon: Horizon
) -> RowDerivatives:
    """Map the derivatives of one problem's distances to joint angles of the slices and parameters of the actions."""
    T = horizon.slices
    D = horizon.joints
    K = horizon.phases
    N = problem.prism.shape[0]
    dtype = by_columns.dtype
    sample = jnp.minimum(index // horizon.collision_rows, T * horizon.samples - 1)
    t = sample // horizon.samples

    # A sample at the fraction s of the interval before slice t moves with q_t and q_{t-1}, weighted by s and 1 - s.
    s = jnp.asarray(problem.sample_fraction).reshape(-1)[sample]
    slices = jnp.arange(T)[:, None]
    weight = (slices == t) * s + (slices == t - 1) * (1 - s)
    by_joints = weight[:, None] * by_columns[:, :D].T

    # Each object's parameter columns belong to the action that it is attached by in this phase.
    action = jnp.asarray(problem.mode_action)[:-1][t // horizon.steps]
    belongs = jnp.asarray(action[:, None] == jnp.arange(K)[:, None], dtype)
    of_objects = by_columns[:, D:].reshape(-1, PARAMETERS, N)
    by_parameters = jnp.einsum("rcn,rkn->kcr", of_objects, belongs)
    return RowDerivatives(by_joints, by_parameters.reshape(K * PARAMETERS, -1))


def _other_derivatives(
    problem: Problem, x: Variables, horizon: Horizon, jacobians: dict[str, object], rows: Array
) -> RowDerivatives:
    """Return the derivatives of inequalities other than distances.

    A block adds ``J^T e`` to the gradient of a system. With a unit vector e this is the derivative of one row.
    """
    shapes = number_of_flat_rows(horizon)
    blocks = [block for block in INEQUALITY_BLOCKS if block is not COLLISION]

    def derivative(row: Array) -> tuple[Array, Array]:
        unit = jnp.asarray(jnp.arange(shapes.inequality[0]) == row, x.q.dtype)
        units = unflatten(FlatResiduals(jnp.zeros(()), jnp.zeros(shapes.equality), unit), horizon)
        parts = empty_parts(horizon.slices, horizon.joints, PARAMETERS * horizon.phases, x.q.dtype)
        for block in blocks:
            estimate = units[block.name]
            parts = block.add_to_system(
                parts, problem, x, jacobians[block.name], estimate, jnp.zeros_like(estimate)
            )
        return parts.gradient_q, parts.gradient_m

    by_joints, by_parameters = jax.vmap(derivative, out_axes=-1)(rows)
    return RowDerivatives(by_joints, by_parameters)
