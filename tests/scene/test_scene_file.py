"""Scene files: what goes out comes back, and whatever is wrong is refused in one sentence that names it."""

import copy
import json
import math
import os
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dvr_jax.errors import DvrError, SceneError
from dvr_jax.scene.files import (
    FixedBody,
    OnRegion,
    Region,
    Scene,
    SceneObject,
    are_equal_but_for_rounding,
    load_scene,
    load_scenes,
    make_scene,
    save_scene,
    save_scenes,
    scene_from_json,
    scene_to_json,
    validate_scene,
)
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import (
    DEFAULT_WORKCELL,
    SINGLE_ARM_WORKCELL,
    WORKCELLS,
    Arm,
    Table,
    Workcell,
)

RECORD: dict[str, Any] = {
    "version": 1,
    "objects": [
        {
            "name": "yellow",
            "shape": "box",
            "size": [0.05, 0.2, 0.1],
            "position": [-0.4, 0.1],
            "yaw": 0.3,
        },
        {
            "name": "can",
            "shape": "cylinder",
            "size": [0.03, 0.12],
            "position": [0.2, -0.1],
            "yaw": 0.0,
        },
    ],
    "goal": {
        "object": "yellow",
        "region": {"position": [0.3, 0.2], "yaw": 0.1, "size": [0.24, 0.22]},
    },
}


SECOND: dict[str, Any] = RECORD | {
    "version": 2,
    "workcell": {
        "robot": "panda",
        "arms": [
            {"name": "west", "position": [-0.6, 0.0], "yaw": 0.1},
            {
                "name": "east",
                "position": [0.6, 0.1],
                "yaw": 3.0,
                "home": [0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7],
            },
        ],
        "table": {"half_extents": [1.0, 0.8], "thickness": 0.03},
    },
    "fixed": [
        {
            "name": "wall",
            "shape": "box",
            "size": [0.5, 0.05, 0.3],
            "position": [0.0, 0.6, 0.15],
            "yaw": 0.2,
        },
        {
            "name": "post",
            "shape": "cylinder",
            "size": [0.05, 0.2],
            "position": [0.0, -0.6, 0.5],
            "yaw": 0.0,
        },
    ],
}
"""A scene that uses all of version 2."""


def changed2(path: str, value: Any) -> str:
    """SECOND as JSON with the item at a dotted path replaced or removed."""
    return changed(path, value, SECOND)


def changed(path: str, value: Any, record: dict[str, Any] = RECORD) -> str:
    """A record as JSON with the item at a dotted path replaced, or removed when the value is `...`."""
    record = copy.deepcopy(record)
    *parents, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    place: Any = record
    for key in parents:
        place = place[key]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return json.dumps(record)


def test_reads_the_format_of_the_documentation() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    assert scene == Scene(
        objects=(
            SceneObject("yellow", "box", (0.05, 0.2, 0.1), (-0.4, 0.1), 0.3),
            SceneObject("can", "cylinder", (0.03, 0.12), (0.2, -0.1), 0.0),
        ),
        goal=OnRegion("yellow", Region((0.3, 0.2), 0.1, (0.24, 0.22))),
    )
    assert json.loads(scene_to_json(scene)) == RECORD
    assert hash(scene) == hash(scene_from_json(scene_to_json(scene)))


def test_properties() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    box, can = scene.objects
    assert box.half_extents == (0.025, 0.1, 0.05)
    assert can.half_extents == (0.03, 0.03, 0.06)
    assert (box.height, can.height) == (0.1, 0.12)
    assert scene.center_of(can) == (0.2, -0.1, 0.06)
    assert (scene.object_index("can"), scene.goal_index) == (1, 0)
    with pytest.raises(KeyError):
        scene.object_index("blue")


def test_density_and_friction_come_back_and_may_be_left_out() -> None:
    heavy = scene_from_json(
        changed("objects.0.density", 7850).replace('"yaw": 0.0', '"yaw": 0.0, "friction": 0.4')
    )
    assert (heavy.objects[0].density, heavy.objects[0].friction) == (7850.0, 1.0)
    assert (heavy.objects[1].density, heavy.objects[1].friction) == (300.0, 0.4)
    assert scene_from_json(scene_to_json(heavy)) == heavy
    usual = scene_to_json(scene_from_json(json.dumps(RECORD)))
    assert "density" not in usual
    assert "friction" not in usual

    # Also in another process, where the usual numbers are other objects.
    assert scene_to_json(pickle.loads(pickle.dumps(heavy))) == scene_to_json(heavy)
    sent = pickle.loads(pickle.dumps(scene_from_json(usual)))
    assert scene_to_json(sent) == usual


