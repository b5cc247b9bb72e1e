"""Scenes as files: one JSON object a scene, or JSON Lines for many. This is the edge where input is refused.

The formats are described in `dvr_jax.scene.file_format`. The records of scenes are defined in `dvr_jax.scene.types` and
their rules in `dvr_jax.scene.validation`; both can be imported from here too.
"""

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import msgspec

from dvr_jax.errors import DvrError, SceneError
from dvr_jax.goals import TABLE, Goal, GoalFact, known_facts, make_fact, words_of
from dvr_jax.runtime.files import read_whole, require_writable, write_whole
from dvr_jax.scene.file_format import (
    ArmRecord,
    FactRecord,
    FixedRecord,
    GoalRecord,
    HomeRecord,
    NamedRegionRecord,
    ObjectRecord,
    RegionRecord,
    SceneRecord,
    SceneRecord1,
    SceneRecord2,
    TableRecord,
    WorkcellRecord,
    decode_scene,
    encode_scene,
)
from dvr_jax.scene.types import (
    USUAL_DENSITY,
    USUAL_FRICTION,
    FixedBody,
    OnRegion,
    Region,
    Scene,
    SceneObject,
)
from dvr_jax.scene.validation import make_scene, validate_scene
from dvr_jax.workcell.robot import Robot, robot_named
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Arm, Table, Workcell

__all__ = [
    "FixedBody",
    "OnRegion",
    "Region",
    "Scene",
    "SceneObject",
    "are_equal_but_for_rounding",
    "load_scene",
    "load_scenes",
    "make_scene",
    "save_scene",
    "save_scenes",
    "scene_from_json",
    "scene_to_json",
    "validate_scene",
]

LARGEST_SCENE = 1 << 24
"""Bytes of the largest file of one scene; a scene has a few kilobytes."""

ROUNDING = 1e-9
"""Numbers that differ by no more are the same [m, rad]."""


def scene_from_json(text: str | bytes, source: str = "scene") -> Scene:
    """Read the scene that a JSON text holds.

    Args:
        text: One JSON object.
        source: Where the text comes from, a file or a line; messages begin with it.

    Returns:
        The valid scene.

    Raises:
        SceneError: The text holds no valid scene; the message names what is wrong.
    """
    try:
        return _scene_of(decode_scene(text))
    except DvrError as error:
        raise SceneError(f"{source}: {error}") from None


def scene_to_json(scene: Scene) -> str:
    """Write a scene as one line of JSON, in version 1 of the format if that can say it, else in version 2.

    `scene_from_json` gives an equal scene back.

    Raises:
        SceneError: The scene's robot is not registered under its name, so no file could refer to it.
    """
    return encode_scene(_record_of(scene))


def load_scene(path: str | Path) -> Scene:
    """Read the scene of a JSON file.

    Raises:
        SceneError: The file holds no valid scene.
        OSError: The file cannot be read.
    """
    return scene_from_json(read_whole(path, LARGEST_SCENE), str(path))


def load_scenes(path: str | Path) -> tuple[Scene, ...]:
    """Read all scenes of a JSON Lines file, in their order; blank lines are skipped.

    Raises:
        SceneError: A line holds no valid scene (the message names file and line), or there is no scene at all.
        OSError: The file cannot be read.
    """
    lines = read_whole(path).split(b"\n")
    scenes = tuple(
        scene_from_json(line, f"{path}, line {number}")
        for number, line in enumerate(lines, start=1)
        if line.strip()
    )
    if not scenes:
        raise SceneError(f"{path} holds no scene; valid is one JSON object a line.")

    return scenes


def save_scene(path: str | Path, scene: Scene) -> None:
    """Write one scene as indented JSON.

    Args:
        path: File to write; replaced if it exists.
        scene: The scene.
    """
    text = msgspec.json.format(scene_to_json(scene), indent=2)
    write_whole(Path(path), (text + "\n").encode())


def save_scenes(path: str | Path, scenes: Iterable[Scene]) -> None:
    """Write scenes as JSON Lines; missing folders above the file are made.

    Args:
        path: File to write; replaced if it exists.
        scenes: The scenes.
    """
    path = Path(path)
    require_writable(path)
    write_whole(path, "".join(scene_to_json(scene) + "\n" for scene in scenes).encode())


def are_equal_but_for_rounding(first: Scene, second: Scene) -> bool:
    """Whether all numbers of two scenes agree to `ROUNDING` and all else is equal.

    Processors round the last bit of a sine differently, and so do scenes that are drawn of one seed.

    Args:
        first: One scene.
        second: The other one; their order does not matter.
    """
    ours = list(_leaves(first))
    theirs = list(_leaves(second))

    return len(ours) == len(theirs) and all(map(_equal_but_for_rounding, ours, theirs))


def _equal_but_for_rounding(first: object, second: object) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return abs(first - second) <= ROUNDING
    return first == second


def _leaves(part: object) -> Iterator[object]:
    """All numbers, names and robots of a scene, in order."""
    if isinstance(part, tuple):
        for child in part:
            yield from _leaves(child)
    elif is_dataclass(part) and not isinstance(part, Robot):
        for field in fields(part):
            yield from _leaves(getattr(part, field.name))
    else:
        yield part


