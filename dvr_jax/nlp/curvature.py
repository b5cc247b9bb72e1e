r"""Second derivatives of the constraints, weighted with their multipliers: the curvature of the Lagrangian.

With the multipliers mu of the equalities and lambda of the inequalities, it is the matrix

    C = sum over equalities mu_i d^2 h_i  +  sum over working rows lambda_i d^2 g_i.

The parts are known in closed form (`dvr_jax.geometry.chain_curvature`): those of mode switches and straight motions, in
their constraint blocks, and those of distances, here. A distance between a capsule and the face of a body has the
normal of that face. Then the second derivatives are those of the capsule's point in the body's frame, in which the
chain consists of the variables that move the body, in reverse order, and those that move the capsule. For other
distances the normal is kept fixed in the world. How nearest points and normals move otherwise is left out: at rounded
corners it makes distances more convex, by up to 1/distance, but only as long as a step is shorter than the distance.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.chain_curvature import pair_products
from dvr_jax.geometry.vectors import cross, materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.modes.poses import chain_depth
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, EvaluationInput, Horizon
from dvr_jax.nlp.collision_distances import row_contacts
from dvr_jax.nlp.evaluation import FlatResiduals, unflatten
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, row_signs, take_geometry
from dvr_jax.nlp.system import BorderedSystem, Curvature
from dvr_jax.nlp.working_rows import RowIndex, samples_of_rows, take_multipliers
from dvr_jax.workcell.model import WorkcellModel

CURVED_PER_PHASE = 5
"""Number of distances of a phase whose curvature is computed: those with the largest multipliers. Optimal paths have
fewer distances with a multiplier than this, on average over the phases."""


def constraint_curvature(
    model: WorkcellModel,
    given: EvaluationInput,
    horizon: Horizon,
    chunks: Sequence[SliceGeometry],
    multipliers: FlatResiduals,
    index: RowIndex,
) -> Curvature:
    """Compute the curvature of a batch of B problems.

    Args:
        model: Arms of the workcell.
        given: The problems, their points, and the geometry there.
        horizon: Sizes of the NLPs.
        chunks: Geometry of the slices of all points, in chunks of one size.
        multipliers: Multipliers of all rows; those of distances that are no working rows are not used.
        index: The working rows of each problem.
    """
    # A distance without a multiplier has no curvature, so only a part of the working rows is looked at.
    of_distances = jax.vmap(take_multipliers)(multipliers, index)[:, : index.collision.shape[1]]
    number = min(CURVED_PER_PHASE * horizon.phases, of_distances.shape[1])
    of_distances, places = jax.lax.top_k(of_distances, number)
    index = index._replace(collision=jnp.take_along_axis(index.collision, places, axis=1))
    by_columns = materialize(_distance_curvature(model, horizon, chunks, index, of_distances))
    parts = [
        jax.vmap(_to_variables, in_axes=(0, 0, 0, None))(given.problems, index, by_columns, horizon)
    ]
    by_block = jax.vmap(unflatten, in_axes=(0, None))(multipliers, horizon)
    parts += [
        block.curvature(given, by_block[block.name])
        for block in CONSTRAINT_BLOCKS
        if block.curvature is not None
    ]
    total = jax.tree.map(lambda *values: sum(values), *parts)

    # Pinned parameters do not move, and the slice before the first one is the home posture.
    problems = given.problems
    free = jnp.asarray(problems.parameter_upper > problems.parameter_lower, given.x.q.dtype)
    free = free.reshape(len(free), 1, -1)
    return Curvature(
        diagonal=total.diagonal,
        coupling=total.coupling.at[:, 0].set(0),
        border=total.border * free[:, None],
        corner=total.corner * free * free.swapaxes(1, 2),
    )


def _distance_curvature(
    model: WorkcellModel,
    horizon: Horizon,
    chunks: Sequence[SliceGeometry],
    index: RowIndex,
    multipliers: Float[Array, "batch distances"],
) -> Float[Array, "batch distances columns columns"]:
    """Return the second derivatives of the rows -distance by the columns of their slices, times their multipliers."""
    B, number = index.collision.shape
    rows = (index.collision % horizon.collision_rows).reshape(-1, 1)
    slices = samples_of_rows(index.collision, horizon).reshape(-1)
    weights = multipliers.reshape(-1)

    # A chunk contributes the rows of its own slices.
    size = chunks[0].distance.shape[0]
    total = jnp.zeros(())
    for position, chunk in enumerate(chunks):
        local = slices - position * size
        is_own = (local >= 0) & (local < size)
        taken = materialize(take_geometry(chunk, jnp.clip(local, 0, size - 1)))
        total = total - jnp.where(is_own, weights, 0) * _row_curvature(model, taken, rows)
    return jnp.moveaxis(total, -1, 0).reshape(B, number, *total.shape[:2])


def _row_curvature(
    model: WorkcellModel, geometry: SliceGeometry, rows: Array
) -> Float[Array, "columns columns rows"]:
    """Return the second derivatives of one distance of each slice by the columns of the slice."""
    N = geometry.held.shape[2]
    D = model.structure.number_of_joints
    contacts = row_contacts(model, geometry.contacts, N, rows.T)
    normal, first, second, is_on_body = materialize(
        (
            contacts.wrench[3:, 0],
            contacts.first_point[:, 0],
            contacts.second_point[:, 0],
            contacts.is_on_body[0],
        )
    )
    sign = row_signs(model, geometry, rows)[..., 0].T

    # The columns are the joints, then the first parameter of each object, the second one of each, and so on.
    depth = chain_depth(D, geometry.held.any(1).T)
    of_joints = depth[:D, 0] if N else jnp.zeros((D, len(rows)))
    depth = jnp.concatenate([of_joints, depth[D:].reshape(PARAMETERS * N, -1)])

    # In the frame of the second body, its own variables come before, in reverse order.
    columns = geometry.columns.transpose(1, 2, 0)
    is_second = sign < 0
    depth = jnp.where(is_second & is_on_body, -1 - depth, depth)
    is_before = depth[:, None] <= depth[None]
    points = jnp.where(is_second, second[:, None], first[:, None])
    points = jnp.where(is_on_body, first[:, None], points)

    turn = columns[:3] * sign
    velocity = (columns[3:] + cross(columns[:3], points)) * sign
    in_order = materialize(pair_products(cross(normal[:, None], turn), velocity))
    found = jnp.where(is_before, in_order, in_order.swapaxes(0, 1))

    # With a fixed normal, no variable of the one body changes how the other one moves.
    is_same = is_second[:, None] == is_second[None]
    with_fixed_normal = jnp.where(is_same, jnp.where(is_second[:, None], -found, found), 0)
    return jnp.where(is_on_body, found, with_fixed_normal)


def _to_variables(
    problem: Problem, index: RowIndex, by_columns: Array, horizon: Horizon
) -> Curvature:
    """Map second derivatives by the columns of slices to the joint angles and mode parameters of one problem."""
    T = horizon.slices
    D = horizon.joints
    K = horizon.phases
    N = problem.prism.shape[0]
    M = PARAMETERS * K
    dtype = by_columns.dtype
    last = T * horizon.samples - 1
    sample = jnp.minimum(index.collision // horizon.collision_rows, last)
    t = sample // horizon.samples
    before = jnp.maximum(t - 1, 0)
    s = jnp.asarray(problem.sample_fraction).reshape(-1)[sample][:, None, None]
    rest = jnp.where(t[:, None, None] > 0, 1 - s, 0)

    # Each object's parameter columns belong to the action that it is attached by in this phase.
    action = jnp.asarray(problem.mode_action)[:-1][t // horizon.steps]
    belongs = jnp.asarray(action[..., None] == jnp.arange(K), dtype)
    of_joints = by_columns[:, :D, :D]
    of_both = by_columns[:, :D, D:].reshape(-1, D, PARAMETERS, N)
    of_both = jnp.einsum("rdcn,rnk->rdkc", of_both, belongs).reshape(-1, D, M)
    of_objects = by_columns[:, D:, D:].reshape(-1, PARAMETERS, N, PARAMETERS, N)
    corner = jnp.einsum("rcneo,rnk,rol->kcle", of_objects, belongs, belongs)

    blocks = jnp.zeros((T, D, D), dtype)
    border = jnp.zeros((T, D, M), dtype)
    return Curvature(
        diagonal=blocks.at[t].add(s * s * of_joints).at[before].add(rest * rest * of_joints),
        coupling=blocks.at[t].add(s * rest * of_joints),
        border=border.at[t].add(s * of_both).at[before].add(rest * of_both),
        corner=corner.reshape(M, M),
    )


def add_curvature(
    system: BorderedSystem, curvature: Curvature, factor: Float[Array, ""] | float
) -> BorderedSystem:
    """Return a system with a multiple of the curvature in its matrix.

    Args:
        system: The system of one path NLP.
        curvature: The curvature.
        factor: Its factor.
    """
    assert system.coupling is not None
    return system._replace(
        diagonal=system.diagonal + factor * curvature.diagonal,
        coupling=system.coupling + factor * curvature.coupling,
        border=system.border + factor * curvature.border,
        corner=system.corner + factor * curvature.corner,
    )


def times_curvature(curvature: Curvature, step: Variables) -> Variables:
    """Return the product of the curvature of one NLP and a step.

    Args:
        curvature: The curvature.
        step: The step.
    """
    dm = step.m.reshape(-1)
    coupling = curvature.coupling[1:]
    q = jnp.einsum("tij,tj->ti", curvature.diagonal, step.q) + curvature.border @ dm
    q = q.at[1:].add(jnp.einsum("tij,tj->ti", coupling, step.q[:-1]))
    q = q.at[:-1].add(jnp.einsum("tij,ti->tj", coupling, step.q[1:]))
    m = jnp.einsum("tim,ti->m", curvature.border, step.q) + curvature.corner @ dm
    return Variables(q, m.reshape(step.m.shape))
