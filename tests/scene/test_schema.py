"""The JSON Schema of scene files against the loader, on generated and on hand-made files.

The schema says less than the loader: it knows nothing of overlaps and reach. So what the loader accepts is valid, what
is not valid is refused, and what is valid and refused breaks a rule of geometry.
"""

import copy
import json
from importlib.resources import files
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.errors import SceneError
from dvr_jax.scene.file_format import decode_scene
from dvr_jax.scene.files import load_scenes, save_scenes, scene_from_json, scene_to_json
from dvr_jax.scene.sampling import SceneDistribution, sample_scenes
from dvr_jax.workcell.workcell import WORKCELLS

SCHEMA = json.loads((files("dvr_jax.scene") / "scene.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)

OBJECT = {
    "name": "yellow",
    "shape": "box",
    "size": [0.05, 0.2, 0.1],
    "position": [-0.4, 0.1],
    "yaw": 0.3,
}
CAN = {
    "name": "can",
    "shape": "cylinder",
    "size": [0.03, 0.12],
    "position": [0.2, -0.1],
    "yaw": 0,
    "density": 1000,
    "friction": 0.5,
}
GOAL = {"object": "yellow", "region": {"position": [0.3, 0.2], "yaw": 0.1, "size": [0.24, 0.22]}}
POSTURE = [0.1, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7]
FIRST: dict[str, Any] = {
    "version": 1,
    "objects": [OBJECT, CAN],
    "goal": GOAL,
    "home": {"left": POSTURE},
}
SECOND: dict[str, Any] = {
    "version": 2,
    "objects": [OBJECT, CAN],
    "goal": GOAL,
    "workcell": {
        "robot": "panda",
        "arms": [
            {"name": "west", "position": [-0.6, 0.0], "yaw": 0.1},
            {"name": "east", "position": [0.6, 0.1], "yaw": 3.0, "home": POSTURE},
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

GEOMETRY = (
    "overlap",
    "reaches",
    "cannot hold",
    "valid is -",  # beyond a joint limit
    "begins",
    "stands on the whole goal region",
    "the scene has",  # not the goal's object
    "are called",
    "apart",
    "printable",
    "no blanks around it",
)
"""Words of the refusals that no schema can make."""


def places(record: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all items of a JSON document."""
    found = [path] if path else []
    items = (
        record.items()
        if isinstance(record, dict)
        else enumerate(record)
        if isinstance(record, list)
        else []
    )
    for key, value in items:
        found += places(value, (*path, key))
    return found


numbers = st.one_of(
    st.floats(-3, 3),
    st.sampled_from([0, 1, 2, -1, 0.001, 0.0005, 2.0, 2.1, 1000, 1001, -1000.5, 1e308, 1.0, 2**70]),
)
names = st.one_of(
    st.sampled_from(
        [
            "yellow",
            "west",
            "object",
            "fixed",
            "",
            " a",
            "a ",
            "a,b",
            "a(b",
            "a/b",
            "ü",
            "a\n",
            "x" * 101,
        ]
    ),
    st.text(max_size=4),
)
odd_values = st.one_of(
    numbers,
    names,
    st.lists(numbers, max_size=8),
    st.sampled_from(
        [None, True, {}, [], "box", "cylinder", "panda", [OBJECT] * 9, [CAN], {"left": None}]
    ),
)


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """A valid document of which up to three items were replaced, removed or given company."""
    document = copy.deepcopy(draw(st.sampled_from([FIRST, SECOND])))
    for _ in range(draw(st.integers(0, 3))):
        *parents, last = draw(st.sampled_from(places(document)))
        place = document
        for key in parents:
            place = place[key]
        change = draw(st.sampled_from(["replace", "nudge", "remove", "add"]))
        if change == "replace":
            place[last] = copy.deepcopy(draw(odd_values))
        elif change == "nudge" and isinstance(place[last], float):
            place[last] += draw(st.floats(-0.2, 0.2))
        elif change == "remove":
            del place[last]
        elif isinstance(place, dict):
            place[draw(st.sampled_from(["mass", "home", "fixed", "workcell", "table"]))] = (
                copy.deepcopy(draw(odd_values))
            )
        if not places(document):
            break
    return document


@settings(max_examples=400, deadline=None)
@given(documents())
def test_the_schema_says_what_the_loader_does(document: dict[str, Any]) -> None:
    text = json.dumps(document)
    valid = VALIDATOR.is_valid(document)
    try:
        scene = scene_from_json(text)
    except SceneError as error:
        if valid:
            decode_scene(text)  # it is a scene file in form
            assert any(words in str(error) for words in GEOMETRY), str(error)
    else:
        assert valid
        assert VALIDATOR.is_valid(json.loads(scene_to_json(scene)))


def test_the_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize(
    "document", [FIRST, SECOND, SECOND | {"workcell": None}, FIRST | {"home": None}]
)
def test_valid_documents(document: dict[str, Any]) -> None:
    VALIDATOR.validate(document)
    scene_from_json(json.dumps(document))


@pytest.mark.parametrize(
    "change",
    [
        {"version": 3},
        {"version": "2"},
        {"version": 2.5},
        {"home": {"left": POSTURE}},
        {"objects": []},
        {"objects": [OBJECT] * 9},
        {"objects": [OBJECT | {"size": [0.1, 0.1]}]},
        {"objects": [OBJECT | {"size": [0.1, 0.1, 0.0]}]},
        {"objects": [OBJECT | {"mass": 1}]},
        {"objects": [OBJECT | {"name": "a,b"}]},
        {"objects": [OBJECT | {"shape": "ball"}]},
        {"fixed": [SECOND["fixed"][0] | {"position": [0, 0]}]},
        {"fixed": [SECOND["fixed"][0]] * 17},
        {"workcell": {"robot": "panda"}},
        {"workcell": {"robot": "panda", "arms": []}},
        {"workcell": SECOND["workcell"] | {"robot": "ufo"}},
        {"workcell": {"robot": "panda", "arms": [{"name": "a/b", "position": [0, 0], "yaw": 0}]}},
        {"workcell": {"robot": "panda", "arms": [{"name": "fixed", "position": [0, 0], "yaw": 0}]}},
        {
            "workcell": {
                "robot": "panda",
                "arms": [{"name": "a", "position": [0, 0], "yaw": 0, "home": POSTURE[:6]}],
            }
        },
    ],
)
def test_invalid_documents(change: dict[str, Any]) -> None:
    document = SECOND | change
    assert not VALIDATOR.is_valid(document)
    with pytest.raises(SceneError):
        scene_from_json(json.dumps(document))


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_what_is_written_is_valid(workcell: Any, tmp_path: Any) -> None:
    distribution = SceneDistribution("mixed", fixed_bodies=(0, 2))
    scenes = tuple(sample_scenes(4, 3, 1, distribution, workcell))
    save_scenes(tmp_path / "scenes.jsonl", scenes)
    for line in (tmp_path / "scenes.jsonl").read_text().splitlines():
        VALIDATOR.validate(json.loads(line))
    assert load_scenes(tmp_path / "scenes.jsonl") == scenes