def test_home_of_one_arm(tmp_path: Any) -> None:
    posture = [0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7]
    record = RECORD | {"home": {"right": posture}}
    scene = scene_from_json(json.dumps(record))
    assert scene.home == (DEFAULT_WORKCELL.home[0], tuple(posture))
    save_scene(tmp_path / "scene.json", scene)
    assert load_scene(tmp_path / "scene.json") == scene
    assert json.loads((tmp_path / "scene.json").read_text()) == record


def test_json_lines(tmp_path: Any) -> None:
    first = scene_from_json(json.dumps(RECORD))
    second = make_scene(first.objects[:1], first.goal)
    path = tmp_path / "a" / "folder" / "scenes.jsonl"
    save_scenes(path, [first, second])
    assert load_scenes(path) == (first, second)
    path.write_text(scene_to_json(first) + "\n\n{}\n")
    with pytest.raises(DvrError, match=r"scenes\.jsonl, line 3: the scene: .*`version`"):
        load_scenes(path)
    path.write_text("\n")
    with pytest.raises(DvrError, match="holds no scene"):
        load_scenes(path)


def test_the_shipped_scene_is_valid() -> None:
    scene = load_scene("data/scenes/figure1.json")
    assert [item.name for item in scene.objects] == ["yellow", "blue", "green"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        ("\x00", "not valid JSON"),
        ("[]", "the scene: Expected `object`, got `array`"),
        ("null", "the scene: Expected `object`, got `null`"),
        ("{}", "missing required field `version`"),
        (changed("version", 3), "version: .*3; valid are 1 and 2"),
        (changed("version", "1"), "version: .*; valid are 1 and 2"),
        (
            json.dumps(RECORD).replace('"yaw": 0.3', '"yaw": 0.3, "yaw": 0.3'),
            "the key `yaw` occurs 2 times; each key",
        ),
        (changed("version", ...), "missing required field `version`"),
        (changed("objects", ...), "missing required field `objects`"),
        (changed("goal", ...), "missing required field `goal`"),
        (
            changed("colour", "red"),
            "unknown field `colour`; valid keys are version, objects, goal, home",
        ),
        (
            changed("objects.0.mass", 1),
            r"objects\[0\]: .*`mass`; valid keys are name, shape, size, position, yaw, density, friction",
        ),
        (changed("goal.mass", 1), "goal: .*`mass`; valid keys are object, region"),
        (
            changed("goal.region.mass", 1),
            "goal.region: .*`mass`; valid keys are position, yaw, size",
        ),
        (changed("home", {"middle": []}), "home: .*`middle`; valid keys are left, right"),
        (changed("objects", {}), "objects: Expected `array`, got `object`"),
        (changed("objects", []), "the scene has 0 objects; valid are 1 to 8"),
        (changed("objects", RECORD["objects"] * 5), "the scene has 10 objects; valid are 1 to 8"),
        (changed("objects.1.name", "yellow"), "2 objects are called 'yellow'"),
        (changed("objects.1.name", ""), "name is ''"),
        (changed("objects.1.name", "a, b"), "name is 'a, b'; a name has none of"),
        (changed("objects.1.name", " a"), "name is ' a'.*no blanks"),
        (changed("goal.region.size", [0.03, 0.03]), "the goal region of .* cannot hold 'yellow'"),
        (changed("objects.1.name", 3), r"objects\[1\].name: Expected `str`, got `int`"),
        (
            changed("objects.1.shape", "ball"),
            "object 'can' has the shape 'ball'; valid are 'box' and 'cylinder'",
        ),
        (
            changed("objects.1.shape", "box"),
            "size of the object 'can' is .* 2 numbers; valid are 3",
        ),
        (changed("objects.0.size", [0.1, 0.1]), "2 numbers; valid are 3"),
        (changed("objects.0.size", [0.1, 0.1, 0.1, 0.1]), "4 numbers; valid are 3"),
        (
            changed("objects.0.size", [0.1, 0.0, 0.1]),
            "size of the object 'yellow' is .*at least 0.001",
        ),
        (
            changed("objects.0.size", [0.1, -0.1, 0.1]),
            "size of the object 'yellow' is .*at least 0.001",
        ),
        (
            changed("objects.0.size", [0.1, "0.1", 0.1]),
            r"objects\[0\].size\[1\]: Expected `float`, got `str`",
        ),
        (changed("objects.0.size", [0.1, math.nan, 0.1]), "NaN and infinity are no JSON numbers"),
        (changed("objects.0.yaw", math.inf), "NaN and infinity are no JSON numbers"),
        (changed("objects.0.yaw", None), r"objects\[0\].yaw: Expected `float`, got `null`"),
        (changed("objects.0.yaw", ...), "missing required field `yaw`"),
        (json.dumps(RECORD).replace("0.3}", "1e999}"), r"objects\[0\].yaw: Number out of range"),
        (
            changed("objects.0.position", [0.1]),
            r"objects\[0\].position: Expected `array` of length 2",
        ),
        (changed("objects.0.position", [1.05, 0.5]), "'yellow' at .* reaches off the table"),
        (changed("objects.0.position", [0.0, 0.95]), "'yellow' at .* reaches off the table"),
        (changed("objects.0.position", [1e308, 0.0]), "'yellow' at .* reaches off the table"),
        (changed("objects.1.position", [0.72, 0.05]), "'can' at .* overlaps the right arm's base"),
        (changed("objects.1.position", [-0.69, 0.0]), "'can' at .* overlaps the left arm's base"),
        (changed("objects.1.position", [-0.89, 0.0]), "'can' at .* overlaps the left arm's base"),
        (
            changed("objects.1.size", [0.03, 2.1]),
            "size of the object 'can' is .*at least 0.001 and at most 2 m",
        ),
        (
            changed("objects.0.yaw", 1e300),
            "yaw of the object 'yellow' is .*at least -6.28319 and at most 6.28319 rad",
        ),
        (
            changed("goal.region.yaw", -1e4),
            "goal region's yaw is .*at least -6.28319 and at most 6.28319 rad",
        ),
        (
            json.dumps(RECORD) + "\n" + json.dumps(RECORD),
            "not valid JSON .*valid is one scene, and in a file of scenes",
        ),
        (
            changed("objects.0.density", 0),
            r"density of the object 'yellow' is .*at least 1 and at most 25000 kg/m\^3",
        ),
        (
            changed("objects.1.friction", -0.5),
            "friction of the object 'can' is .*at least 0.01 and at most 10",
        ),
        (changed("objects.1.friction", "low"), r"objects\[1\].friction: Expected `float"),
        (changed("objects.1.position", [-0.4, 0.1]), "'yellow' and 'can' overlap by"),
        (changed("goal.object", "blue"), "goal's object is 'blue'; the scene has 'yellow', 'can'"),
        (changed("goal.region.position", [1.0, 0.2]), "goal region at .* reaches off the table"),
        (changed("goal.region.size", [0.1, 0.0]), "goal region's size is .*at least 0.001"),
        (changed("home", {"left": [0.0] * 6}), "left arm's home is .* 6 numbers; valid are 7"),
        (
            changed("home", {"right": [0, 0, 0, 0, 0, 0, 0]}),
            "joint 4 of the right arm's home is 0 rad; valid is -3.07",
        ),
    ],
)
def test_refuses(text: str, message: str) -> None:
    with pytest.raises(DvrError, match=message) as caught:
        scene_from_json(text, "some.json")
    sentence = str(caught.value)
    assert sentence.startswith("some.json: ")
    assert sentence.endswith(".") and "\n" not in sentence and "$" not in sentence


