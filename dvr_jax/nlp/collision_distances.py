"""Signed distances of everything that can touch, for many slices at once, and the contact wrenches of chosen rows.

The distance of a row is that of its two bodies less the clearance that they keep (`dvr_jax.workcell.clearances`), so a
negative one is a violation. Rows are those of `dvr_jax.nlp.collision_rows`. A row that does not count in a slice (an
object and the hand that holds it, two bodies that stand where the scene has them, an absent object) has the distance
`FAR` and a zero wrench.

A capsule's distance to a body is expensive, and nearly all of them are far: there a lower bound is taken in its place,
that of the capsule's bounding sphere (`NEAR`).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.capsule_prism import axis_point_wrench, nearest_on_axis
from dvr_jax.geometry.capsules import (
    capsule_capsule,
    capsule_capsule_distance,
    capsule_plane,
    nearest_points,
)
from dvr_jax.geometry.prism_prism import prism_prism
from dvr_jax.geometry.prisms import Prism, point_prism, prism_plane
from dvr_jax.geometry.vectors import (
    Rotation,
    SpatialVector,
    Vector,
    cross,
    dot,
    materialize,
    rotate_back,
)
from dvr_jax.modes.mode import ModeKind, ObjectPoses
from dvr_jax.nlp.collision_rows import object_pairs, row_bodies, table_capsules
from dvr_jax.nlp.compaction import count_active, gather_chunk, number_of_groups, slot
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.workcell.model import WorkcellModel

FAR = 1.0
"""Distance given to rows that do not count [m]."""

NEAR = 0.03
"""A capsule's bounding sphere that is farther than this from a body stands for the capsule [m]. Such a row is active
only while its multiplier exceeds the penalty times this, which takes penetrations at updates that add up to as
much."""


class Segments(NamedTuple):
    """Axes of all capsules of all arms in L slices."""

    start: Float[Array, "3 arm_capsules slices"]
    """First ends [m]."""

    end: Float[Array, "3 arm_capsules slices"]
    """Second ends [m]."""

    radius: Float[Array, "arm_capsules 1"]
    """Radii of the capsules [m]."""


class Bodies(NamedTuple):
    """Poses and shapes of N objects and F fixed bodies in L slices, the objects first."""

    rotation: Rotation
    """Axes (3, 3, N + F, L)."""

    position: Vector
    """Centers (3, N + F, L) [m]."""

    prism: Prism
    """Shapes (4, N + F, L)."""


class Contacts(NamedTuple):
    """What the wrenches of chosen rows are computed from (`row_wrenches`)."""

    segments: Segments
    bodies: Bodies
    axis_position: Float[Array, "pairs slices"]
    """Where on the axis of a capsule, from 0 to 1, its distance to a body is taken; -1 where the row does not count."""

    wrench: Float[Array, "6 other_rows slices"]
    """Wrenches of the rows of a capsule and the table, an object and the table, or two bodies."""

    height: Float[Array, "other_rows slices"]
    """Position of the contact of these rows along its normal [m]; of two bodies it is that of the middle between their
    centers."""


class _NearPairs(NamedTuple):
    """State of the loop over near pairs of a capsule and a body."""

    first: Array
    """Number of the first pair of the next pass."""

    found: Array
    """(2, pairs) exact distance [m] and axis position of the pairs visited so far."""


def measure_contacts(
    model: WorkcellModel,
    starts: Float[Array, "3 arms capsules slices"],
    ends: Float[Array, "3 arms capsules slices"],
    objects: ObjectPoses,
    kind: Int[Array, "objects slices"],
    bodies: Bodies,
    clearance: Float[Array, "body_rows slices"],
) -> tuple[Float[Array, "rows slices"], Contacts]:
    """Distances of all rows less their clearances [m], and what their wrenches are computed from.

    Args:
        model: Arms of the workcell.
        starts: First ends of the capsules' segments [m].
        ends: Second ends [m].
        objects: Poses of the objects.
        kind: `ModeKind` of each object.
        bodies: Poses and shapes of the objects and the fixed bodies.
        clearance: Distances that hands, objects and fixed bodies keep (`dvr_jax.nlp.body_clearances`) [m].
    """
    L = starts.shape[-1]
    N = kind.shape[0]
    A = model.structure.number_of_arms
    of_hands, of_objects, of_pairs = jnp.split(clearance, [A * N, A * N + N])
    segments = _flatten(model, starts, ends)
    between_capsules = _between_capsules(model, starts, ends)
    on_table = table_capsules(model.structure)
    table_distance, table_wrench = capsule_plane(
        segments.start[:, on_table], segments.end[:, on_table], segments.radius[on_table]
    )

    ignored = _ignored_capsules(model, objects, kind, bodies)
    keep = _capsule_clearances(model, of_hands.reshape(A, N, L), bodies.position.shape[1])
    near, axis_position = _capsules_and_bodies(
        segments, bodies, materialize(ignored.reshape(-1, L)), keep
    )

    above_table = jnp.tile(jnp.asarray(model.table_clearances, starts.dtype), A)[:, None]
    above_support, standing_wrench = prism_plane(
        objects.rotation, objects.position, bodies.prism[:, :N]
    )
    others = [
        (table_distance - above_table, table_wrench),
        _masked(above_support - of_objects, standing_wrench, ~objects.held.any(0)),
    ]
    heights = [table_distance + segments.radius[on_table], above_support]
    pairs = object_pairs(N, bodies.position.shape[1] - N)
    if len(pairs[0]):
        others.append(_between_bodies(bodies, kind, of_pairs))
        middle = (bodies.position[:, pairs[0]] + bodies.position[:, pairs[1]]) / 2
        heights.append(dot(others[-1][1][3:], middle))
    distances, wrenches = zip(*materialize(others), strict=True)

    contacts = Contacts(
        segments,
        bodies,
        axis_position,
        jnp.concatenate(wrenches, axis=1),
        jnp.concatenate(heights),
    )
    return jnp.concatenate([between_capsules, distances[0], near, *distances[1:]]), contacts


def _flatten(model: WorkcellModel, starts: Array, ends: Array) -> Segments:
    """Segments with arms and capsules on one axis."""
    shape = (3, -1, starts.shape[-1])
    radii = jnp.asarray(model.capsule_radii, starts.dtype)
    radius = jnp.tile(radii, model.structure.number_of_arms)[:, None]
    return Segments(starts.reshape(shape), ends.reshape(shape), radius)


def _between_capsules(
    model: WorkcellModel, starts: Array, ends: Array
) -> Float[Array, "pairs slices"]:
    """Distances of all capsule pairs less their clearances, rectangle by rectangle.

    Picking each pair's ends takes longer.
    """
    radii = jnp.asarray(model.capsule_radii, starts.dtype)[:, None]
    structure = model.structure
    every = slice(None)
    rectangles: list[tuple[int | slice, int | slice, slice, slice]] = [
        (a, b, slice(*near), slice(*far)) for a, b, (near, far) in structure.cross_pairs
    ]
    rectangles += [(every, every, slice(*near), slice(*far)) for near, far in structure.self_pairs]

    distances = [
        capsule_capsule_distance(
            starts[:, a, near][..., None, :],
            ends[:, a, near][..., None, :],
            radii[near, None],
            starts[:, b, far][..., None, :, :],
            ends[:, b, far][..., None, :, :],
            radii[far],
        ).reshape(-1, starts.shape[-1])
        for a, b, near, far in rectangles
    ]
    if not distances:
        return jnp.zeros((0, starts.shape[-1]), starts.dtype)

    # Capsules of one arm keep no distance: they reach beyond its links.
    number = len(structure.cross_pairs)
    keep = jnp.asarray(model.arm_clearance, starts.dtype)
    return jnp.concatenate([*[value - keep for value in distances[:number]], *distances[number:]])


def _capsule_clearances(
    model: WorkcellModel, of_hands: Float[Array, "arms objects slices"], number_of_bodies: int
) -> Float[Array, "bodies arm_capsules slices"]:
    """Distance that each capsule keeps from each body [m]."""
    structure = model.structure
    C = structure.number_of_capsules
    arms, objects, L = of_hands.shape
    is_hand = np.zeros(C, bool)
    is_hand[list(structure.holding_capsules)] = True

    of_fixed = jnp.full(
        (arms, number_of_bodies - objects, L), jnp.asarray(model.hand_clearance, of_hands.dtype)
    )
    hands = jnp.concatenate([of_hands, of_fixed], axis=1).swapaxes(0, 1)
    links = jnp.asarray(model.link_clearance, of_hands.dtype)
    keep = jnp.where(is_hand[:, None], hands[:, :, None], links)
    return keep.reshape(number_of_bodies, arms * C, L)


def _ignored_capsules(
    model: WorkcellModel, objects: ObjectPoses, kind: Array, bodies: Bodies
) -> Bool[Array, "bodies arm_capsules slices"]:
    """Pairs of a body and a capsule that do not count.

    These are what a hand holds, absent objects, and bases with what stands where the scene has it: neither moves.
    """
    structure = model.structure
    C = structure.number_of_capsules
    holds = np.zeros(C, bool)
    holds[list(structure.holding_capsules)] = True

    ignored = (kind == ModeKind.ABSENT)[:, None]
    for arm in range(structure.number_of_arms):
        own = np.zeros(structure.number_of_arms * C, bool)
        own[arm * C : (arm + 1) * C] = holds
        ignored = ignored | (objects.held[arm][:, None] & own[:, None])

    fixed = bodies.position.shape[1] - kind.shape[0]
    ignored = jnp.pad(ignored, [(0, fixed), (0, 0), (0, 0)])
    of_base = np.tile(np.array(structure.capsule_links) == 0, structure.number_of_arms)
    stands = jnp.pad(kind == ModeKind.FIXED, [(0, fixed), (0, 0)], constant_values=True)
    return ignored | (stands[:, None] & of_base[:, None])


def _capsules_and_bodies(
    segments: Segments,
    bodies: Bodies,
    ignored: Bool[Array, "pairs slices"],
    clearance: Float[Array, "bodies arm_capsules slices"],
) -> tuple[Float[Array, "pairs slices"], Float[Array, "pairs slices"]]:
    """Distances less clearances [m] of capsules and bodies, `FAR` where ignored, and their places on the axes."""
    a = segments.start
    b = segments.end
    capsules = a.shape[1]
    number, L = bodies.position.shape[1:]

    # A lower bound for every pair: the distance of the capsule's bounding sphere.
    middle, half_axis = materialize(((a + b) / 2, (b - a) / 2))
    sphere_radius = materialize(jnp.sqrt((half_axis * half_axis).sum(0)) + segments.radius)
    local = rotate_back(
        bodies.rotation[:, :, :, None], middle[:, None] - bodies.position[:, :, None]
    )
    bound, _ = point_prism(local, bodies.prism[:, :, None])
    bound = materialize(
        jnp.where(ignored, FAR, (bound - sphere_radius - clearance).reshape(number * capsules, L))
    )

    # The exact distance of the near pairs, some at a time.
    active = count_active(bound < NEAR, 1)
    chunk_size = batch_sizes().near_pairs

    def measure_chunk(state: _NearPairs) -> _NearPairs:
        chunk = gather_chunk(active, state.first, chunk_size)
        pair = _measure_pairs(segments, bodies, chunk.rows[0], jnp.minimum(chunk.slices, L - 1))
        position = state.first.astype(jnp.int32)
        found = jax.lax.dynamic_update_slice_in_dim(state.found, pair, position, 1)
        return _NearPairs(state.first + chunk_size, found)

    def some_left(state: _NearPairs) -> Array:
        return state.first < number_of_groups(active)

    empty = jnp.zeros((2, number * capsules * L + chunk_size), a.dtype)
    found = jax.lax.while_loop(
        some_left, measure_chunk, _NearPairs(jnp.zeros((), jnp.float32), empty)
    ).found

    middles = jnp.where(ignored, -1, jnp.full_like(bound, 0.5))
    exact = jnp.take(found, slot(active), axis=1)
    exact = exact.at[0].add(-clearance.reshape(number * capsules, L))
    distance, position = jnp.where(active.mask, exact, jnp.stack([bound, middles]))
    return distance, position


def _measure_pairs(
    segments: Segments, bodies: Bodies, row: Array, slices: Array
) -> Float[Array, "2 pairs"]:
    """Exact distance [m] and axis position of pairs of a capsule and a body, by their row and slice."""
    capsules = segments.start.shape[1]
    capsule = row % capsules
    body = row // capsules
    start, end = materialize((segments.start[:, capsule, slices], segments.end[:, capsule, slices]))
    rotation, position, prism = materialize(
        (
            bodies.rotation[:, :, body, slices],
            bodies.position[:, body, slices],
            bodies.prism[:, body, slices],
        )
    )
    t = nearest_on_axis(start, end, rotation, position, prism)
    point = materialize(rotate_back(rotation, start + t * (end - start) - position))
    distance = point_prism(point, prism)[0] - jnp.take(segments.radius[:, 0], capsule)
    return jnp.stack([distance, t])


def _between_bodies(
    bodies: Bodies, kind: Array, clearance: Float[Array, "pairs slices"]
) -> tuple[Float[Array, "pairs slices"], SpatialVector]:
    """Distances less clearances [m] and wrenches of two objects, and of an object and a fixed body."""
    N = kind.shape[0]
    fixed = bodies.position.shape[1] - N
    first, second = object_pairs(N, fixed)
    all_kinds = jnp.pad(kind, [(0, fixed), (0, 0)], constant_values=int(ModeKind.FIXED))

    def pick(index: np.ndarray) -> tuple[Rotation, Vector, Prism]:
        return bodies.rotation[:, :, index], bodies.position[:, index], bodies.prism[:, index]

    absent = all_kinds == ModeKind.ABSENT
    stands = all_kinds == ModeKind.FIXED
    ignored = absent[first] | absent[second] | (stands[first] & stands[second])
    distance, wrench = prism_prism(*materialize((*pick(first), *pick(second))))
    return _masked(distance - clearance, wrench, ignored)


def _masked(distance: Array, wrench: SpatialVector, ignored: Array) -> tuple[Array, SpatialVector]:
    return jnp.where(ignored, FAR, distance), jnp.where(ignored, 0, wrench)


class RowContacts(NamedTuple):
    """Contacts of chosen rows of each slice."""

    wrench: Float[Array, "6 chosen slices"]
    """Derivative of the distance by the twists of the bodies."""

    first_point: Float[Array, "3 chosen slices"]
    """Point of the first body that is nearest to the second one, or the center of its curvature there [m]."""

    second_point: Float[Array, "3 chosen slices"]
    """The same of the second body [m]."""

    is_on_body: Bool[Array, "chosen slices"]
    """Whether a row is about a capsule and a body. The normal then turns with the body, whose faces are flat."""


def row_wrenches(
    model: WorkcellModel,
    contacts: Contacts,
    number_of_objects: int,
    rows: Int[Array, "chosen slices"],
) -> Float[Array, "6 chosen slices"]:
    """Wrenches of chosen rows of each slice: the derivatives of their distances by the twists of the bodies.

    Args:
        model: Arms of the workcell.
        contacts: As of `measure_contacts`.
        number_of_objects: Number N of objects.
        rows: Rows, other ones in each slice.
    """
    return row_contacts(model, contacts, number_of_objects, rows).wrench


def row_contacts(
    model: WorkcellModel,
    contacts: Contacts,
    number_of_objects: int,
    rows: Int[Array, "chosen slices"],
) -> RowContacts:
    """Contacts of chosen rows of each slice.

    Args:
        model: Arms of the workcell.
        contacts: As of `measure_contacts`.
        number_of_objects: Number N of objects.
        rows: Rows, other ones in each slice.
    """
    capsules = contacts.segments.start.shape[1]
    fixed = contacts.bodies.position.shape[1] - number_of_objects
    table = row_bodies(model.structure, number_of_objects, fixed)
    first = jnp.take(jnp.asarray(table.first_capsule), rows)
    second = jnp.take(jnp.asarray(table.second_capsule), rows)
    pair = jnp.take(jnp.asarray(table.capsule_body_pair), rows)
    other = jnp.take(jnp.asarray(table.other_row), rows)

    def pick(value: Array, index: Array) -> Array:
        index = jnp.broadcast_to(jnp.maximum(index, 0), (*value.shape[:-2], *rows.shape))
        return jnp.take_along_axis(value, index, axis=-2)

    # All three kinds of rows are evaluated for every row, and one is selected: a program has no branches.
    segments = contacts.segments
    a0, a1 = materialize((pick(segments.start, first), pick(segments.end, first)))
    b0, b1 = materialize((pick(segments.start, second), pick(segments.end, second)))
    _, of_capsules = capsule_capsule(a0, a1, 0.0, b0, b1, 0.0)

    bodies = contacts.bodies
    R, p, prism = materialize(tuple(pick(value, pair // capsules) for value in bodies))
    t, stored = materialize((pick(contacts.axis_position, pair), pick(contacts.wrench, other)))
    _, gradient = materialize(
        point_prism(materialize(rotate_back(R, a0 + t * (a1 - a0) - p)), prism)
    )
    of_body = jnp.where(t < 0, 0, axis_point_wrench(a0, a1, t, R, gradient))
    wrench = jnp.where(second >= 0, of_capsules, jnp.where(pair >= 0, of_body, stored))

    # The points on the axes of capsules; other points follow from the wrench and their height along the normal.
    nearest = nearest_points(a0, a1, b0, b1)
    normal = stored[3:]
    other_point = cross(normal, stored[:3]) + pick(contacts.height, other) * normal
    one_point = jnp.where(pair >= 0, a0 + t * (a1 - a0), other_point)
    return RowContacts(
        wrench,
        jnp.where(second >= 0, nearest.on_second + nearest.between, one_point),
        jnp.where(second >= 0, nearest.on_second, one_point),
        pair >= 0,
    )
