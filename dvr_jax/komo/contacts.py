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
"""Rectangles of capsules (left arm's, right arm's). With bases 1.5 m apart no column is in the other arm's reach, and
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
    moves = capsule_moves().reshape(2 * NUMBER_OF_JOINTS, -1)
    first, second = _pairs()
    on_table = capsule_moves()[:, :, _TABLE].reshape(2 * NUMBER_OF_JOINTS, -1)
    return np.concatenate([moves[:, first] - moves[:, second], on_table], axis=1)


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


def _pairs() -> tuple[np.ndarray, np.ndarray]:
    """Capsules (arm times C plus number) of all pairs of the arm rows."""
    C = len(_CAPSULES)
    pairs = []
    for left, right in _CROSS_PAIRS:
        pairs += [(i, C + j) for i in range(left.start, left.stop) for j in range(right.start, right.stop)]
    for near, far in _SELF_PAIRS:
        for arm in (0, C):
            pairs += [(arm + i, arm + j) for i in range(near.start, near.stop) for j in range(far.start, far.stop)]
    first, second = np.array(pairs).T
    return first, second


def _arm_rows(a: Vector, b: Vector) -> tuple[Array, Six]:
    C, L = len(_CAPSULES), a.shape[-1]
    both = np.tile(load_arm().capsule_radii, 2).astype(a.dtype)[:, None]
    a, b = a.reshape(3, 2 * C, L), b.reshape(3, 2 * C, L)
    i, j = _pairs()
    between = capsule_capsule(*materialize((a[:, i], b[:, i])), both[i], *materialize((a[:, j], b[:, j])), both[j])
    on_table = np.array([arm * C + c for arm in range(2) for c in range(_TABLE.start, _TABLE.stop)])
    return _concatenate([between, capsule_plane(a[:, on_table], b[:, on_table], both[on_table])])


def _concatenate(groups: list[tuple[Array, Six]]) -> tuple[Array, Six]:
    """Rows of groups (p, L) with wrenches (6, p, L), one after the other."""
    distances, wrenches = zip(*materialize(groups), strict=True)
    return jnp.concatenate(distances), jnp.concatenate(wrenches, axis=1)


def _object_rows(a: Vector, b: Vector, objects: ObjectPoses, half: Prism, kind: Array) -> tuple[Array, Six]:
    N, L = kind.shape
    C = len(_CAPSULES)
    radii = np.tile(load_arm().capsule_radii, 2)[:, None].astype(a.dtype)
    distance, wrench = capsule_prism(
        a.reshape(3, 1, 2 * C, L), b.reshape(3, 1, 2 * C, L), radii,
        objects.R[:, :, :, None], objects.p[:, :, None], half[:, :, None],
    )  # fmt: skip
    holds = np.array([name in HOLDING_CAPSULES for name in _CAPSULES])
    touching = [objects.held[arm][:, None] & np.pad(holds, (arm * C, (1 - arm) * C))[:, None] for arm in range(2)]
    ignored = touching[0] | touching[1] | (kind == ABSENT)[:, None]
    distance, wrench = _masked(distance, wrench, ignored)
    groups = [(distance.reshape(-1, L), wrench.reshape(6, -1, L))]
    groups.append(_masked(*prism_plane(objects.R, objects.p, half), ~objects.held.any(0)))
    if N > 1:
        i, j = np.array(list(combinations(range(N), 2))).T

        def pick(index: np.ndarray) -> tuple[Rotation, Vector, Prism]:
            return objects.R[:, :, index], objects.p[:, index], half[:, index]

        absent, fixed = kind == ABSENT, kind == FIXED
        ignored = absent[i] | absent[j] | (fixed[i] & fixed[j])
        groups.append(_masked(*prism_prism(*materialize((*pick(i), *pick(j)))), ignored))
    return _concatenate(groups)


def _masked(distance: Array, wrench: Six, ignored: Array) -> tuple[Array, Six]:
    return jnp.where(ignored, FAR, distance), jnp.where(ignored, 0, wrench)


def measure_distances(a: Vector, b: Vector, objects: ObjectPoses, half: Prism, kind: Array) -> Distances:
    """Distances and wrenches of all rows in L slices.

    Args:
        a, b: ends of the capsules, (3, 2, C, L).
        objects: poses, batch axes (N, L).
        half: (4, N, L) shapes of the objects.
        kind: (N, L) how each object is attached.
    """
    return Distances(*_arm_rows(a, b), *_object_rows(a, b, objects, half, kind))
