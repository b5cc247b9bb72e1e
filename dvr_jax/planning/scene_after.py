"""The scene that a plan leaves behind: objects where its motion ends, moved apart so that the scene is valid.

The check of a motion accepts contacts that are a few millimeters deep, while objects of a valid scene do not overlap.
So the objects that the plan has moved are shifted by the least translation that parts them, one overlap after the
other, until none is left (projections onto the constraints in turn, as in position-based dynamics: M. Mueller et al.,
"Position based dynamics", 2007). Objects that the plan has not touched stay exactly where they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError, MotionError
from dvr_jax.geometry.footprint import Circle, Footprint, signed_distance
from dvr_jax.goals import TABLE
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import Parameter, ground_scene, object_of, operator_of
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.scene.validation import validate_scene
from dvr_jax.scene.workcell_rules import base_footprints, base_height

if TYPE_CHECKING:
    from dvr_jax.planning.result import Plan

LARGEST_SHIFT = 0.01
"""Longest way by which an object may be moved to part it from others [m]; the check accepts contacts of 1 mm."""

CLEARANCE = 1e-7
"""Distance to which overlapping objects are parted [m]: more than validation's rounding, less than anybody sees."""

SWEEPS = 200
"""Most passes over all pairs; a pair that is parted may meet a third object, so one pass is not always enough."""

Vector = NDArray[np.float64]
"""A vector (2,) in the plane of the table [m]."""


@dataclass(slots=True)
class _Item:
    """A footprint that may or may not be moved, and the interval of heights in which the body has it [m]."""

    footprint: Footprint
    movable: bool
    low: float
    high: float

    def move(self, shift: Vector) -> None:
        """Move the footprint by a vector."""
        x, y = np.add(self.footprint.center, shift).tolist()
        self.footprint = replace(self.footprint, center=(x, y))


def scene_after(plan: Plan) -> Scene:
    """Return the valid scene that a solved plan leaves behind.

    Raises:
        MotionError: The plan is not solved, an object is still held at its end, or objects overlap by more than the
            tolerances allow.
    """
    if plan.motion is None:
        raise MotionError(
            f"the plan has no motion (its status: {plan.status}); only a solved plan has a scene after it."
        )
    _require_empty_hands(plan)

    moved = {object_of(action, plan.operators) for action in plan.actions}
    placed = replace(plan.scene, objects=_objects_on_supports(plan))
    final_objects = _objects_of_state(placed, plan.motion.qpos[-1], moved)
    shifted_objects = _part_objects(plan.scene, final_objects, moved)
    scene = replace(plan.scene, objects=shifted_objects)

    for before, after in zip(final_objects, shifted_objects, strict=True):
        shift = math.dist(before.position, after.position)
        if shift > LARGEST_SHIFT:
            raise MotionError(
                f"at the end of the motion {before.name!r} overlaps its surroundings: it would have to move by "
                f"{shift:.3g} m; valid is at most {LARGEST_SHIFT} m."
            )

    try:
        validate_scene(scene)
    except DvrError as error:
        raise MotionError(f"the scene at the end of the motion is not valid: {error}") from None

    return scene


def _require_empty_hands(plan: Plan) -> None:
    """Refuse a plan after which an arm still holds an object, because a scene has no held objects."""
    grounding = ground_scene(plan.scene, plan.operators)
    final_state = grounding.apply(plan.actions)[-1]

    for predicate, *arguments in grounding.facts_in(final_state):
        if predicate == "holding":
            arm, name = arguments
            raise MotionError(
                f"the {arm} arm still holds {name!r} at the end of the plan; a scene has standing objects only."
            )


def _objects_on_supports(plan: Plan) -> tuple[SceneObject, ...]:
    """Return the scene's objects with the bodies on which they stand after the plan."""
    supports = {item.name: item.support for item in plan.scene.objects}
    for action in plan.actions:
        operator = operator_of(action, plan.operators)
        if operator.mode_after == ModeKind.PLACED:
            place = operator.argument(action, Parameter.SUPPORT)
            supports[object_of(action, plan.operators)] = plan.scene.supports()[place].owner
    return tuple(replace(item, support=supports[item.name]) for item in plan.scene.objects)


