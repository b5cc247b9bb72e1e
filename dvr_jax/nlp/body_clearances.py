"""Clearances that depend on the sequence: of hands from objects, of held objects from the table, and of two bodies.

A phase has three parts (`PhasePart`), because a hand comes close to an object, and an object to its support, only near
the switch in which it is grasped or placed. Rows of one part, for A arms, N objects and F fixed bodies, in this order:

- each hand from each object, arm after arm (A N);
- each object from the table (N);
- two objects, and an object and a fixed body, in the order of `dvr_jax.nlp.collision_rows.object_pairs`. An object
  touches the body on which it stands, and comes close to it when it is placed or was just grasped.

`dvr_jax.workcell.clearances` states the values, and by which rules they shrink.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.footprint import signed_distance
from dvr_jax.goals import TABLE
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.collision_rows import object_pairs
from dvr_jax.operators import NO_BODY, ModeSwitch, SkeletonState
from dvr_jax.scene.types import FixedBody, Scene, SceneObject
from dvr_jax.workcell.clearances import GRIP_ROOM, LIFT_MARGIN

STANDING_ROOM = 1e-3
"""A standing object may overlap the body on which it stands by this much without a violation [m]: the two touch, and
rounding must not make their distance an active row."""


class PhasePart(IntEnum):
    """The part of a phase to which a clearance applies."""

    START = 0
    """Shortly after the switch that the phase begins with."""

    MIDDLE = 1
    """Away from all switches."""

    END = 2
    """Shortly before the switch that the phase ends with, and at this switch."""


def body_clearances(
    scene: Scene, states: Sequence[SkeletonState], switches: Sequence[ModeSwitch]
) -> Float[np.ndarray, "states parts rows"]:
    """Return the clearances of all parts of all phases of a sequence, and of the time after it [m].

    Args:
        scene: A valid scene.
        states: The K + 1 states before, between and after the actions.
        switches: The K mode switches.
    """
    arms = scene.workcell.number_of_arms
    objects = len(scene.objects)
    clearances = scene.workcell.clearances
    hands = np.full((len(states), len(PhasePart), arms, objects), clearances.hand_to_object)
    lift = np.zeros((len(states), len(PhasePart), objects))
    height = clearances.lift + LIFT_MARGIN if clearances.lift > 0 else 0.0
    for k, state in enumerate(states):
        for n, mode in enumerate(state.modes):
            if mode.kind == ModeKind.HELD:
                lift[k, :, n] = height

    for k, switch in enumerate(switches):
        item = switch.item
        old = states[k].modes[item]
        new = states[k + 1].modes[item]
        if new.kind == ModeKind.HELD:
            # The hand that grasps comes as near as the width of the object demands.
            room = _grip_clearance(scene, item, switch.closing_yaw)
            hands[k, PhasePart.END, new.parent, item] = room
        else:
            lift[k, PhasePart.END, item] = 0

        if old.kind == ModeKind.HELD:
            # The hand that releases the object leaves it from as near.
            room = _grip_clearance(scene, item, _closing_yaw(switches[:k], item))
            hands[k + 1, PhasePart.START, old.parent, item] = room
        else:
            # An object that stood before its grasp may be near its support right after it.
            lift[k + 1, PhasePart.START, item] = 0

    parts = lift.shape[:2]
    of_pairs = _pairs_in_parts(scene, states, switches)
    return np.concatenate([hands.reshape(*parts, -1), lift, of_pairs], axis=2)


def _pairs_in_parts(
    scene: Scene, states: Sequence[SkeletonState], switches: Sequence[ModeSwitch]
) -> Float[np.ndarray, "states parts pairs"]:
    """Return the clearances of pairs of bodies in all parts of all phases [m]."""
    first, second = object_pairs(len(scene.objects), len(scene.fixed))
    number = {
        pair: row for row, pair in enumerate(zip(first.tolist(), second.tolist(), strict=True))
    }
    found = np.tile(_pair_clearances(scene), (len(states), len(PhasePart), 1))

    for k, state in enumerate(states):
        for n, mode in enumerate(state.modes):
            if mode.support != NO_BODY:
                found[k, :, number[_pair(n, mode.support)]] = -STANDING_ROOM

    for k, switch in enumerate(switches):
        old = states[k].modes[switch.item]
        new = switch.mode
        if old.support != NO_BODY:
            found[k + 1, PhasePart.START, number[_pair(switch.item, old.support)]] = 0
        if new.support != NO_BODY:
            found[k, PhasePart.END, number[_pair(switch.item, new.support)]] = 0
    return found


def _pair(item: int, support: int) -> tuple[int, int]:
    """Return the bodies of an object and its support in the order of `object_pairs`."""
    return min(item, support), max(item, support)


def _closing_yaw(switches: Sequence[ModeSwitch], item: int) -> float:
    """Return the yaw of the closing axis of the last switch of an object [rad]."""
    return next(switch.closing_yaw for switch in reversed(switches) if switch.item == item)


def _grip_clearance(scene: Scene, item: int, closing_yaw: float) -> float:
    """Return the clearance of a hand from an object that it grasps or releases; negative only by the pads' overhang."""
    robot = scene.workcell.robot
    body = scene.objects[item]
    hx, hy, _, radius = body.kind.prism(body.size)
    half_width = abs(np.cos(closing_yaw)) * hx + abs(np.sin(closing_yaw)) * hy + radius
    room = robot.maximum_opening / 2 - half_width - robot.pad_overhang - GRIP_ROOM
    return float(np.clip(room, -robot.pad_overhang, scene.workcell.clearances.hand_to_object))


@lru_cache(maxsize=64)
def _pair_clearances(scene: Scene) -> Float[np.ndarray, " pairs"]:
    """Return the clearances of two objects, and of an object and a fixed body [m]; they are kept and shared."""
    pairs: list[tuple[SceneObject, SceneObject | FixedBody]] = [
        *combinations(scene.objects, 2),
        *product(scene.objects, scene.fixed),
    ]
    wanted = scene.workcell.clearances.object_to_object
    found = []
    for item, other in pairs:
        # An object that is lifted off its support keeps the whole clearance thereafter.
        stands_on_it = TABLE != item.support == other.name or _stands_on(other, item)
        distance = wanted if stands_on_it else _distance(scene, item, other)
        found.append(np.clip(distance, 0, wanted))
    clearances = np.array(found)
    clearances.flags.writeable = False
    return clearances


def _stands_on(body: SceneObject | FixedBody, item: SceneObject) -> bool:
    """Return whether a body is an object that stands on another one at the start."""
    return isinstance(body, SceneObject) and TABLE != body.support == item.name


def _distance(scene: Scene, item: SceneObject, other: SceneObject | FixedBody) -> float:
    """Return a lower bound of the distance of two bodies at the start [m]; negative if they overlap."""
    horizontal = signed_distance(item.footprint, other.footprint)
    low, high = _heights(scene, item)
    other_low, other_high = _heights(scene, other)
    return max(horizontal, other_low - high, low - other_high)


def _heights(scene: Scene, body: SceneObject | FixedBody) -> tuple[float, float]:
    """Return the heights of the bottom and of the top of a body at the start [m]."""
    if isinstance(body, FixedBody):
        return body.bottom, body.top
    bottom = scene.bottom_of(body)
    return bottom, bottom + body.height
