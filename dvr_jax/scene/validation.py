"""When a scene is valid: every rule that a scene must hold, each with a message for whoever broke it.

Rules: 1 to 8 objects with unique names of no brackets or commas, finite numbers, positive sizes, everything on the
table, no two objects overlapping, none on an arm's base, a goal that names an object and can hold it, home
postures of seven angles within the limits.
"""

import math
from collections.abc import Sequence
from itertools import combinations

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Circle, Rectangle, fits, inside, signed_distance
from dvr_jax.scene.types import DEFAULT_HOME, Goal, Home, Scene, SceneObject
from dvr_jax.workcell.constants import (
    ARM_NAMES,
    BASE_LENGTH,
    BASE_POSITIONS,
    BASE_RADIUS,
    BASE_WIDTH,
    BASE_YAWS,
    JOINT_LOWER,
    JOINT_UPPER,
    MAXIMUM_OBJECTS,
    NUMBER_OF_JOINTS,
    TABLE_HALF_EXTENTS,
)

TABLE_FOOTPRINT = Rectangle((0.0, 0.0), TABLE_HALF_EXTENTS, 0.0)
"""The table's top."""

OVERLAP_TOLERANCE = 1e-9
"""Footprints may overlap by this much (m): objects that touch exactly are valid in spite of rounding."""

RESERVED = "(),"
"""Characters that no name has: actions are written as "place(left, yellow, goal)"."""

SMALLEST_SIZE, LARGEST_SIZE = 1e-3, 2.0
"""Nothing is thinner than this (m): below, the physics and the distances lose their meaning. Nor larger: the camera
hangs above."""

LARGEST_YAW = 1e3
"""Turns beyond this (rad) are no angles."""


def make_scene(objects: Sequence[SceneObject], goal: Goal, home: Home = DEFAULT_HOME) -> Scene:
    """The valid scene of these parts; DvrError when they break a rule."""
    scene = Scene(tuple(objects), goal, home)
    validate_scene(scene)
    return scene


def validate_scene(scene: Scene) -> None:
    """Raise a DvrError that names the first broken rule, or return."""
    if not 1 <= len(scene.objects) <= MAXIMUM_OBJECTS:
        raise DvrError(f"the scene has {len(scene.objects)} objects; valid are 1 to {MAXIMUM_OBJECTS}.")
    _validate_names(scene)
    for item in scene.objects:
        _validate_object(item)
    _validate_goal(scene.goal)
    for first, second in combinations(scene.objects, 2):
        depth = -signed_distance(first.footprint, second.footprint)
        if depth > OVERLAP_TOLERANCE:
            raise DvrError(f"the objects {first.name!r} and {second.name!r} overlap by {depth:.3g} m; move them apart.")
    _validate_room(scene)
    _validate_home(scene.home)


def _validate_names(scene: Scene) -> None:
    names = [item.name for item in scene.objects]
    for name in names:
        if not isinstance(name, str) or not name:
            raise DvrError(f"an object's name is {name!r}; a name is a text of at least one character.")
        if set(name) & set(RESERVED) or name != name.strip():
            raise DvrError(
                f"an object's name is {name!r}; a name has none of {' '.join(RESERVED)}, no blanks around it."
            )
        if names.count(name) > 1:
            raise DvrError(f"{names.count(name)} objects are called {name!r}; each name may occur once.")
    if scene.goal.object not in names:
        raise DvrError(f"the goal's object is {scene.goal.object!r}; the scene has {', '.join(map(repr, names))}.")


