"""Signed distances of everything that can touch, for many slices at once, with their contact wrenches.

Rows, in this order (C capsules an arm, N objects):

- *arm rows*: capsule against capsule in rectangles of pairs (`_CROSS_PAIRS` between the arms, `_SELF_PAIRS` within
each), then
  capsule against the table;
- *object rows*: every arm capsule (left arm's C, then the right's) against each object, object after object; object
against the table;
  object against object.

A row that does not count in a slice (an object and the hand that holds it, two objects that stand where the scene has
them, an absent object) has the distance `FAR` and a zero wrench."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.distances import Prism, capsule_capsule, capsule_plane, capsule_prism, prism_plane, prism_prism
from dvr_jax.geometry.vectors import Rotation, Six, Vector, materialize
from dvr_jax.komo.modes import ObjectPoses
from dvr_jax.komo.problem import ABSENT, FIXED
from dvr_jax.robot.kinematics import load_arm
from dvr_jax.scene.workspace import NUMBER_OF_JOINTS

FAR = 1.0
"""Distance given to rows that do not count [m]."""

HOLDING_CAPSULES = ("hand", "finger_left", "finger_right")
"""Capsules that touch the object which their arm holds."""

_CAPSULES = ("column", "upper_arm", "elbow", "forearm", "wrist", "flange", "hand", "finger_left", "finger_right")
_FOREARM_ON, _WRIST_ON, _FLANGE_ON, _ALL = slice(3, 9), slice(4, 9), slice(5, 9), slice(0, 9)

_CROSS_PAIRS = ((_FOREARM_ON, slice(1, 9)), (slice(1, 3), _FOREARM_ON))
"""Rectangles of capsules (left arm's, right arm's). With bases 1.2 m apart no column is in the other arm's reach, and
upper arm and elbow of one arm cannot meet those of the other."""

_SELF_PAIRS = ((slice(0, 1), _FOREARM_ON), (slice(1, 2), _WRIST_ON), (slice(2, 4), _FLANGE_ON))
"""Rectangles of capsules of one arm: column against the forearm and beyond, upper arm against the wrist and beyond,
elbow and forearm against the flange and beyond. All others are neighbours, or out of reach within the joint limits."""

_TABLE = _FOREARM_ON
"""Capsules that can reach the table; upper arm and elbow cannot within the joint limits."""


class Distances(NamedTuple):
    """Signed distances and wrenches of L slices."""

    arm: Array
    """(Pa, L) distances of the arm rows [m]."""
    arm_wrench: Array
    """(6, Pa, L)."""
    object: Array
    """(Po, L) distances of the object rows [m]."""
    object_wrench: Array
    """(6, Po, L)."""


@lru_cache(maxsize=1)
def arm_signs() -> np.ndarray:
    """(14, Pa): how joint k moves the first body of an arm row minus how it moves the second (+1, 0, -1)."""
    moves = capsule_moves()
    columns = []
    for left, right in _CROSS_PAIRS:
        for i in range(left.start, left.stop):
            columns += [moves[:, 0, i] - moves[:, 1, j] for j in range(right.start, right.stop)]
    for near, far in _SELF_PAIRS:
        for arm in range(2):
            for i in range(near.start, near.stop):
                columns += [moves[:, arm, i] - moves[:, arm, j] for j in range(far.start, far.stop)]
    for arm in range(2):
        columns += [moves[:, arm, i] for i in range(_TABLE.start, _TABLE.stop)]
    return np.stack(columns, axis=1)


@lru_cache(maxsize=1)
def capsule_moves() -> np.ndarray:
    """(14, 2, C): 1 where a joint moves a capsule of an arm."""
    arm = load_arm()
    assert arm.capsule_names == _CAPSULES, arm.capsule_names
    moves = np.zeros((2 * NUMBER_OF_JOINTS, 2, len(_CAPSULES)))
    for a in range(2):
        for c, link in enumerate(arm.capsule_links):
            moves[a * NUMBER_OF_JOINTS : a * NUMBER_OF_JOINTS + link, a, c] = 1
    return moves


@lru_cache(maxsize=8)
def object_signs(number_of_objects: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the object rows: (14, Po) how the arm's joints move the capsule, and (N, Po) +1 where object n is the first
    body of the row, -1 where it is the second."""
    N, capsules = number_of_objects, 2 * len(_CAPSULES)
    pairs = list(combinations(range(N), 2))
    rows = N * capsules + N + len(pairs)
    joints = np.zeros((2 * NUMBER_OF_JOINTS, rows))
    joints[:, : N * capsules] = np.tile(capsule_moves().reshape(-1, capsules), N)
    role = np.zeros((N, rows))
    for n in range(N):
        role[n, n * capsules : (n + 1) * capsules] = -1
        role[n, N * capsules + n] = 1
    for row, (first, second) in enumerate(pairs, start=N * capsules + N):
        role[first, row], role[second, row] = 1, -1
    return joints, role


def number_of_rows(number_of_objects: int) -> int:
    """Number of arm rows and object rows together."""
    return arm_signs().shape[1] + object_signs(number_of_objects)[1].shape[1]