def _objects_of_state(
    scene: Scene, qpos: NDArray[np.float64], moved: set[str]
) -> tuple[SceneObject, ...]:
    """Return the scene's objects, those that were moved upright at the x, y and yaw of a state (nq,)."""
    columns = qpos_layout(scene).objects
    objects = []

    for item, indices in zip(scene.objects, columns, strict=True):
        if item.name not in moved:
            objects.append(item)
            continue
        x, y, _, *quaternion = qpos[indices].tolist()
        objects.append(replace(item, position=(x, y), yaw=_yaw_of(*quaternion)))

    return tuple(objects)


def _yaw_of(w: float, x: float, y: float, z: float) -> float:
    """Return the yaw of a unit quaternion [rad]: the turn about the vertical of a Z-Y-X rotation."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _part_objects(
    scene: Scene, objects: tuple[SceneObject, ...], moved: set[str]
) -> tuple[SceneObject, ...]:
    """Shift objects that were moved until they overlap neither each other, nor others, nor the arms' feet."""
    tops: dict[str, Footprint] = {TABLE: scene.workcell.table.footprint}
    tops |= {body.name: body.footprint for body in scene.fixed}
    items = [
        _Item(
            item.footprint,
            item.name in moved,
            bottom := scene.bottom_of(item),
            bottom + item.height,
        )
        for item in objects
    ]
    obstacles = _obstacles(scene)

    for _ in range(SWEEPS):
        changed = False
        for item, standing in zip(items, objects, strict=True):
            changed |= _move_onto_top(item, tops[standing.support])
        for first, second in combinations([*items, *obstacles], 2):
            changed |= _part(first, second)
        if not changed:
            break

    # Footprint and object have the same center. A footprint that was not moved keeps it to the last bit.
    return tuple(
        replace(item, position=shifted.footprint.center)
        for item, shifted in zip(objects, items, strict=True)
    )


def _part(first: _Item, second: _Item) -> bool:
    """Part two footprints that overlap by the least translation, and say whether one was moved."""
    if min(first.high, second.high) <= max(first.low, second.low):
        return False
    distance = signed_distance(first.footprint, second.footprint)
    if distance >= 0 or not (first.movable or second.movable):
        return False

    # The gradient of the signed distance with respect to the first footprint's center points along the least
    # translation that parts the two, and has the length 1.
    way = (CLEARANCE - distance) * _gradient(first.footprint, second.footprint)

    if first.movable and second.movable:
        first.move(way / 2)
        second.move(-way / 2)
    elif first.movable:
        first.move(way)
    else:
        second.move(-way)

    return True


def _gradient(first: Footprint, second: Footprint, step: float = 1e-7) -> Vector:
    """Return the unit gradient (2,) of the signed distance with respect to the first center, by central differences."""
    gradient = np.zeros(2)

    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead = replace(first, center=tuple(np.add(first.center, shift)))
        behind = replace(first, center=tuple(np.subtract(first.center, shift)))
        gradient[axis] = signed_distance(ahead, second) - signed_distance(behind, second)

    length = float(np.hypot(gradient[0], gradient[1]))
    # Concentric footprints have no preferred direction.
    return gradient / length if length > 0 else np.array([1.0, 0.0])


def _move_onto_top(item: _Item, top: Footprint) -> bool:
    """Move a footprint that reaches over the border of a top back onto it, and say whether it was moved.

    On a round top, validation alone decides whether the footprint reaches over the border by too much.
    """
    if not item.movable or isinstance(top, Circle):
        return False

    if isinstance(item.footprint, Circle):
        reach = np.full(2, item.footprint.radius)
    else:
        offsets = item.footprint.corners() - item.footprint.center
        reach = np.abs(offsets @ top.axes().T).max(axis=0)

    room = np.maximum(np.asarray(top.half) - reach, 0)
    local = top.axes() @ np.subtract(item.footprint.center, top.center)
    shift = (np.clip(local, -room, room) - local) @ top.axes()
    if not shift.any():
        return False

    item.move(shift)
    return True


def _obstacles(scene: Scene) -> list[_Item]:
    """Return what objects may not overlap: the arms' feet, and the fixed bodies."""
    workcell = scene.workcell
    height = base_height(workcell.robot)
    feet = [part for arm in workcell.arms for part in base_footprints(arm, workcell.robot)]
    return [
        *(_Item(foot, movable=False, low=0.0, high=height) for foot in feet),
        *(_Item(body.footprint, False, body.bottom, body.top) for body in scene.fixed),
    ]
