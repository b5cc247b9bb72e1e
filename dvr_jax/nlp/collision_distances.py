"""Signed distances of everything that can touch, for many slices at once, and the contact wrenches of chosen rows.

ConstraintValues are those of `dvr_jax.nlp.collision_rows`. One that does not count in a slice (an object and the hand that holds it,
two objects that stand where the scene has them, an absent object) has the distance `FAR` and a zero wrench.

A capsule's distance to an object is dear, and nearly all of them are far: there a lower bound is taken in its place,
that of the capsule's bounding sphere (`NEAR`)."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.distances import (
    Prism,
    axis_point_wrench,
    capsule_capsule,
    capsule_capsule_distance,
    capsule_plane,
    nearest_on_axis,
    point_prism,
    prism_plane,
    prism_prism,
)
from dvr_jax.geometry.vectors import Rotation, Six, Vector, materialize, rotate_back
from dvr_jax.modes.poses import ObjectPoses
from dvr_jax.nlp.collision_rows import (
    ABOVE_TABLE,
    CAPSULES,
    CROSS_PAIRS,
    HOLDING_CAPSULES,
    SELF_PAIRS,
    row_bodies,
)
from dvr_jax.nlp.compaction import mark, number_of_parts, place, visit
from dvr_jax.nlp.problem import ABSENT, FIXED
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.workcell.kinematics import load_arm

FAR = 1.0
"""Distance given to rows that do not count [m]."""

NEAR = 0.03
"""A capsule's bounding sphere that is further from an object stands for the capsule [m]. Such a row pushes only while
its multiplier exceeds the penalty times this, which takes penetrations at updates that add up to as much."""


class Contacts(NamedTuple):
    """What the wrenches of L slices come of (`row_wrenches`)."""

    ends: tuple[Vector, Vector]
    """Ends of both arms' capsules, (3, 2 C, L) each."""
    objects: tuple[Rotation, Vector, Prism]
    """Poses and shapes of the objects, batch axes (N, L)."""
    position: Array
    """(2 C N, L) where on the axis of a capsule, from 0 to 1, its distance to an object is taken; -1 where the row does
    not count."""
    wrench: Six
    """(6, Q, L) of the rows that have a capsule and the table, an object and the table, or two objects."""


def _radii(dtype: jnp.dtype) -> np.ndarray:
    """(2 C, 1) radii of both arms' capsules [m]."""
    return np.tile(load_arm().capsule_radii, 2).astype(dtype)[:, None]


def _capsules_and_objects(
    a: Vector, b: Vector, R: Rotation, p: Vector, half: Prism, ignored: Array
) -> tuple[Array, Array]:
    """Distances of capsules (3, 2 C, L) and objects (N, L), ``FAR`` where ignored (N 2 C, L), and where on the axes
    they are taken."""
    C, (N, L) = a.shape[1], p.shape[1:]
    radii = _radii(a.dtype)
    middle, along = materialize(((a + b) / 2, (b - a) / 2))
    # What a sphere around the capsule comes closer than its middle.
    reach = materialize(jnp.sqrt((along * along).sum(0)) + radii)
    bound, _ = point_prism(rotate_back(R[:, :, :, None], middle[:, None] - p[:, :, None]), half[:, :, None])
    bound = materialize(jnp.where(ignored, FAR, (bound - reach).reshape(N * C, L)))
    marked, together = mark(bound < NEAR, 1), batch_sizes().near_pairs

    def add_pairs(state: tuple[Array, Array]) -> tuple[Array, Array]:
        first, found = state
        chosen = visit(marked, first, together)
        (row,), slices = chosen.rows, jnp.minimum(chosen.slices, L - 1)
        capsule, item = row % C, row // C
        a0, a1 = materialize((a[:, capsule, slices], b[:, capsule, slices]))
        pose = materialize((R[:, :, item, slices], p[:, item, slices], half[:, item, slices]))
        t = nearest_on_axis(a0, a1, *pose)
        point = materialize(rotate_back(pose[0], a0 + t * (a1 - a0) - pose[1]))
        exact = point_prism(point, pose[2])[0] - jnp.take(jnp.asarray(radii[:, 0]), capsule)
        pair = jnp.stack([exact, t])
        return first + together, jax.lax.dynamic_update_slice_in_dim(found, pair, first.astype(jnp.int32), 1)

    def some_left(state: tuple[Array, Array]) -> Array:
        return state[0] < number_of_parts(marked)

    nothing = jnp.zeros((), jnp.float32), jnp.zeros((2, N * C * L + together), a.dtype)
    _, found = jax.lax.while_loop(some_left, add_pairs, nothing)
    middles = jnp.where(ignored, -1, jnp.full_like(bound, 0.5))
    distance, position = jnp.where(marked.mask, jnp.take(found, place(marked), axis=1), jnp.stack([bound, middles]))
    return distance, position


