"""Which things can touch: the rows of distances and what each is about.

ConstraintValues, in this order (C capsules an arm, N objects):

- *arm rows*: capsule against capsule in rectangles of pairs (`CROSS_PAIRS` between the arms, `SELF_PAIRS` within each),
  then capsule against the table;
- *object rows*: every arm capsule (left arm's C, then the right's) against each object, object after object; object
  against the table; object against object."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np

from dvr_jax.workcell.constants import NUMBER_OF_JOINTS
from dvr_jax.workcell.kinematics import load_arm

HOLDING_CAPSULES = ("hand", "finger_left", "finger_right")
"""Capsules that touch the object which their arm holds."""

CAPSULES = ("column", "upper_arm", "elbow", "forearm", "wrist", "flange", "hand", "finger_left", "finger_right")
_FOREARM_ON, _WRIST_ON, _FLANGE_ON = slice(3, 9), slice(4, 9), slice(5, 9)

CROSS_PAIRS = ((_FOREARM_ON, slice(1, 9)), (slice(1, 3), _FOREARM_ON))
"""Rectangles of capsules (left arm's, right arm's). With bases 1.5 m apart no column is in the other arm's reach, and
upper arm and elbow of one arm cannot meet those of the other."""

SELF_PAIRS = ((slice(0, 1), _FOREARM_ON), (slice(1, 2), _WRIST_ON), (slice(2, 4), _FLANGE_ON))
"""Rectangles of capsules of one arm: column against the forearm and beyond, upper arm against the wrist and beyond,
elbow and forearm against the flange and beyond. All others are neighbours, or out of reach within the joint limits."""

ABOVE_TABLE = _FOREARM_ON
"""Capsules that can reach the table; upper arm and elbow cannot within the joint limits."""


@lru_cache(maxsize=1)
def arm_signs() -> np.ndarray:
    """(14, Pa): how joint k moves the first body of an arm row minus how it moves the second (+1, 0, -1)."""
    moves = capsule_moves().reshape(2 * NUMBER_OF_JOINTS, -1)
    first, second = capsule_pairs()
    on_table = capsule_moves()[:, :, ABOVE_TABLE].reshape(2 * NUMBER_OF_JOINTS, -1)
    return np.concatenate([moves[:, first] - moves[:, second], on_table], axis=1)


@lru_cache(maxsize=1)
def capsule_moves() -> np.ndarray:
    """(14, 2, C): 1 where a joint moves a capsule of an arm."""
    arm = load_arm()
    assert arm.capsule_names == CAPSULES, arm.capsule_names
    moves = np.zeros((2 * NUMBER_OF_JOINTS, 2, len(CAPSULES)))
    for a in range(2):
        for c, link in enumerate(arm.capsule_links):
            moves[a * NUMBER_OF_JOINTS : a * NUMBER_OF_JOINTS + link, a, c] = 1
    return moves


@lru_cache(maxsize=8)
def object_signs(number_of_objects: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the object rows: (14, Po) how the arm's joints move the capsule, and (N, Po) +1 where object n is the first
    body of the row, -1 where it is the second."""
    N, capsules = number_of_objects, 2 * len(CAPSULES)
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


def capsule_pairs() -> tuple[np.ndarray, np.ndarray]:
    """Capsules (arm times C plus number) of all pairs of the arm rows."""
    C = len(CAPSULES)
    pairs = []
    for left, right in CROSS_PAIRS:
        pairs += [(i, C + j) for i in range(left.start, left.stop) for j in range(right.start, right.stop)]
    for near, far in SELF_PAIRS:
        for arm in (0, C):
            pairs += [(arm + i, arm + j) for i in range(near.start, near.stop) for j in range(far.start, far.stop)]
    first, second = np.array(pairs).T
    return first, second


@lru_cache(maxsize=8)
def row_bodies(number_of_objects: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What each row is about, (P,) each: its first capsule, its second capsule, its place among the pairs of a capsule
    and an object, its place among all other rows; -1 where it has none."""
    C, N = len(CAPSULES), number_of_objects
    i, j = capsule_pairs()
    on_table, grips = 2 * (ABOVE_TABLE.stop - ABOVE_TABLE.start), 2 * C * N
    others = N + N * (N - 1) // 2

    def no(rows: int) -> np.ndarray:
        return np.full(rows, -1)

    return (
        np.concatenate([i, no(on_table), np.tile(np.arange(2 * C), N), no(others)]),
        np.concatenate([j, no(on_table + grips + others)]),
        np.concatenate([no(len(i) + on_table), np.arange(grips), no(others)]),
        np.concatenate([no(len(i)), np.arange(on_table), no(grips), on_table + np.arange(others)]),
    )
