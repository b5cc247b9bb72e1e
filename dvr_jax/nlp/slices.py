"""Geometry of many slices side by side: distances, their derivatives, and what they add to the normal equations.

A slice knows neither its problem nor its horizon: keyframes and paths of any length are laid out as L slices, and what
is compiled for some numbers of slices serves them all. Derivatives are contact wrenches times twists in closed form
(never those of a whole slice, which cost 35 to 150 times the evaluation), and only of active rows: most of a slice's
hundred and more distances are not in contact. For a row with wrench w between two bodies with twists V1, V2,

    d(distance) = w . (V1 - V2),        V = sum over columns of (twist of the column) d(column).

The columns of a slice are the D joints, then parameter after parameter of every object.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS, Attachment, HandPoses
from dvr_jax.modes.poses import object_poses
from dvr_jax.nlp.collision_distances import Bodies, Contacts, measure_contacts, row_wrenches
from dvr_jax.nlp.collision_rows import arm_row_signs, body_row_signs
from dvr_jax.nlp.compaction import count_active, gather_chunk, number_of_groups, take_slices
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.workcell.kinematics import (
    BasePoses,
    capsule_segments,
    hand_pose,
    joint_screws,
    link_poses,
)
from dvr_jax.workcell.model import WorkcellModel

ACTIVE_ROWS = 4
"""Active rows of a slice that enter its sums together. Of the slices of paths one in seven has an active row, and
hardly any has more than four."""


class Slices(NamedTuple):
    """L slices of problems with N objects and F fixed bodies."""

    q: Float[Array, "joints arms slices"]
    """Angles of joint i of arm a [rad]."""

    finger_opening: Float[Array, "arms slices"]
    """Distance of each finger from its hand's middle plane [m]."""

    bases: BasePoses
    """Poses of the arms' bases."""

    attached: Attachment
    """How each object is attached, batch axes (N, L)."""

    prism: Float[Array, "4 objects slices"]
    """Shapes of the objects."""

    fixed: Bodies
    """Poses and shapes of the fixed bodies."""


class SliceGeometry(NamedTuple):
    """Geometry of L slices with C columns: the joints, then parameter after parameter of every object."""

    distance: Float[Array, "slices rows"]
    """Signed distances [m], rows as in `dvr_jax.nlp.collision_rows`."""

    contacts: Contacts
    """What the wrenches of chosen rows are computed from."""

    columns: Float[Array, "slices 6 columns"]
    """World twist of each joint and, for each mode parameter that an object is attached by, of that object."""

    held: Float[Array, "slices arms objects"]
    """1 where an arm holds an object, else 0."""

    hands: HandPoses
    """Poses of the grippers."""

    screws: Float[Array, "6 joints slices"]
    """The joints' twists once more."""


class NormalEquations(NamedTuple):
    """What the distances of L slices add to the Gauss-Newton matrix and to the gradient."""

    matrix: Float[Array, "slices columns columns"]
    gradient: Float[Array, "slices columns"]


def measure(model: WorkcellModel, slices: Slices) -> SliceGeometry:
    """Distances of all rows, and what their derivatives are made of.

    Args:
        model: Arms of the workcell.
        slices: Configurations of arms and objects.
    """
    L = slices.q.shape[-1]
    links = link_poses(model, slices.bases, slices.q)
    starts, ends = materialize(capsule_segments(model, links, slices.finger_opening))
    hands = HandPoses(*materialize(hand_pose(model, links)))
    screws = materialize(joint_screws(links)).reshape(6, -1, L)

    objects = materialize(object_poses(slices.attached, hands))
    bodies = _all_bodies(slices, objects.rotation, objects.position)
    distance, contacts = measure_contacts(
        model, starts, ends, objects, slices.attached.kind, bodies
    )

    columns = jnp.concatenate([screws, objects.twists.reshape(6, -1, L)], axis=1)
    return SliceGeometry(
        distance=distance.T,
        contacts=contacts,
        columns=columns.transpose(2, 0, 1),
        held=objects.held.astype(slices.q.dtype).transpose(2, 0, 1),
        hands=hands,
        screws=screws,
    )


def _all_bodies(slices: Slices, rotation: Array, position: Array) -> Bodies:
    """Objects and fixed bodies together."""
    fixed = slices.fixed
    if fixed.position.shape[1] == 0:
        return Bodies(rotation, position, slices.prism)
    return Bodies(
        jnp.concatenate([rotation, fixed.rotation], axis=2),
        jnp.concatenate([position, fixed.position], axis=1),
        jnp.concatenate([slices.prism, fixed.prism], axis=1),
    )


