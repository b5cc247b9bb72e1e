"""Geometry of a batch of slices: signed distances, their derivatives, and what they add to the normal equations.

A slice is one configuration of all arms and objects. Here every sample between two slices of a path also counts as a
slice. The configurations of keyframes and paths of any length are concatenated to L slices, independent of the problems
that they belong to, so that a program that is compiled for a number of slices serves all problems.

Derivatives are products of contact wrenches (`dvr_jax.geometry.wrenches`) and twists, in closed form. They are computed
for active rows only, because most of the more than one hundred distances of a slice are far from contact. Automatic
differentiation of a whole slice costs 35 to 150 times as much as its evaluation. For a row with the wrench w between
two bodies with the twists V1 and V2,

    d(distance) = w . (V1 - V2),        V = sum over columns of (twist of the column) d(column).

The *columns* of a slice are the variables that move its bodies: the D joint angles, then the first mode parameter of
each of the N objects, then the second one of each object, and so on: C = D + 4 N columns.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize, rotation_about_z
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
"""Number of active rows of a slice that are processed as one group. One in seven slices of paths has an active row, and
hardly any slice has more than four."""


class Slices(NamedTuple):
    """Configurations of L slices of problems with N objects and F fixed bodies."""

    q: Float[Array, "joints arms slices"]
    """Angles of joint i of arm a [rad]."""

    finger_opening: Float[Array, "arms slices"]
    """Distance of each finger from its hand's middle plane [m]."""

    base_poses: Float[Array, "4 3 arms slices"]
    """Poses of the arms' bases: the three axes of each, then its origin [m]. Each array that a program takes or returns
    costs some microseconds, so that both are in one."""

    attached: Attachment
    """How each object is attached, with the batch axes (N, L)."""

    prism: Float[Array, "4 bodies slices"]
    """Shapes of the objects, then of the fixed bodies, as prisms (hx, hy, hz, r) [m]."""

    clearance: Float[Array, "body_rows slices"]
    """Distances that hands, objects and fixed bodies keep (`dvr_jax.nlp.body_clearances`) [m]."""

    fixed_pose: Float[Array, "4 fixed slices"]
    """Poses of the fixed bodies: x, y, z of the center [m] and yaw [rad]."""


class SliceGeometry(NamedTuple):
    """Distances of L slices, and what their derivatives by the C columns (see the module) are computed from."""

    distance: Float[Array, "slices rows"]
    """Signed distances less the clearances [m], rows as in `dvr_jax.nlp.collision_rows`."""

    contacts: Contacts
    """Contact geometry from which the wrenches of chosen rows are computed."""

    columns: Float[Array, "slices 6 columns"]
    """World twist of each column: of a joint at unit velocity, or of an object at unit rate of one mode parameter."""

    held: Float[Array, "slices arms objects"]
    """1 where an arm holds an object, else 0."""

    hands: HandPoses
    """Poses of the grippers."""

    screws: Float[Array, "6 joints slices"]
    """World twists of the joints, the first D columns once more in the layout that constraint blocks use."""


class NormalEquations(NamedTuple):
    """What the distances of L slices add to the Gauss-Newton matrix and to the gradient, slice by slice."""

    matrix: Float[Array, "slices columns columns"]
    """``J^T diag(a) J`` of each slice, with the active penalties a and the derivatives J of the rows -distance."""

    gradient: Float[Array, "slices columns"]
    """``J^T e`` of each slice, with the multiplier estimates e."""


