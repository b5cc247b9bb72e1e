"""Signed distances of everything that can touch in one slice, with their Jacobians.

Rows, in this order (C capsules an arm, N objects):

1. arm capsule against arm capsule (`arm_pairs`: both arms, and within one arm what can reach each other),
2. arm capsule against the table (`TABLE_CAPSULES`),
3. arm capsule (2 C, arm 0 first) against each object, object after object,
4. object against the table, N rows,
5. object against object, N (N - 1) / 2 rows.

A row that does not count in a phase (an object and the hand that holds it, two objects that stand still since the scene's start, an
absent object) has the distance `FAR` and a zero Jacobian.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.distances import capsule_capsule, capsule_plane, capsule_prism, prism_plane, prism_prism
from dvr_jax.komo.modes import ObjectPoses
from dvr_jax.komo.problem import ABSENT, FIXED, HELD_LEFT
from dvr_jax.robot.kinematics import load_arm
from dvr_jax.scene.workspace import NUMBER_OF_JOINTS

FAR = 1.0
"""Distance [m] given to rows that do not count."""

TABLE_CAPSULES = ("forearm", "wrist", "flange", "hand", "finger_left", "finger_right")
"""Capsules that can reach the table; the upper arm and the elbow cannot within the joint limits."""

HOLDING_CAPSULES = ("hand", "finger_left", "finger_right")
"""Capsules that touch the object which their arm holds."""

_SELF_PAIRS = (
    ("column", ("wrist", "flange", "hand", "finger_left", "finger_right")),
    ("upper_arm", ("wrist", "flange", "hand", "finger_left", "finger_right")),
    ("forearm", ("hand", "finger_left", "finger_right")),
    ("elbow", ("flange", "hand", "finger_left", "finger_right")),
)
_CROSS_PAIRS_OUT_OF_REACH = ("column", "upper_arm", "elbow")


class Contacts(NamedTuple):
    """Signed distances of one slice and their Jacobians; P rows."""

    distance: Array
    """(P,) signed distance [m]."""
    jacobian_q: Array
    """(14, P) derivative with respect to the joint angles [m/rad]."""
    jacobian_m: Array
    """(4, N, P) derivative with respect to the mode parameters that each object depends on."""


@lru_cache(maxsize=1)
def arm_pairs() -> np.ndarray:
    """(2, P1) indices of capsule pairs, over the 2 C capsules of both arms."""
    names = load_arm().capsule_names
    C = len(names)
    pairs = []
    for i, j in ((i, j) for i in range(C) for j in range(C)):
        # With bases 1.2 m apart the column, upper arm and elbow of one arm cannot meet those of the other.
        if names[i] in _CROSS_PAIRS_OUT_OF_REACH and names[j] in _CROSS_PAIRS_OUT_OF_REACH:
            continue
        if "column" in (names[i], names[j]):
            continue
        pairs.append((i, C + j))
    for near, others in _SELF_PAIRS:
        for other in others:
            pairs += [(arm * C + names.index(near), arm * C + names.index(other)) for arm in range(2)]
    return np.array(pairs).T


@lru_cache(maxsize=1)
def table_capsules() -> np.ndarray:
    """(P2,) indices, over the 2 C capsules, of those that can reach the table."""
    names = load_arm().capsule_names
    return np.array([arm * len(names) + names.index(name) for arm in range(2) for name in TABLE_CAPSULES])


@lru_cache(maxsize=1)
def _holding() -> np.ndarray:
    """(2 C, 2): 1 where a capsule touches what arm a holds."""
    names = load_arm().capsule_names
    C = len(names)
    mask = np.zeros((2 * C, 2))
    for arm in range(2):
        for name in HOLDING_CAPSULES:
            mask[arm * C + names.index(name), arm] = 1
    return mask


@lru_cache(maxsize=1)
def _moves() -> np.ndarray:
    """(14, 2 C): 1 where a joint moves a capsule."""
    links = load_arm().capsule_links
    C = len(links)
    mask = np.zeros((2 * NUMBER_OF_JOINTS, 2 * C))
    for arm in range(2):
        for c, link in enumerate(links):
            mask[arm * NUMBER_OF_JOINTS : arm * NUMBER_OF_JOINTS + link, arm * C + c] = 1
    return mask


def number_of_rows(number_of_objects: int) -> int:
    """Number P of rows with N objects."""
    N = number_of_objects
    return arm_pairs().shape[1] + len(table_capsules()) + 2 * load_arm().number_of_capsules * N + N + N * (N - 1) // 2


def slice_distances(
    a: Array, b: Array, objects: ObjectPoses, half: Array, attachment: Array
) -> tuple[Array, Array]:
    """Signed distances ``(P,)`` [m] and contact wrenches ``(6, P)`` of one slice.

    Args:
        a, b: (3, 2 C) ends of the capsules.
        half: (N, 4) shapes of the objects.
        attachment: (N,) how each is attached.
    """
    radii = jnp.asarray(np.tile(load_arm().capsule_radii, 2), a.dtype)
    N, C2 = attachment.shape[0], a.shape[1]
    i, j = arm_pairs()
    groups = [capsule_capsule(a[:, i], b[:, i], radii[i], a[:, j], b[:, j], radii[j])]
    t = table_capsules()
    groups.append(capsule_plane(a[:, t], b[:, t], radii[t]))

    absent = attachment == ABSENT
    shapes = half.T
    grid = (N, C2)
    distance, wrench = capsule_prism(
        jnp.broadcast_to(a[:, None], (3, *grid)),
        jnp.broadcast_to(b[:, None], (3, *grid)),
        jnp.broadcast_to(radii, grid),
        jnp.broadcast_to(objects.R[..., None], (3, 3, *grid)),
        jnp.broadcast_to(objects.p[..., None], (3, *grid)),
        jnp.broadcast_to(shapes[..., None], (4, *grid)),
    )
    touching = jnp.einsum("ca,an->nc", jnp.asarray(_holding(), a.dtype), objects.held) > 0
    ignored = touching | absent[:, None]
    groups.append((jnp.where(ignored, FAR, distance).reshape(-1), jnp.where(ignored, 0, wrench).reshape(6, -1)))

    distance, wrench = prism_plane(objects.R, objects.p, shapes)
    held = attachment >= HELD_LEFT
    groups.append((jnp.where(held, distance, FAR), jnp.where(held, wrench, 0)))

    if N > 1:
        first, second = np.array(list(combinations(range(N), 2))).T
        distance, wrench = prism_prism(
            objects.R[:, :, first], objects.p[:, first], shapes[:, first],
            objects.R[:, :, second], objects.p[:, second], shapes[:, second],
        )  # fmt: skip
        still = (attachment == FIXED)[first] & (attachment == FIXED)[second]
        ignored = absent[first] | absent[second] | still
        groups.append((jnp.where(ignored, FAR, distance), jnp.where(ignored, 0, wrench)))
    return jnp.concatenate([g[0] for g in groups]), jnp.concatenate([g[1] for g in groups], axis=1)


def slice_contacts(
    a: Array, b: Array, screws: Array, objects: ObjectPoses, half: Array, attachment: Array
) -> Contacts:
    """Signed distances of one slice with Jacobians; arguments as `slice_distances`.

    Args:
        screws: (6, 14) world twists of the joints.
    """
    distance, wrench = slice_distances(a, b, objects, half, attachment)
    N, C2 = attachment.shape[0], a.shape[1]
    P = distance.shape[0]
    moves = _moves()
    i, j = arm_pairs()
    t = table_capsules()
    # sign[k, p]: how joint k moves the first body of row p minus how it moves the second.
    static = np.concatenate([moves[:, i] - moves[:, j], moves[:, t], np.tile(moves, N), np.zeros((14, P - len(i) - len(t) - N * C2))], axis=1)  # noqa: E501
    role = object_roles(N)
    moved = jnp.repeat(objects.held, NUMBER_OF_JOINTS, axis=0)
    sign = jnp.asarray(static, distance.dtype) + moved @ jnp.asarray(role, distance.dtype)
    jacobian_q = sign * jnp.einsum("ck,cp->kp", screws, wrench)
    per_object = jnp.einsum("cjn,cp->jnp", objects.twists, wrench)
    return Contacts(distance, jacobian_q, per_object * jnp.asarray(role, distance.dtype))


@lru_cache(maxsize=8)
def object_roles(number_of_objects: int) -> np.ndarray:
    """(N, P): +1 where object n is the first body of row p, -1 where it is the second, else 0."""
    N, C2 = number_of_objects, 2 * load_arm().number_of_capsules
    role = np.zeros((N, number_of_rows(N)))
    start = arm_pairs().shape[1] + len(table_capsules())
    for n in range(N):
        role[n, start + n * C2 : start + (n + 1) * C2] = -1
        role[n, start + N * C2 + n] = 1
    for row, (first, second) in enumerate(combinations(range(N), 2)):
        role[first, start + N * C2 + N + row] = 1
        role[second, start + N * C2 + N + row] = -1
    return role