def test_reads_version_2() -> None:
    scene = scene_from_json(json.dumps(SECOND))
    first = scene_from_json(json.dumps(RECORD))
    assert scene == Scene(
        objects=first.objects,
        goal=first.goal,
        workcell=Workcell(
            arms=(
                Arm("west", (-0.6, 0.0), 0.1),
                Arm("east", (0.6, 0.1), 3.0, (0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7)),
            ),
            table=Table((1.0, 0.8), 0.03),
        ),
        fixed=(
            FixedBody("wall", "box", (0.5, 0.05, 0.3), (0.0, 0.6, 0.15), 0.2),
            FixedBody("post", "cylinder", (0.05, 0.2), (0.0, -0.6, 0.5), 0.0),
        ),
    )
    assert json.loads(scene_to_json(scene)) == SECOND
    assert scene.fixed[0].half_extents == (0.25, 0.025, 0.15)
    assert (scene.fixed[1].bottom, scene.fixed[1].top) == (0.4, 0.6)


def test_version_1_is_written_where_it_can_say_all() -> None:
    """Reading the least file of version 2 gives what version 1 says, and is written as that."""
    scene = scene_from_json(json.dumps(RECORD | {"version": 2}))
    assert (
        scene == scene_from_json(json.dumps(RECORD)) and json.loads(scene_to_json(scene)) == RECORD
    )
    fixed = replace(
        scene, fixed=(FixedBody("wall", "box", (0.5, 0.05, 0.3), (0.0, 0.6, 0.15), 0.2),)
    )
    assert json.loads(scene_to_json(fixed)) == RECORD | {"version": 2, "fixed": SECOND["fixed"][:1]}


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_every_workcell_comes_back(workcell: Workcell) -> None:
    first = scene_from_json(json.dumps(RECORD))
    box, can = first.objects
    scene = replace(first, workcell=workcell, objects=(replace(box, position=(-0.1, 0.3)), can))
    text = scene_to_json(scene)
    assert json.loads(text)["version"] == (1 if workcell == DEFAULT_WORKCELL else 2)
    assert scene_from_json(text) == scene