def distance_jacobian(
    model: WorkcellModel, geometry: SliceGeometry, rows: Int[Array, "slices chosen"]
) -> Float[Array, "slices columns chosen"]:
    """Derivatives of chosen distances of each slice by the columns of `SliceGeometry`.

    Args:
        model: Arms of the workcell.
        geometry: As of `measure`.
        rows: Rows, other ones in each slice.
    """
    dtype = geometry.distance.dtype
    N = geometry.held.shape[2]
    fixed = geometry.contacts.bodies.position.shape[1] - N
    joints, role = body_row_signs(model.structure, N, fixed)
    arm = jnp.asarray(arm_row_signs(model.structure), dtype)
    of_joints = jnp.concatenate([arm, jnp.asarray(joints, dtype)], axis=1)
    of_objects = jnp.concatenate(
        [jnp.zeros((N, arm.shape[1]), dtype), jnp.asarray(role, dtype)], axis=1
    )

    # A held object moves with its arm: its sign in a row is added to that of the arm's joints.
    wrench = row_wrenches(model, geometry.contacts, N, rows.T).transpose(2, 0, 1)
    own = jnp.take(of_objects, rows, axis=1).transpose(1, 0, 2)
    carried = sum(geometry.held[:, :, n, None] * own[:, None, n] for n in range(N))
    sign = jnp.take(of_joints, rows, axis=1).transpose(1, 0, 2)
    sign = sign + jnp.repeat(carried, model.structure.joints, axis=1)
    sign = jnp.concatenate([sign, *[own] * PARAMETERS], axis=1)

    # A sum of six products fuses, a batched product of matrices does not.
    wrench, sign = materialize((wrench, sign))
    return sign * sum(geometry.columns[:, i, :, None] * wrench[:, i, None] for i in range(6))


class _Sums(NamedTuple):
    """State of the loop over groups of active rows."""

    first: Array
    """Number of the first group of the next pass."""

    total: NormalEquations
    """What the groups visited so far add."""


def reduce_slices(
    model: WorkcellModel,
    geometry: SliceGeometry,
    multiplier_estimate: Float[Array, "slices rows"],
    active_penalty: Float[Array, "slices rows"],
) -> NormalEquations:
    """Add up the active rows of each slice, as constraints g = -distance <= 0.

    Args:
        model: Arms of the workcell.
        geometry: As of `measure`.
        multiplier_estimate: Derivative of the Lagrangian by each row; positive where the row is active.
        active_penalty: Penalty of each row where it is active, else 0.
    """
    L, _, columns = geometry.columns.shape
    active = count_active(materialize((multiplier_estimate > 0).T), ACTIVE_ROWS)
    chunk_size = batch_sizes().active_groups

    def add_chunk(state: _Sums) -> _Sums:
        chunk = gather_chunk(active, state.first, chunk_size)
        rows = chunk.rows.T
        slices = jnp.minimum(chunk.slices, L - 1)
        estimate, penalty = (
            jnp.where(chunk.valid.T, value[slices[:, None], rows], 0)
            for value in (multiplier_estimate, active_penalty)
        )
        J = materialize(distance_jacobian(model, materialize(_take(geometry, slices)), rows))
        weighted, gradient = materialize((J * penalty[:, None], -(J * estimate[:, None]).sum(2)))
        matrix = jnp.einsum("lip,ljp->lij", weighted, J)
        total = NormalEquations(
            jnp.asarray(state.total.matrix).at[slices].add(matrix),
            jnp.asarray(state.total.gradient).at[slices].add(gradient),
        )
        return _Sums(state.first + chunk_size, total)

    def some_left(state: _Sums) -> Array:
        return state.first < number_of_groups(active)

    dtype = multiplier_estimate.dtype
    nothing = NormalEquations(
        jnp.zeros((L, columns, columns), dtype), jnp.zeros((L, columns), dtype)
    )
    return jax.lax.while_loop(
        some_left, add_chunk, _Sums(jnp.zeros((), jnp.float32), nothing)
    ).total


def _take(geometry: SliceGeometry, slices: Array) -> SliceGeometry:
    """What `distance_jacobian` needs of some slices (E,)."""
    # The radii are the same in all slices.
    contacts = geometry.contacts
    segments = contacts.segments
    taken = Contacts(
        segments._replace(
            start=take_slices(segments.start, slices), end=take_slices(segments.end, slices)
        ),
        jax.tree.map(lambda value: take_slices(value, slices), contacts.bodies),
        take_slices(contacts.axis_position, slices),
        take_slices(contacts.wrench, slices),
    )
    return geometry._replace(
        contacts=taken, columns=geometry.columns[slices], held=geometry.held[slices]
    )