def _validate_object(item: SceneObject) -> None:
    what = f"the object {item.name!r}"
    counts = {"box": 3, "cylinder": 2}
    if item.shape not in counts:
        raise DvrError(f"{what} has the shape {item.shape!r}; valid are 'box' and 'cylinder'.")
    _validate_numbers(f"the size of {what}", item.size, counts[item.shape], (SMALLEST_SIZE, LARGEST_SIZE), "m")
    _validate_numbers(f"the position of {what}", item.position, 2)
    _validate_numbers(f"the yaw of {what}", (item.yaw,), 1, (-LARGEST_YAW, LARGEST_YAW), "rad")
    if not inside(item.footprint, TABLE_FOOTPRINT):
        raise DvrError(f"{what} at {_format(item.position)} reaches off the table, whose top is {_table_in_words()}.")
    for arm, base, yaw in zip(ARM_NAMES, BASE_POSITIONS, BASE_YAWS, strict=True):
        middle = (base[0] - BASE_LENGTH / 2 * math.cos(yaw), base[1] - BASE_LENGTH / 2 * math.sin(yaw))
        plate = Rectangle(middle, (BASE_LENGTH / 2, BASE_WIDTH / 2), yaw)
        if (
            min(signed_distance(item.footprint, part) for part in (Circle(base, BASE_RADIUS), plate))
            < -OVERLAP_TOLERANCE
        ):
            raise DvrError(
                f"{what} at {_format(item.position)} overlaps the {arm} arm's base, {BASE_RADIUS} m around "
                f"{_format(base)} and {BASE_LENGTH} m behind it; move it away."
            )


def _validate_goal(goal: Goal) -> None:
    _validate_numbers("the goal region's size", goal.region.size, 2, (SMALLEST_SIZE, math.inf), "m")
    _validate_numbers("the goal region's position", goal.region.position, 2)
    _validate_numbers("the goal region's yaw", (goal.region.yaw,), 1, (-LARGEST_YAW, LARGEST_YAW), "rad")
    if not inside(goal.region.footprint, TABLE_FOOTPRINT):
        raise DvrError(
            f"the goal region at {_format(goal.region.position)} reaches off the table, "
            f"whose top is {_table_in_words()}."
        )


def _validate_room(scene: Scene) -> None:
    item, sides = scene.objects[scene.goal_index], scene.goal.region.size
    if not fits(item.footprint, (sides[0] + OVERLAP_TOLERANCE, sides[1] + OVERLAP_TOLERANCE)):
        raise DvrError(
            f"the goal region of {_format(sides)} m cannot hold {item.name!r}, whose size is {_format(item.size)} m, "
            "however it is turned; make it larger."
        )


def _validate_home(home: Home) -> None:
    if len(home) != len(ARM_NAMES):
        raise DvrError(f"the home has {len(home)} postures; valid is one for each of the arms {', '.join(ARM_NAMES)}.")
    for arm, posture in zip(ARM_NAMES, home, strict=True):
        _validate_numbers(f"the {arm} arm's home", posture, NUMBER_OF_JOINTS)
        for joint, (angle, lower, upper) in enumerate(zip(posture, JOINT_LOWER, JOINT_UPPER, strict=True), start=1):
            if not lower <= angle <= upper:
                raise DvrError(f"joint {joint} of the {arm} arm's home is {angle:g} rad; valid is {lower} to {upper}.")


def _validate_numbers(
    what: str,
    values: Sequence[float],
    count: int,
    within: tuple[float, float] = (-math.inf, math.inf),
    unit: str = "",
) -> None:
    """Finite numbers, `count` of them, none outside of these bounds."""
    if len(values) != count:
        raise DvrError(f"{what} is {_format(values)}, {len(values)} numbers; valid are {count}.")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise DvrError(f"{what} is {_format(values)}; valid are finite numbers.")
        if not within[0] <= value <= within[1]:
            most = f" and at most {within[1]:g}" if math.isfinite(within[1]) else ""
            raise DvrError(f"{what} is {_format(values)}; valid is at least {within[0]:g}{most} {unit}.")


def _format(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value:g}" if isinstance(value, float) else repr(value) for value in values) + ")"


def _table_in_words() -> str:
    x, y = TABLE_HALF_EXTENTS
    return f"x in [-{x}, {x}], y in [-{y}, {y}]"