def test_homes_of_every_arm_come_back() -> None:
    first = scene_from_json(json.dumps(RECORD))
    posture = (0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7)
    for workcell in (DEFAULT_WORKCELL, SINGLE_ARM_WORKCELL):
        arms = tuple(replace(arm, home=posture) for arm in workcell.arms)
        scene = replace(first, workcell=replace(workcell, arms=arms))
        assert scene_from_json(scene_to_json(scene)) == scene


def test_a_robot_that_is_not_registered_cannot_be_written() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    for name, message in (
        ("panda", "another robot is registered as 'panda'"),
        ("ufo", "no robot is registered as 'ufo'"),
    ):
        other = replace(PANDA, name=name, mjcf=PANDA.mjcf + "<!-- -->")
        with pytest.raises(DvrError, match=message):
            scene_to_json(replace(scene, workcell=replace(DEFAULT_WORKCELL, robot=other)))


NAME_OF_101 = "n" * 101


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            changed2("home", {}),
            "unknown field `home`; valid keys are version, objects, goal, workcell, fixed",
        ),
        (
            changed("fixed", []),
            "unknown field `fixed`; valid keys are version, objects, goal, home",
        ),
        (changed2("workcell.robot", "ufo"), "there is no robot 'ufo'; valid: .*panda"),
        (changed2("workcell.robot", ...), "workcell: .*`robot`; add it"),
        (changed2("workcell.legs", 4), "workcell: .*`legs`; valid keys are robot, arms, table"),
        (
            changed2("workcell.arms.0.legs", 4),
            r"arms\[0\]: .*`legs`; valid keys are name, position, yaw, home",
        ),
        (
            changed2("workcell.table.legs", 4),
            "table: .*`legs`; valid keys are half_extents, thickness",
        ),
        (
            changed2("fixed.1.mass", 4),
            r"fixed\[1\]: .*; valid keys are name, shape, size, position, yaw",
        ),
        (changed2("workcell.arms", []), "the workcell has 0 arms; valid are 1 to 2"),
        (
            changed2("workcell.arms", SECOND["workcell"]["arms"] * 2),
            "the workcell has 4 arms; valid are 1 to 2",
        ),
        (changed2("workcell.arms.1.name", "west"), "2 arms are called 'west'"),
        (changed2("workcell.arms.1.name", ""), "an arm's name is ''"),
        (changed2("workcell.arms.1.name", "a/b"), "an arm's name is 'a/b'; a name has none of"),
        (changed2("workcell.arms.1.name", "a)"), r"an arm's name is 'a\)'; a name has none of"),
        (
            changed2("workcell.arms.1.name", "a\x07"),
            "an arm's name is .*; valid are printable characters",
        ),
        (
            changed2("workcell.arms.1.name", NAME_OF_101),
            "an arm's name has 101 characters; valid are at most 100",
        ),
        (
            changed2("workcell.arms.1.name", "object"),
            "an arm's name is 'object'; valid is any name but object",
        ),
        (
            changed2("workcell.arms.1.position", [0.9, 0.0]),
            "the east arm's base at .* reaches off the table",
        ),
        (
            changed2("workcell.arms.1.position", [-0.4, 0.0]),
            "'west' and 'east' are 0.2 m apart; valid is at least 0.3",
        ),
        (changed2("workcell.arms.1.yaw", 1e4), "the yaw of the east arm is .*at most 6.28319 rad"),
        (
            changed2("workcell.arms.1.home", [0.0] * 6),
            "the east arm's home is .* 6 numbers; valid are 7",
        ),
        (
            changed2("workcell.arms.1.home", [0.0] * 7),
            "joint 4 of the east arm's home is 0 rad; valid is -3.07",
        ),
        (
            changed2("workcell.table.half_extents", [0.1, 1]),
            "the table's half extents is .*at least 0.2",
        ),
        (changed2("workcell.table.thickness", 0), "the table's thickness is .*at least 0.001"),
        (changed2("objects.1.position", [0.6, 0.1]), "'can' at .* overlaps the east arm's base"),
        (changed2("objects.1.position", [0.2, 0.78]), "'can' at .* reaches off the table"),
        (
            changed2("fixed", SECOND["fixed"] * 9),
            "the scene has 18 fixed bodies; valid are 0 to 16",
        ),
        (changed2("fixed.0.name", "can"), "2 objects and fixed bodies are called 'can'"),
        (changed2("fixed.0.name", "post"), "2 objects and fixed bodies are called 'post'"),
        (changed2("fixed.0.name", "a,"), "a fixed body's name is 'a,'; a name has none of"),
        (changed2("fixed.0.shape", "ball"), "fixed body 'wall' has the shape 'ball'; valid are"),
        (
            changed2("fixed.0.size", [0.1, 0.1]),
            "size of the fixed body 'wall' is .* 2 numbers; valid are 3",
        ),
        (
            changed2("fixed.0.size", [0.1, 0.1, 0]),
            "size of the fixed body 'wall' is .*at least 0.001",
        ),
        (
            changed2("fixed.0.position", [0, 0]),
            r"fixed\[0\].position: Expected `array` of length 3",
        ),
        (
            changed2("fixed.0.position", [3, 0, 1]),
            "position of the fixed body 'wall' is .*at most 2 m",
        ),
        (
            changed2("fixed.0.position.2", 0.14),
            "fixed body 'wall' begins 0.01 m below the table's top",
        ),
        (changed2("fixed.0.position.2", 1.9), "fixed body 'wall' reaches 2.05 m above the table"),
        (changed2("fixed.0.yaw", 1e4), "yaw of the fixed body 'wall' is .*at most 6.28319 rad"),
        (
            changed2("fixed.0.position", [0.3, -0.1, 0.15]),
            "'can' and the fixed body 'wall' overlap by",
        ),
        (
            changed2("fixed.0.position", [0.3, -0.1, 0.26]),
            "'can' and the fixed body 'wall' overlap by 0.01 m",
        ),
        (
            changed2(
                "fixed.1", SECOND["fixed"][1] | {"size": [0.17, 0.2], "position": [0.3, 0.2, 0.15]}
            ),
            "fixed body 'post' stands on the whole goal region",
        ),
        (
            changed2("fixed.0.position", [-0.6, 0.0, 0.15]),
            "'wall' at .* overlaps the west arm's base",
        ),
        (
            changed2("fixed.0.position", [-0.6, 0.0, 0.5]),
            "'wall' at .* overlaps the west arm's base",
        ),
    ],
)
def test_refuses_of_version_2(text: str, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        scene_from_json(text, "some.json")
    sentence = str(caught.value)
    assert sentence.startswith("some.json: ")
    assert sentence.endswith(".") and "\n" not in sentence and "$" not in sentence


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (
            "fixed.0.position",
            [0.2, 0.1, 0.45],
        ),  # hangs over an object that is 0.12 m high, and over the region
        ("fixed.0.position", [-0.6, 0.0, 0.56]),  # hangs over a base
        ("fixed.1.position", [0.3, 0.3, 0.15]),  # hangs low over a part of the region
        ("fixed.0.position", [0.0, 0.65, 0.15]),  # reaches over the table's border
        ("fixed.1.position", [0.0, 0.6, 0.5]),  # stands in another fixed body
        ("fixed.1.name", "west"),  # an arm's name
        ("objects.1.name", "east"),
    ],
)
def test_accepts_of_version_2(path: str, value: Any) -> None:
    scene_from_json(changed2(path, value))