def _between_capsules(a: Vector, b: Vector) -> Array:
    """Distances of all pairs of capsules; rectangle by rectangle, since picking each pair's ends takes longer."""
    L, radii = a.shape[-1], load_arm().capsule_radii.astype(a.dtype)[:, None]
    both = slice(None)
    rectangles = [(0, *pair, 1) for pair in CROSS_PAIRS] + [(both, *pair, both) for pair in SELF_PAIRS]
    return jnp.concatenate(
        [
            capsule_capsule_distance(
                a[:, i, near][..., None, :], b[:, i, near][..., None, :], radii[near, None],
                a[:, j, far][..., None, :, :], b[:, j, far][..., None, :, :], radii[far],
            ).reshape(-1, L)
            for i, near, far, j in rectangles
        ]
    )  # fmt: skip


def _masked(distance: Array, wrench: Six, ignored: Array) -> tuple[Array, Six]:
    return jnp.where(ignored, FAR, distance), jnp.where(ignored, 0, wrench)


def measure_contacts(a: Vector, b: Vector, objects: ObjectPoses, half: Prism, kind: Array) -> tuple[Array, Contacts]:
    """Distances (P, L) of all rows in L slices [m], and what their wrenches come of.

    Args:
        a, b: ends of the capsules, (3, 2, C, L).
        objects: poses, batch axes (N, L).
        half: (4, N, L) shapes of the objects.
        kind: (N, L) how each object is attached.
    """
    (N, L), C = kind.shape, len(CAPSULES)
    between = _between_capsules(a, b)
    a, b, radii = a.reshape(3, 2 * C, L), b.reshape(3, 2 * C, L), _radii(a.dtype)
    on_table = np.array([arm * C + c for arm in range(2) for c in range(ABOVE_TABLE.start, ABOVE_TABLE.stop)])
    others = [capsule_plane(a[:, on_table], b[:, on_table], radii[on_table])]

    holds = np.array([name in HOLDING_CAPSULES for name in CAPSULES])
    touching = [objects.held[arm][:, None] & np.pad(holds, (arm * C, (1 - arm) * C))[:, None] for arm in range(2)]
    ignored = touching[0] | touching[1] | (kind == ABSENT)[:, None]
    near, position = _capsules_and_objects(a, b, objects.R, objects.p, half, materialize(ignored.reshape(-1, L)))

    others.append(_masked(*prism_plane(objects.R, objects.p, half), ~objects.held.any(0)))
    if N > 1:
        i, j = np.array(list(combinations(range(N), 2))).T

        def pick(index: np.ndarray) -> tuple[Rotation, Vector, Prism]:
            return objects.R[:, :, index], objects.p[:, index], half[:, index]

        absent, fixed = kind == ABSENT, kind == FIXED
        ignored = absent[i] | absent[j] | (fixed[i] & fixed[j])
        others.append(_masked(*prism_prism(*materialize((*pick(i), *pick(j)))), ignored))
    distances, wrenches = zip(*materialize(others), strict=True)
    contacts = Contacts(
        ends=(a, b),
        objects=(objects.R, objects.p, half),
        position=position,
        wrench=jnp.concatenate(wrenches, axis=1),
    )
    return jnp.concatenate([between, distances[0], near, *distances[1:]]), contacts


def row_wrenches(contacts: Contacts, rows: Array) -> Six:
    """Wrenches (6, k, L) of the rows (k, L) of each slice: derivatives of their distances."""
    (R, p, half), (a, b) = contacts.objects, contacts.ends
    N, C = p.shape[1], a.shape[1]
    first, second, pair, other = (jnp.take(jnp.asarray(table), rows) for table in row_bodies(N))

    def pick(value: Array, index: Array) -> Array:
        index = jnp.broadcast_to(jnp.maximum(index, 0), (*value.shape[:-2], *rows.shape))
        return jnp.take_along_axis(value, index, axis=-2)

    a0, a1, b0, b1 = materialize(tuple(pick(end, index) for index in (first, second) for end in (a, b)))
    R, p, half = materialize(tuple(pick(value, pair // C) for value in (R, p, half)))
    t, stored = materialize((pick(contacts.position, pair), pick(contacts.wrench, other)))
    _, of_capsules = capsule_capsule(a0, a1, 0.0, b0, b1, 0.0)
    _, gradient = materialize(point_prism(materialize(rotate_back(R, a0 + t * (a1 - a0) - p)), half))
    of_object = jnp.where(t < 0, 0, axis_point_wrench(a0, a1, t, R, gradient))
    return jnp.where(second >= 0, of_capsules, jnp.where(pair >= 0, of_object, stored))