def measure(model: WorkcellModel, slices: Slices) -> SliceGeometry:
    """Compute the distances of all rows, and what their derivatives are computed from.

    Args:
        model: Arms of the workcell.
        slices: Configurations of arms and objects.
    """
    L = slices.q.shape[-1]
    # Arms: link poses, the capsules that enclose the links, gripper poses, and the twists of the joints.
    bases = BasePoses(slices.base_poses[:3], slices.base_poses[3])
    links = link_poses(model, bases, slices.q)
    starts, ends = materialize(capsule_segments(model, links, slices.finger_opening))
    hands = HandPoses(*materialize(hand_pose(model, links)))
    screws = materialize(joint_screws(links)).reshape(6, -1, L)

    # Objects move with the gripper that holds them; then the distances of all pairs of bodies.
    objects = materialize(object_poses(slices.attached, hands))
    bodies = _all_bodies(slices, objects.rotation, objects.position)
    distance, contacts = measure_contacts(
        model, starts, ends, objects, slices.attached.kind, bodies, slices.clearance
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
    """Concatenate objects and fixed bodies, the objects first."""
    pose = slices.fixed_pose
    if pose.shape[1] == 0:
        return Bodies(rotation, position, slices.prism)

    fixed_rotation = rotation_about_z(*materialize((jnp.cos(pose[3]), jnp.sin(pose[3]))))
    return Bodies(
        jnp.concatenate([rotation, fixed_rotation], axis=2),
        jnp.concatenate([position, pose[:3]], axis=1),
        slices.prism,
    )


def distance_jacobian(
    model: WorkcellModel, geometry: SliceGeometry, rows: Int[Array, "slices chosen"]
) -> Float[Array, "slices columns chosen"]:
    """Compute the derivatives of chosen distances of each slice by the columns of `SliceGeometry`.

    Each derivative is ``sign * (twist of the column) . (wrench of the row)``. The sign is 1 if the column moves the
    first body of the row, -1 if it moves the second one, and 0 if it moves none or both.

    Args:
        model: Arms of the workcell.
        geometry: Geometry of the slices, as returned by `measure`.
        rows: Indices of the chosen rows, which may differ from slice to slice.
    """
    N = geometry.held.shape[2]
    wrench = row_wrenches(model, geometry.contacts, N, rows.T).transpose(2, 0, 1)

    # XLA fuses a sum of six products into one kernel, but not a batched product of matrices.
    wrench, sign = materialize((wrench, row_signs(model, geometry, rows)))
    return sign * sum(geometry.columns[:, i, :, None] * wrench[:, i, None] for i in range(6))


def row_signs(
    model: WorkcellModel, geometry: SliceGeometry, rows: Int[Array, "slices chosen"]
) -> Float[Array, "slices columns chosen"]:
    """Return 1 where a column moves the first body of a row, -1 where it moves the second one, else 0.

    Args:
        model: Arms of the workcell.
        geometry: Geometry of the slices.
        rows: Indices of the chosen rows.
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

    # A held object moves with its arm, so its sign in a row is added to the sign of the arm's joints.
    own = jnp.take(of_objects, rows, axis=1).transpose(1, 0, 2)
    carried = sum(geometry.held[:, :, n, None] * own[:, None, n] for n in range(N))
    sign = jnp.take(of_joints, rows, axis=1).transpose(1, 0, 2)
    sign = sign + jnp.repeat(carried, model.structure.joints, axis=1)
    return jnp.concatenate([sign, *[own] * PARAMETERS], axis=1)


class _Sums(NamedTuple):
    """State of the loop of `reduce_slices` over groups of active rows."""

    first: Array
    """Number of the first group of the next pass, a float32."""

    total: NormalEquations
    """Sum over the groups processed so far."""


def reduce_slices(
    model: WorkcellModel,
    geometry: SliceGeometry,
    multiplier_estimate: Float[Array, "slices rows"],
    active_penalty: Float[Array, "slices rows"],
) -> NormalEquations:
    """Sum the contributions of the active rows of each slice, as constraints g = -distance <= 0.

    The active rows of all slices are divided into groups of up to `ACTIVE_ROWS` rows of one slice
    (`dvr_jax.nlp.compaction`). Each pass of a loop processes a fixed number of groups.

    Args:
        model: Arms of the workcell.
        geometry: Geometry of the slices, as returned by `measure`.
        multiplier_estimate: Derivative of the augmented Lagrangian by each row; positive where the row is active.
        active_penalty: Penalty of each row where it is active, else 0.
    """
    L, _, columns = geometry.columns.shape
    active = count_active(materialize((multiplier_estimate > 0).T), ACTIVE_ROWS)
    chunk_size = batch_sizes().active_groups

    def add_chunk(state: _Sums) -> _Sums:
        """Process the next groups; entries of a group that hold no row get the weight 0."""
        chunk = gather_chunk(active, state.first, chunk_size)
        rows = chunk.rows.T
        slices = jnp.minimum(chunk.slices, L - 1)
        estimate, penalty = (
            jnp.where(chunk.valid.T, value[slices[:, None], rows], 0)
            for value in (multiplier_estimate, active_penalty)
        )
        J = materialize(
            distance_jacobian(model, materialize(take_geometry(geometry, slices)), rows)
        )
        weighted, gradient = materialize((J * penalty[:, None], -(J * estimate[:, None]).sum(2)))
        matrix = jnp.einsum("lip,ljp->lij", weighted, J)
        total = NormalEquations(
            jnp.asarray(state.total.matrix).at[slices].add(matrix),
            jnp.asarray(state.total.gradient).at[slices].add(gradient),
        )
        return _Sums(state.first + chunk_size, total)

    def some_left(state: _Sums) -> Array:
        """Return whether there are groups left."""
        return state.first < number_of_groups(active)

    dtype = multiplier_estimate.dtype
    nothing = NormalEquations(
        jnp.zeros((L, columns, columns), dtype), jnp.zeros((L, columns), dtype)
    )
    return jax.lax.while_loop(
        some_left, add_chunk, _Sums(jnp.zeros((), jnp.float32), nothing)
    ).total


def take_geometry(geometry: SliceGeometry, slices: Int[Array, " chosen"]) -> SliceGeometry:
    """Return the part of the geometry that `distance_jacobian` needs, for chosen slices.

    Args:
        geometry: Geometry of all slices.
        slices: Indices of the chosen ones.
    """
    # The radii of the capsules are the same in all slices and are kept as they are.
    contacts = geometry.contacts
    segments = contacts.segments
    taken = Contacts(
        segments._replace(
            start=take_slices(segments.start, slices), end=take_slices(segments.end, slices)
        ),
        jax.tree.map(lambda value: take_slices(value, slices), contacts.bodies),
        take_slices(contacts.axis_position, slices),
        take_slices(contacts.wrench, slices),
        take_slices(contacts.height, slices),
    )
    return geometry._replace(
        contacts=taken, columns=geometry.columns[slices], held=geometry.held[slices]
    )