def test_touching_fixed_bodies_are_valid() -> None:
    item = SceneObject("a", "box", (0.1, 0.1, 0.1), (0.0, 0.0), 0.0)
    beside = FixedBody("beside", "box", (0.1, 0.3, 0.3), (0.1, 0.0, 0.15), 0.0)
    above = FixedBody("above", "cylinder", (0.2, 0.02), (0.0, 0.0, 0.11), 0.0)
    make_scene([item], OnRegion("a", Region((0.0, 0.0), 0.0, (0.1, 0.1))), fixed=[beside, above])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1"])
def test_python_values_are_checked_like_files(value: Any) -> None:
    region = Region((0.3, 0.2), 0.0, (0.2, 0.2))
    for broken in (
        Scene(
            (SceneObject("a", "box", (0.1, 0.1, 0.1), (0.0, 0.0), value),), OnRegion("a", region)
        ),
        Scene(
            (SceneObject("a", "box", (value, 0.1, 0.1), (0.0, 0.0), 0.0),), OnRegion("a", region)
        ),
        Scene(
            (SceneObject("a", "cylinder", (0.1, 0.1), (0.0, value), 0.0),), OnRegion("a", region)
        ),
    ):
        with pytest.raises(DvrError, match=r"of the object 'a' is .*finite"):
            validate_scene(broken)