def _scene_of(record: SceneRecord) -> Scene:
    """The valid scene of a record."""
    objects = [
        SceneObject(
            item.name,
            item.shape,
            item.size,
            item.position,
            item.yaw,
            USUAL_DENSITY if item.density is None else item.density,
            USUAL_FRICTION if item.friction is None else item.friction,
            TABLE if item.support is None else item.support,
        )
        for item in record.objects
    ]
    if isinstance(record, SceneRecord1):
        home = record.home or HomeRecord()
        return make_scene(objects, _paper_goal_of(record.goal), _workcell_of_home(home))

    goal: OnRegion | Goal
    if isinstance(record.goal, GoalRecord):
        goal = _paper_goal_of(record.goal)
    else:
        goal = Goal(tuple(map(_fact_of, record.goal)))

    workcell = DEFAULT_WORKCELL if record.workcell is None else _workcell_of(record.workcell)
    fixed = [
        FixedBody(body.name, body.shape, body.size, body.position, body.yaw)
        for body in record.fixed
    ]

    regions = [
        Region(item.position, item.yaw, item.size, item.name, item.support, item.inside)
        for item in record.regions
    ]

    return make_scene(objects, goal, workcell, fixed, regions)


def _paper_goal_of(record: GoalRecord) -> OnRegion:
    """The goal that is one object on a region of its own."""
    region = record.region
    return OnRegion(record.object, Region(region.position, region.yaw, region.size))


def _fact_of(words: FactRecord) -> GoalFact:
    """The fact that a list of words states."""
    known = known_facts()
    valid = ", ".join(str([keyword, *names]) for keyword, names in known.items())
    if not words:
        raise SceneError(f"the goal has an empty fact; valid are {valid}.")

    keyword, *arguments = words
    if keyword not in known or len(arguments) != len(known[keyword]):
        raise SceneError(f"the goal has the fact {list(words)}; valid are {valid}.")

    return make_fact(keyword, tuple(arguments))


def _workcell_of_home(home: HomeRecord) -> Workcell:
    """The usual workcell with these home postures."""
    if home == HomeRecord():
        return DEFAULT_WORKCELL

    postures = (home.left, home.right)

    return replace(
        DEFAULT_WORKCELL,
        arms=tuple(
            arm if posture is None else replace(arm, home=posture)
            for arm, posture in zip(DEFAULT_WORKCELL.arms, postures, strict=True)
        ),
    )


def _workcell_of(record: WorkcellRecord) -> Workcell:
    robot = robot_named(record.robot)
    arms = tuple(
        Arm(
            arm.name,
            arm.position,
            arm.yaw,
            robot.home if arm.home is None else arm.home,
        )
        for arm in record.arms
    )
    table = (
        Table()
        if record.table is None
        else Table(record.table.half_extents, record.table.thickness)
    )

    return Workcell(arms, robot, table)


def _record_of(scene: Scene) -> SceneRecord:
    objects = tuple(
        ObjectRecord(
            item.name,
            item.shape,
            item.size,
            item.position,
            item.yaw,
            None if item.density == USUAL_DENSITY else item.density,
            None if item.friction == USUAL_FRICTION else item.friction,
            None if item.support == TABLE else item.support,
        )
        for item in scene.objects
    )
    usual_homes = tuple(replace(arm, home=scene.workcell.robot.home) for arm in scene.workcell.arms)
    stands_as_usual = replace(scene.workcell, arms=usual_homes) == DEFAULT_WORKCELL
    is_paper_goal = isinstance(scene.goal, OnRegion) and not scene.regions
    if stands_as_usual and is_paper_goal and not scene.fixed:
        goal = _goal_record(scene.paper_goal)
        return SceneRecord1(1, objects, goal, _home_record(scene.workcell))

    fixed = tuple(
        FixedRecord(body.name, body.shape, body.size, body.position, body.yaw)
        for body in scene.fixed
    )
    workcell = None if scene.workcell == DEFAULT_WORKCELL else _workcell_record(scene.workcell)
    regions = tuple(
        NamedRegionRecord(
            region.name,
            region.position,
            region.yaw,
            region.size,
            region.support,
            region.inside,
        )
        for region in scene.regions
    )

    return SceneRecord2(2, objects, _goal_or_facts(scene), workcell, fixed, regions)


def _goal_or_facts(scene: Scene) -> GoalRecord | tuple[FactRecord, ...]:
    if isinstance(scene.goal, OnRegion):
        return _goal_record(scene.goal)
    return tuple(map(words_of, scene.goal.facts))


def _goal_record(goal: OnRegion) -> GoalRecord:
    region = goal.region
    return GoalRecord(goal.object, RegionRecord(region.position, region.yaw, region.size))


def _home_record(workcell: Workcell) -> HomeRecord | None:
    """The home postures that are not the usual one; None if there are none."""
    usual = workcell.robot.home
    postures = [None if arm.home == usual else arm.home for arm in workcell.arms]

    return None if postures == [None, None] else HomeRecord(*postures)


def _workcell_record(workcell: Workcell) -> WorkcellRecord:
    robot = workcell.robot
    try:
        registered = robot_named(robot.name)
    except DvrError:
        raise SceneError(
            f"no robot is registered as '{robot.name}', so a scene file cannot refer to this one; "
            "valid is a robot that register_robot has made known."
        ) from None
    if registered != robot:
        raise SceneError(
            f"another robot is registered as '{robot.name}'; a scene file cannot refer to this one."
        )

    arms = tuple(
        ArmRecord(
            arm.name,
            arm.position,
            arm.yaw,
            None if arm.home == robot.home else arm.home,
        )
        for arm in workcell.arms
    )
    table = workcell.table
    table_record = None if table == Table() else TableRecord(table.half_extents, table.thickness)

    return WorkcellRecord(robot.name, arms, table_record)
