"""The pairs of bodies of a motion whose distances count, by kind, with the states in which they belong to the kind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, product
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.bench.motion_states import MotionStates
from dvr_jax.bench.robot_meshes import PANDA_MESHES, coal_shape, panda_bodies
from dvr_jax.scene.mjcf import fixed_body_name, object_body_name
from dvr_jax.workcell.robot import FINGERS

HAND_BODIES = ("hand", *FINGERS)
"""Bodies of a hand."""

STANDING_LINKS = ("base", "link1")
"""Links that stand on the table or always keep their height above it."""


class PairKind(StrEnum):
    """A kind of pair of bodies."""

    HAND_OBJECT = "hand and object"
    """Hand or finger, and an object that the hand neither holds nor grasps or releases, or a fixed body."""

    LINK_OBJECT = "link and object"
    """Any other link, and an object or a fixed body."""

    ARM_ARM = "arm and arm"
    """Links, hands and fingers of two arms."""

    LINK_TABLE = "link and table"
    """Link above the table; the base and the first link stand on it."""

    HAND_TABLE = "hand and table"
    """Hand or finger, and the table."""

    OBJECT_OBJECT = "object and object"
    """Two objects of which one at least was grasped, or such an object and a fixed body."""

    OBJECT_TABLE = "held object and table"
    """Object that is held, and the table, also where the object is lifted or put down."""

    PALM_GRASP = "palm and grasped object"
    """Hand without its fingers, and an object that it holds, comes to, or leaves."""

    FINGER_GRASP = "finger and grasped object"
    """Finger, and an object that its hand holds, comes to, or leaves. Pads touch what they hold."""


GRASPS = (PairKind.FINGER_GRASP,)
"""Kinds of pairs that touch in a grasp and therefore do not count as penetrations."""


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body of a scene in all states of a motion."""

    name: str
    """Name in the scene's MuJoCo model."""

    shape: Any
    """Collision geometry of `coal` in the frame of the body."""

    positions: Float[np.ndarray, "samples 3"]
    """Origin of its frame in the world [m]."""

    rotations: Float[np.ndarray, "samples 3 3"]
    """Rotation of its frame in the world."""

    travel: Float[np.ndarray, " samples"]
    """Bound of the way of any of its points since the first state [m]."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two bodies, and the states in which their distance belongs to a kind."""

    kind: PairKind
    """The kind."""

    first: Body
    """One body."""

    second: Body
    """The other one."""

    valid: Bool[np.ndarray, " samples"]
    """The states."""


def make_body(
    name: str,
    shape: Any,
    positions: Float[np.ndarray, "samples 3"],
    rotations: Float[np.ndarray, "samples 3 3"],
) -> Body:
    """Make a body, with the bound of the way of its points.

    A point at the distance r from the origin of the frame moves by at most ``|shift| + |turn| r / sqrt(2)``, with the
    Frobenius norm of the difference of two rotations.

    Args:
        name: Name of the body.
        shape: Geometry of `coal` in the frame of the body.
        positions: Origins of the frame [m].
        rotations: Rotations of the frame.
    """
    shape.computeLocalAABB()
    radius = float(np.linalg.norm(shape.aabb_center)) + float(shape.aabb_radius)
    shift = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    turn = np.linalg.norm(np.diff(rotations, axis=0), axis=(1, 2))
    travel = np.concatenate([[0.0], np.cumsum(shift + radius / np.sqrt(2) * turn)])
    return Body(name, shape, positions, rotations, travel)


def pairs_of_motion(states: MotionStates) -> Iterator[Pair]:
    """Give all pairs of the bodies of a scene that must not touch, and fingers with what they grasp."""
    scene = states.scene
    arms = [_arm_bodies(states, arm) for arm in scene.workcell.arm_names]
    objects = [
        make_body(name, coal_shape(item), *states.pose(name))
        for item in scene.objects
        for name in [object_body_name(item.name)]
    ]
    fixed = [
        make_body(name, coal_shape(body), *states.pose(name))
        for body in scene.fixed
        for name in [fixed_body_name(body.name)]
    ]
    always = np.ones(len(states.motion.time), bool)

    for number, bodies in enumerate(arms):
        yield from _pairs_with_objects(states, number, bodies, objects)
        for link, body in product(bodies, fixed):
            kind = PairKind.HAND_OBJECT if link in HAND_BODIES else PairKind.LINK_OBJECT
            yield Pair(kind, bodies[link], body, always)

    for first, second in combinations(arms, 2):
        for pair in product(first.values(), second.values()):
            yield Pair(PairKind.ARM_ARM, *pair, always)

    yield from _pairs_with_table(states, arms, objects)
    yield from _pairs_of_objects(states, objects, fixed)


