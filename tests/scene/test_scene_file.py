"""Scene files: what goes out comes back, and whatever is wrong is refused in one sentence that names it."""

import copy
import json
import math
from typing import Any

import pytest

from dvr_jax.errors import DvrError
from dvr_jax.scene.files import (
    DEFAULT_HOME,
    Goal,
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

RECORD: dict[str, Any] = {
    "version": 1,
    "objects": [
        {"name": "yellow", "shape": "box", "size": [0.05, 0.2, 0.1], "position": [-0.4, 0.1], "yaw": 0.3},
        {"name": "can", "shape": "cylinder", "size": [0.03, 0.12], "position": [0.2, -0.1], "yaw": 0.0},
    ],
    "goal": {"object": "yellow", "region": {"position": [0.3, 0.2], "yaw": 0.1, "size": [0.24, 0.22]}},
}


def changed(path: str, value: Any) -> str:
    """RECORD as JSON with the item at a dotted path replaced, or removed when the value is `...`."""
    record = copy.deepcopy(RECORD)
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
        goal=Goal("yellow", Region((0.3, 0.2), 0.1, (0.24, 0.22))),
        home=DEFAULT_HOME,
    )
    assert json.loads(scene_to_json(scene)) == RECORD
    assert hash(scene) == hash(scene_from_json(scene_to_json(scene)))


def test_properties() -> None:
    scene = scene_from_json(json.dumps(RECORD))
    box, can = scene.objects
    assert box.half_extents == (0.025, 0.1, 0.05)
    assert can.half_extents == (0.03, 0.03, 0.06)
    assert (box.height, can.height) == (0.1, 0.12)
    assert can.center == (0.2, -0.1, 0.06)
    assert (scene.object_index("can"), scene.goal_index) == (1, 0)
    with pytest.raises(KeyError):
        scene.object_index("blue")


def test_home_of_one_arm(tmp_path: Any) -> None:
    posture = [0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7]
    record = RECORD | {"home": {"right": posture}}
    scene = scene_from_json(json.dumps(record))
    assert scene.home == (DEFAULT_HOME[0], tuple(posture))
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
        (changed("version", 2), "version: .*2; the only valid version is 1"),
        (changed("version", "1"), "version: "),
        (changed("version", ...), "missing required field `version`"),
        (changed("objects", ...), "missing required field `objects`"),
        (changed("goal", ...), "missing required field `goal`"),
        (changed("colour", "red"), "unknown field `colour`; valid keys are version, objects, goal, home"),
        (changed("objects.0.mass", 1), r"objects\[0\]: .*`mass`; valid keys are name, shape, size, position, yaw"),
        (changed("goal.mass", 1), "goal: .*`mass`; valid keys are object, region"),
        (changed("goal.region.mass", 1), "goal.region: .*`mass`; valid keys are position, yaw, size"),
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
        (changed("objects.1.shape", "ball"), r"objects\[1\].shape: .*'ball'; valid are 'box' and 'cylinder'"),
        (changed("objects.1.shape", "box"), "size of the object 'can' is .* 2 numbers; valid are 3"),
        (changed("objects.0.size", [0.1, 0.1]), "2 numbers; valid are 3"),
        (changed("objects.0.size", [0.1, 0.1, 0.1, 0.1]), "4 numbers; valid are 3"),
        (changed("objects.0.size", [0.1, 0.0, 0.1]), "size of the object 'yellow' is .*at least 0.001"),
        (changed("objects.0.size", [0.1, -0.1, 0.1]), "size of the object 'yellow' is .*at least 0.001"),
        (changed("objects.0.size", [0.1, "0.1", 0.1]), r"objects\[0\].size\[1\]: Expected `float`, got `str`"),
        (changed("objects.0.size", [0.1, math.nan, 0.1]), "NaN and infinity are no JSON numbers"),
        (changed("objects.0.yaw", math.inf), "NaN and infinity are no JSON numbers"),
        (changed("objects.0.yaw", None), r"objects\[0\].yaw: Expected `float`, got `null`"),
        (changed("objects.0.yaw", ...), "missing required field `yaw`"),
        (json.dumps(RECORD).replace("0.3}", "1e999}"), r"objects\[0\].yaw: Number out of range"),
        (changed("objects.0.position", [0.1]), r"objects\[0\].position: Expected `array` of length 2"),
        (changed("objects.0.position", [1.05, 0.5]), "'yellow' at .* reaches off the table"),
        (changed("objects.0.position", [0.0, 0.95]), "'yellow' at .* reaches off the table"),
        (changed("objects.0.position", [1e308, 0.0]), "'yellow' at .* reaches off the table"),
        (changed("objects.1.position", [0.72, 0.05]), "'can' at .* overlaps the right arm's base"),
        (changed("objects.1.position", [-0.69, 0.0]), "'can' at .* overlaps the left arm's base"),
        (changed("objects.1.position", [-0.89, 0.0]), "'can' at .* overlaps the left arm's base"),
        (changed("objects.1.size", [0.03, 2.1]), "size of the object 'can' is .*at least 0.001 and at most 2 m"),
        (changed("objects.0.yaw", 1e300), "yaw of the object 'yellow' is .*at least -1000 and at most 1000 rad"),
        (changed("goal.region.yaw", -1e4), "goal region's yaw is .*at least -1000 and at most 1000 rad"),
        (
            json.dumps(RECORD) + "\n" + json.dumps(RECORD),
            "not valid JSON .*valid is one scene, and in a file of scenes",
        ),
        (changed("objects.1.position", [-0.4, 0.1]), "'yellow' and 'can' overlap by"),
        (changed("goal.object", "blue"), "goal's object is 'blue'; the scene has 'yellow', 'can'"),
        (changed("goal.region.position", [1.0, 0.2]), "goal region at .* reaches off the table"),
        (changed("goal.region.size", [0.1, 0.0]), "goal region's size is .*at least 0.001"),
        (changed("home", {"left": [0.0] * 6}), "left arm's home is .* 6 numbers; valid are 7"),
        (changed("home", {"right": [0, 0, 0, 0, 0, 0, 0]}), "joint 4 of the right arm's home is 0 rad; valid is -3.07"),
    ],
)
def test_refuses(text: str, message: str) -> None:
    with pytest.raises(DvrError, match=message) as caught:
        scene_from_json(text, "some.json")
    sentence = str(caught.value)
    assert sentence.startswith("some.json: ")
    assert sentence.endswith(".") and "\n" not in sentence and "$" not in sentence


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1"])
def test_python_values_are_checked_like_files(value: Any) -> None:
    region = Region((0.3, 0.2), 0.0, (0.2, 0.2))
    for broken in (
        Scene((SceneObject("a", "box", (0.1, 0.1, 0.1), (0.0, 0.0), value),), Goal("a", region)),
        Scene((SceneObject("a", "box", (value, 0.1, 0.1), (0.0, 0.0), 0.0),), Goal("a", region)),
        Scene((SceneObject("a", "cylinder", (0.1, 0.1), (0.0, value), 0.0),), Goal("a", region)),
    ):
        with pytest.raises(DvrError, match=r"of the object 'a' is .*finite"):
            validate_scene(broken)


def test_touching_objects_are_valid() -> None:
    side = 0.1
    objects = [SceneObject(str(i), "box", (side, side, 0.1), (-0.2 + i * side, 0.0), 0.0) for i in range(4)]
    make_scene(objects, Goal("0", Region((0.3, 0.2), 0.0, (0.2, 0.2))))


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
    assert not are_equal_but_for_rounding(scene, fewer) and not are_equal_but_for_rounding(fewer, scene)
