"""Geometry of many slices side by side: distances, their derivatives, and what they add to the Gauss-Newton matrix.

A slice knows neither its problem nor its horizon: keyframes and paths of any length are laid out as L slices, and what
is compiled for some numbers of slices serves them all. Derivatives are contact wrenches times twists in closed form,
never those of a whole slice (which cost 35 to 150 times the evaluation), and only of the rows that push: most of a
slice's hundred and more distances are not in contact."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.distances import Prism
from dvr_jax.geometry.vectors import Rotation, Vector, materialize
from dvr_jax.modes.poses import Attachment, object_poses
from dvr_jax.nlp.collision_distances import Contacts, measure_contacts, row_wrenches
from dvr_jax.nlp.collision_rows import arm_signs, object_signs
from dvr_jax.nlp.compaction import mark, number_of_parts, take_slices, visit
from dvr_jax.nlp.problem import PARAMETERS
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.workcell.constants import NUMBER_OF_JOINTS
from dvr_jax.workcell.kinematics import capsule_segments, hand_pose, joint_screws, link_poses

PUSHING_ROWS = 4
"""ConstraintValues of a slice that enter its sums together. Of the slices of paths one in seven has a row that pushes, and hardly
any has more than four."""


class Slices(NamedTuple):
    """L slices of problems with N objects."""

    q: Array
    """(7, 2, L) angles of joint i of arm a [rad]."""
    opening: Array
    """(2, L) distance of each finger from its hand's middle plane [m]."""
    attached: Attachment
    """How each object is attached, (N, L)."""
    half: Prism
    """(4, N, L) shapes."""


class SliceGeometry(NamedTuple):
    """Geometry of L slices; C = 14 + 4 N columns: the joints, then parameter after parameter of every object."""

    distance: Array
    """(L, P) signed distances [m], rows as in `dvr_jax.nlp.collision_rows`."""
    contacts: Contacts
    """What the wrenches of chosen rows come of."""
    columns: Array
    """(L, 6, C) twist of each joint and, for each mode parameter that an object is attached by, of that object."""
    held: Array
    """(L, 2, N) 1 where an arm holds an object, else 0."""
    hand_R: Rotation
    """(3, 3, 2, L)."""
    hand_p: Vector
    """(3, 2, L)."""
    screws: Array
    """(6, 14, L) the joints' twists once more."""


class NormalEquations(NamedTuple):
    """What the distances of L slices add to gradient and Gauss-Newton matrix."""

    matrix: Array
    """(L, C, C)."""
    gradient: Array
    """(L, C)."""


def measure(slices: Slices) -> SliceGeometry:
    """Distances of all rows, and what their derivatives are made of."""
    L = slices.q.shape[-1]
    rotations, positions = link_poses(slices.q)
    a, b = materialize(capsule_segments(rotations, positions, slices.opening))
    hand_R, hand_p = materialize(hand_pose(rotations, positions))
    screws = materialize(joint_screws(rotations, positions)).reshape(6, -1, L)
    objects = materialize(object_poses(slices.attached, hand_R, hand_p))
    distance, contacts = measure_contacts(a, b, objects, slices.half, slices.attached.kind)
    columns = jnp.concatenate([screws, objects.twists.reshape(6, -1, L)], axis=1)
    return SliceGeometry(
        distance=distance.T,
        contacts=contacts,
        columns=columns.transpose(2, 0, 1),
        held=objects.held.astype(slices.q.dtype).transpose(2, 0, 1),
        hand_R=hand_R,
        hand_p=hand_p,
        screws=screws,
    )


def distance_jacobian(measured: SliceGeometry, rows: Array) -> Array:
    """Derivatives (L, C, k) of the distances ``rows`` (L, k) with respect to the columns of `SliceGeometry`."""
    dtype, N = measured.distance.dtype, measured.held.shape[2]
    joints, role = object_signs(N)
    arm = jnp.asarray(arm_signs(), dtype)
    of_joints = jnp.concatenate([arm, jnp.asarray(joints, dtype)], axis=1)
    of_objects = jnp.concatenate([jnp.zeros((N, arm.shape[1]), dtype), jnp.asarray(role, dtype)], axis=1)
    wrench = row_wrenches(measured.contacts, rows.T).transpose(2, 0, 1)
    # A held object moves with its arm: its sign in a row is added to that of the arm's joints.
    own = jnp.take(of_objects, rows, axis=1).transpose(1, 0, 2)
    carried = sum(measured.held[:, :, n, None] * own[:, None, n] for n in range(N))
    sign = jnp.take(of_joints, rows, axis=1).transpose(1, 0, 2) + jnp.repeat(carried, NUMBER_OF_JOINTS, axis=1)
    sign = jnp.concatenate([sign, *[own] * PARAMETERS], axis=1)
    wrench, sign = materialize((wrench, sign))
    # A sum of six products fuses, a batched product of matrices does not.
    return sign * sum(measured.columns[:, i, :, None] * wrench[:, i, None] for i in range(6))


def reduce_slices(measured: SliceGeometry, force: Array, curvature: Array) -> NormalEquations:
    """Add up forces and curvatures (L, P) of the distances (as constraints g = -distance <= 0): those of the rows that
    push, part after part (`dvr_jax.nlp.compaction`)."""
    L, _, C = measured.columns.shape
    marked, together = mark(materialize((force > 0).T), PUSHING_ROWS), batch_sizes().pushing_parts

    def add_parts(state: tuple[Array, NormalEquations]) -> tuple[Array, NormalEquations]:
        first, total = state
        chosen = visit(marked, first, together)
        rows, slices = chosen.rows.T, jnp.minimum(chosen.slices, L - 1)
        f, c = (jnp.where(chosen.there.T, value[slices[:, None], rows], 0) for value in (force, curvature))
        J = materialize(distance_jacobian(materialize(_of_slices(measured, slices)), rows))
        weighted, gradient = materialize((J * c[:, None], -(J * f[:, None]).sum(2)))
        matrix = jnp.einsum("lip,ljp->lij", weighted, J)
        added = (total.matrix.at[slices].add(matrix), total.gradient.at[slices].add(gradient))
        return first + together, NormalEquations(*added)

    def some_left(state: tuple[Array, NormalEquations]) -> Array:
        return state[0] < number_of_parts(marked)

    nothing = NormalEquations(jnp.zeros((L, C, C), force.dtype), jnp.zeros((L, C), force.dtype))
    _, total = jax.lax.while_loop(some_left, add_parts, (jnp.zeros((), jnp.float32), nothing))
    return total


def _of_slices(measured: SliceGeometry, slices: Array) -> SliceGeometry:
    """What `distance_jacobian` needs of some slices (E,)."""
    contacts = jax.tree.map(lambda value: take_slices(value, slices), measured.contacts)
    columns, held = measured.columns[slices], measured.held[slices]
    return measured._replace(contacts=contacts, columns=columns, held=held)