def _flat(distance: Array, wrench: Six, shape: tuple[int, int]) -> tuple[Array, list[Array]]:
    """Rows of a rectangle of pairs as (p, L)."""
    L = distance.shape[-1]

    def flatten(x: Array) -> Array:
        return jnp.broadcast_to(x, (*shape, L)).reshape(-1, L)

    return flatten(distance), [flatten(component) for component in wrench]


def _arm_rows(a: Vector, b: Vector) -> tuple[Array, Array]:
    radii = load_arm().capsule_radii
    C = len(_CAPSULES)
    first: list[tuple[int, int]] = []
    second: list[tuple[int, int]] = []
    for left, right in _CROSS_PAIRS:
        pairs = [(i, j) for i in range(left.start, left.stop) for j in range(right.start, right.stop)]
        first += [(0, i) for i, _ in pairs]
        second += [(1, j) for _, j in pairs]
    for near, far in _SELF_PAIRS:
        for arm in range(2):
            pairs = [(i, j) for i in range(near.start, near.stop) for j in range(far.start, far.stop)]
            first += [(arm, i) for i, _ in pairs]
            second += [(arm, j) for _, j in pairs]
    i, j = (np.array([arm * C + c for arm, c in side]) for side in (first, second))

    def pick(v: Vector, index: np.ndarray) -> Vector:
        return tuple(x.reshape(2 * C, -1)[index] for x in v)  # type: ignore[return-value]

    ends = materialize((pick(a, i), pick(b, i), pick(a, j), pick(b, j)))
    both = np.tile(radii, 2).astype(a[0].dtype)[:, None]
    distance, wrench = capsule_capsule(ends[0], ends[1], both[i], ends[2], ends[3], both[j])
    groups = [(distance, list(wrench))]
    table = np.array([arm * C + c for arm in range(2) for c in range(_TABLE.start, _TABLE.stop)])
    distance, wrench = capsule_plane(pick(a, table), pick(b, table), both[table])
    groups.append((distance, [jnp.broadcast_to(component, distance.shape) for component in wrench]))
    return _concatenate(groups)


def _concatenate(groups: list[tuple[Array, list[Array]]]) -> tuple[Array, Array]:
    distance = jnp.concatenate([group[0] for group in groups])
    return distance, jnp.stack([jnp.concatenate([group[1][i] for group in groups]) for i in range(6)])


def _object_rows(a: Vector, b: Vector, objects: ObjectPoses, half: Prism, kind: Array) -> tuple[Array, Array]:
    dtype = a[0].dtype
    N, L = kind.shape
    C = len(_CAPSULES)

    def capsules(v: Vector) -> Vector:
        return tuple(x.reshape(1, 2 * C, L) for x in v)  # type: ignore[return-value]

    def each(x: Array) -> Array:
        return x[:, None]

    R: Rotation = tuple(tuple(each(x) for x in column) for column in objects.R)  # type: ignore[assignment]
    p: Vector = (each(objects.p[0]), each(objects.p[1]), each(objects.p[2]))
    shape: Prism = (each(half[0]), each(half[1]), each(half[2]), each(half[3]))
    radii = np.tile(load_arm().capsule_radii, 2)[None, :, None].astype(dtype)
    distance, wrench = capsule_prism(capsules(a), capsules(b), radii, R, p, shape)
    holds = np.array([name in HOLDING_CAPSULES for name in _CAPSULES])
    touching = [each(objects.held[arm]) & np.pad(holds, (arm * C, (1 - arm) * C))[None, :, None] for arm in range(2)]
    ignored = touching[0] | touching[1] | each(kind == ABSENT)
    groups = [_masked(distance, wrench, ignored, (N, 2 * C))]

    distance, wrench = prism_plane(objects.R, objects.p, half)
    groups.append(
        _masked(each(distance), tuple(each(x) for x in wrench), ~each(objects.held[0] | objects.held[1]), (N, 1))
    )
    if N > 1:
        i, j = np.array(list(combinations(range(N), 2))).T

        def pick(index: np.ndarray) -> tuple[Rotation, Vector, Prism]:
            R_i = tuple(tuple(x[index] for x in column) for column in objects.R)
            return R_i, tuple(x[index] for x in objects.p), tuple(x[index] for x in half)  # type: ignore[return-value]

        distance, wrench = prism_prism(*pick(i), *pick(j))
        absent, fixed = kind == ABSENT, kind == FIXED
        ignored = absent[i] | absent[j] | (fixed[i] & fixed[j])
        groups.append(_masked(each(distance), tuple(each(x) for x in wrench), each(ignored), (len(i), 1)))
    return _concatenate(groups)


def _masked(distance: Array, wrench: Six, ignored: Array, shape: tuple[int, int]) -> tuple[Array, list[Array]]:
    clear: Six = tuple(jnp.where(ignored, 0, component) for component in wrench)  # type: ignore[assignment]
    return _flat(jnp.where(ignored, FAR, distance), clear, shape)


def measure_distances(a: Vector, b: Vector, objects: ObjectPoses, half: Prism, kind: Array) -> Distances:
    """Distances and wrenches of all rows in L slices.

    Args:
        a, b: ends of the capsules, components (2, C, L).
        objects: poses, components (N, L).
        half: shapes of the objects, components (N, L).
        kind: (N, L) how each object is attached.
    """
    return Distances(*_arm_rows(a, b), *_object_rows(a, b, objects, half, kind))