def _arm_bodies(states: MotionStates, arm: str) -> dict[str, Body]:
    """Return the bodies of an arm by their names in the robot's MJCF, those of the hand first."""
    shapes = panda_bodies()
    order = [*HAND_BODIES, *(name for name in PANDA_MESHES if name not in HAND_BODIES)]
    return {
        name: make_body(f"{arm}/{name}", shapes[name], *states.pose(f"{arm}/{name}"))
        for name in order
    }


def _pairs_with_objects(
    states: MotionStates, arm: int, bodies: dict[str, Body], objects: list[Body]
) -> Iterator[Pair]:
    """Give the pairs of an arm and the objects.

    Args:
        states: The motion.
        arm: Number of the arm.
        bodies: Bodies of the arm.
        objects: Bodies of the objects.
    """
    always = np.ones(len(states.motion.time), bool)
    grasped = np.zeros((len(objects), len(always)), bool)
    for interval in states.holds(arm):
        grasped[interval.object] |= states.grasp_window(interval)

    for (name, link), (number, item) in product(bodies.items(), enumerate(objects)):
        if name not in HAND_BODIES:
            yield Pair(PairKind.LINK_OBJECT, link, item, always)
            continue
        kind = PairKind.FINGER_GRASP if name in FINGERS else PairKind.PALM_GRASP
        yield Pair(kind, link, item, grasped[number])
        yield Pair(PairKind.HAND_OBJECT, link, item, ~grasped[number])


def _pairs_with_table(
    states: MotionStates, arms: list[dict[str, Body]], objects: list[Body]
) -> Iterator[Pair]:
    """Give the pairs with the table.

    Args:
        states: The motion.
        arms: Bodies of the arms.
        objects: Bodies of the objects.
    """
    import coal

    top = states.scene.workcell.table
    sides = (2 * top.half_extents[0], 2 * top.half_extents[1], top.thickness)
    table = make_body("table", coal.Box(*sides), *states.pose("table"))
    always = np.ones(len(states.motion.time), bool)
    for bodies in arms:
        for name, link in bodies.items():
            if name not in STANDING_LINKS:
                kind = PairKind.HAND_TABLE if name in HAND_BODIES else PairKind.LINK_TABLE
                yield Pair(kind, link, table, always)

    for number, item in enumerate(objects):
        yield Pair(PairKind.OBJECT_TABLE, item, table, held_samples(states, number))


def _pairs_of_objects(
    states: MotionStates, objects: list[Body], fixed: list[Body]
) -> Iterator[Pair]:
    """Give the pairs of two objects, and of an object and a fixed body, since one of them was grasped.

    Args:
        states: The motion.
        objects: Bodies of the objects.
        fixed: Bodies that never move.
    """
    # Objects that nothing has moved stand as the scene has them.
    moved = [np.maximum.accumulate(held_samples(states, item)) for item in range(len(objects))]
    for first, second in combinations(range(len(objects)), 2):
        valid = moved[first] | moved[second]
        yield Pair(PairKind.OBJECT_OBJECT, objects[first], objects[second], valid)
    for number, body in product(range(len(objects)), fixed):
        yield Pair(PairKind.OBJECT_OBJECT, objects[number], body, moved[number])


def held_samples(states: MotionStates, item: int) -> Bool[np.ndarray, " samples"]:
    """Return at which samples any arm holds an object, with the one at which it is released.

    Args:
        states: The motion.
        item: Number of the object.
    """
    held = np.zeros(len(states.motion.time), bool)
    for interval in states.timeline.intervals:
        if interval.object == item and interval.holder is not None:
            held[interval.start : interval.end + 1] = True
    return held