def test_touching_objects_are_valid() -> None:
    side = 0.1
    objects = [
        SceneObject(str(i), "box", (side, side, 0.1), (-0.2 + i * side, 0.0), 0.0) for i in range(4)
    ]
    make_scene(objects, OnRegion("0", Region((0.3, 0.2), 0.0, (0.2, 0.2))))


def test_scenes_that_differ_in_the_last_bit_are_one() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    assert are_equal_but_for_rounding(scene, scene)
    rounded = scene_from_json(changed("objects.0.position.0", math.nextafter(-0.4, 0)))
    assert rounded != scene and are_equal_but_for_rounding(scene, rounded)
    for path, value in (
        ("objects.0.position.0", -0.4 + 1e-7),
        ("goal.region.yaw", 0.1 - 1e-7),
        ("objects.1.name", "pot"),
        ("goal.object", "can"),
    ):
        assert not are_equal_but_for_rounding(scene, scene_from_json(changed(path, value))), path
    fewer = Scene(scene.objects[:1], scene.goal)
    assert not are_equal_but_for_rounding(scene, fewer) and not are_equal_but_for_rounding(
        fewer, scene
    )


def test_lists_in_a_scene_are_refused() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    arms = [Arm("arm", [0.0, -0.4], 0.0)]  # type: ignore[arg-type]
    for broken in (
        replace(scene, objects=list(scene.objects)),  # type: ignore[arg-type]
        replace(scene, workcell=Workcell(tuple(arms))),
    ):
        with pytest.raises(
            SceneError, match=r"unhashable type: 'list'.*valid are tuples instead of lists"
        ):
            validate_scene(broken)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("n" * 101, "an object's name has 101 characters; valid are at most 100"),
        ("\x1b[31m", r"an object's name is '\\x1b\[31m'; valid are printable characters only"),
        ("a\u202eb", "valid are printable characters only"),
        ("\ud800", "printable|not valid JSON"),
    ],
)
def test_names_that_do_not_belong_on_a_screen(name: str, message: str) -> None:
    with pytest.raises(SceneError, match=message) as refused:
        scene_from_json(changed("objects.0.name", name))
    assert str(refused.value).isprintable() and len(str(refused.value)) <= 1000


def test_a_yaw_in_degrees_is_refused() -> None:
    with pytest.raises(SceneError, match=r"the yaw of .* is \(90\); valid is at least -6.28319"):
        scene_from_json(changed("objects.0.yaw", 90))


@pytest.mark.parametrize(
    "content",
    [
        b"[" * 100_000,
        b'{"version":1,"objects":' + b"[" * 50_000 + b"]" * 50_000 + b"}",
        b'{"version":1,"x":' * 50_000,
        b"\xff\xfe{\x00}\x00",
        b"\x89PNG\r\n\x1a\n",
        b'{"version": 1' + b"0" * 5000 + b"}",
    ],
)
def test_hostile_files_are_refused_in_one_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_bytes(content)
    with pytest.raises(SceneError, match=r"scene\.json: ") as refused:
        load_scene(tmp_path / "scene.json")
    assert len(str(refused.value)) <= 1000


def test_what_is_no_regular_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(OSError, match="no regular file"):
            load_scene(path)
