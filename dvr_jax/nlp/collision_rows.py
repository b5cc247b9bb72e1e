"""Which bodies can touch: the rows of distances and what each row is about.

A arms have C capsules each; there are N objects and F fixed bodies, B = N + F bodies together. Rows, in this order:

- *arm rows*: capsule against capsule, in rectangles of pairs (of different arms, then of the same arm, arm after arm),
  then capsule against the table;
- *body rows*: every capsule (first arm's C, then the next arm's) against each body, body after body; object against the
  table; object against object; object against fixed body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.workcell.model import WorkcellStructure


@dataclass(frozen=True, eq=False)
class RowBodies:
    """What each of P rows is about; -1 where a row has none of a kind."""

    first_capsule: Int[np.ndarray, " rows"]
    """The row's first capsule: arm times C plus its number."""

    second_capsule: Int[np.ndarray, " rows"]
    """Its second capsule."""

    capsule_body_pair: Int[np.ndarray, " rows"]
    """Its place among the pairs of a capsule and a body."""

    other_row: Int[np.ndarray, " rows"]
    """Its place among the rows that are neither capsule against capsule nor capsule against body."""


@lru_cache(maxsize=64)
def capsule_pairs(
    structure: WorkcellStructure,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """First and second capsules (arm times C plus number) of all capsule-capsule rows."""
    C = structure.number_of_capsules
    pairs: list[tuple[int, int]] = []
    for a, b, (near, far) in structure.cross_pairs:
        pairs += [(a * C + i, b * C + j) for i, j in product(range(*near), range(*far))]
    for near, far in structure.self_pairs:
        for arm in range(structure.number_of_arms):
            pairs += [(arm * C + i, arm * C + j) for i, j in product(range(*near), range(*far))]
    indices = np.array(pairs, dtype=int).reshape(-1, 2)
    return indices[:, 0], indices[:, 1]


@lru_cache(maxsize=64)
def table_capsules(structure: WorkcellStructure) -> Int[np.ndarray, " rows"]:
    """Capsules (arm times C plus number) of the capsule-table rows."""
    C = structure.number_of_capsules
    arms = range(structure.number_of_arms)
    return np.array(
        [arm * C + c for arm in arms for c in range(*structure.table_capsules)], dtype=int
    )


@lru_cache(maxsize=64)
def object_pairs(
    number_of_objects: int, number_of_fixed: int
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """First and second bodies of the rows of two objects, and of an object and a fixed body."""
    N = number_of_objects
    pairs = [*combinations(range(N), 2), *product(range(N), range(N, N + number_of_fixed))]
    indices = np.array(pairs, dtype=int).reshape(-1, 2)
    return indices[:, 0], indices[:, 1]


@lru_cache(maxsize=64)
def capsule_motion(structure: WorkcellStructure) -> Float[np.ndarray, "joints arm_capsules"]:
    """1 where a joint (of D) moves a capsule (of A C), else 0."""
    moves = np.zeros(
        (
            structure.number_of_arms,
            structure.joints,
            structure.number_of_arms,
            structure.number_of_capsules,
        )
    )
    for arm in range(structure.number_of_arms):
        for capsule, link in enumerate(structure.capsule_links):
            moves[arm, :link, arm, capsule] = 1
    return moves.reshape(structure.number_of_joints, -1)


@lru_cache(maxsize=64)
def arm_row_signs(structure: WorkcellStructure) -> Float[np.ndarray, "joints arm_rows"]:
    """How a joint moves the first body of an arm row minus how it moves the second: 1, 0 or -1."""
    moves = capsule_motion(structure)
    first, second = capsule_pairs(structure)
    return np.concatenate(
        [moves[:, first] - moves[:, second], moves[:, table_capsules(structure)]], axis=1
    )


@lru_cache(maxsize=64)
def body_row_signs(
    structure: WorkcellStructure, number_of_objects: int, number_of_fixed: int
) -> tuple[Float[np.ndarray, "joints body_rows"], Float[np.ndarray, "objects body_rows"]]:
    """Signs of the body rows.

    Args:
        structure: Of the workcell.
        number_of_objects: Number N of objects.
        number_of_fixed: Number F of fixed bodies.

    Returns:
        How the arms' joints move the capsule of each row (0 where it has none), and for each object 1 in the rows whose
        first body it is, -1 in those whose second body it is.
    """
    N = number_of_objects
    bodies = N + number_of_fixed
    capsules = structure.number_of_arms * structure.number_of_capsules
    first, second = object_pairs(N, number_of_fixed)
    number = bodies * capsules + N + len(first)

    joints = np.zeros((structure.number_of_joints, number))
    joints[:, : bodies * capsules] = np.tile(capsule_motion(structure), bodies)

    role = np.zeros((N, number))
    for n in range(N):
        role[n, n * capsules : (n + 1) * capsules] = -1
        role[n, bodies * capsules + n] = 1
    for row, (i, j) in enumerate(zip(first, second, strict=True), start=bodies * capsules + N):
        role[i, row] = 1
        if j < N:
            role[j, row] = -1
    return joints, role


def number_of_rows(
    structure: WorkcellStructure, number_of_objects: int, number_of_fixed: int
) -> int:
    """Number P of all rows.

    Args:
        structure: Of the workcell.
        number_of_objects: Number N of objects.
        number_of_fixed: Number F of fixed bodies.
    """
    joints, _ = body_row_signs(structure, number_of_objects, number_of_fixed)
    return arm_row_signs(structure).shape[1] + joints.shape[1]


@lru_cache(maxsize=64)
def row_bodies(
    structure: WorkcellStructure, number_of_objects: int, number_of_fixed: int
) -> RowBodies:
    """What each row is about.

    Args:
        structure: Of the workcell.
        number_of_objects: Number N of objects.
        number_of_fixed: Number F of fixed bodies.
    """
    first, second = capsule_pairs(structure)
    on_table = len(table_capsules(structure))
    bodies = number_of_objects + number_of_fixed
    capsules = structure.number_of_arms * structure.number_of_capsules
    pairs = capsules * bodies
    others = number_of_objects + len(object_pairs(number_of_objects, number_of_fixed)[0])

    def none(rows: int) -> Int[np.ndarray, " rows"]:
        return np.full(rows, -1)

    return RowBodies(
        first_capsule=np.concatenate(
            [first, none(on_table), np.tile(np.arange(capsules), bodies), none(others)]
        ),
        second_capsule=np.concatenate([second, none(on_table + pairs + others)]),
        capsule_body_pair=np.concatenate(
            [none(len(first) + on_table), np.arange(pairs), none(others)]
        ),
        other_row=np.concatenate(
            [none(len(first)), np.arange(on_table), none(pairs), on_table + np.arange(others)]
        ),
    )
