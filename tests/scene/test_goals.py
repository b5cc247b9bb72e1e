"""Goals of several facts: their files, their refusals, and what the symbolic layer makes of them."""

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from typing import Any

import pytest

from dvr_jax.errors import SceneError
from dvr_jax.goals import Clear, Goal, HandsEmpty, Holding, Inside, On, OnRegion, Region
from dvr_jax.logic import ground_actions, ground_task
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.start import goal_holds_at_start, start_facts, symbolic_task
from dvr_jax.scene.types import Scene, SceneObject

PLATE = Region((-0.2, 0.0), 0.1, (0.2, 0.2), "plate")
SPOT = Region((0.3, 0.3), 0.4, (0.03, 0.03), "spot", inside=Inside.CENTER)


def box(name: str, x: float, y: float) -> SceneObject:
    return SceneObject(name, "box", (0.05, 0.08, 0.08), (x, y), 0.3)


OBJECTS = (box("a", -0.2, 0.02), box("b", -0.3, 0.3), box("c", 0.3, 0.1))
FACTS = (On("b", "plate"), Holding("left", "c"), HandsEmpty(), Clear("plate"))


def scene_with(*facts: Any, regions: tuple[Region, ...] = (PLATE, SPOT)) -> Scene:
    return Scene(OBJECTS, Goal(facts), regions=regions)


def record_of(scene: Scene) -> Any:
    return json.loads(scene_to_json(scene))


@pytest.mark.parametrize(
    "facts",
    [
        (On("b", "plate"), HandsEmpty()),
        (On("a", "plate"), On("b", "plate"), On("c", "spot")),
        (Holding("right", "c"), Clear("plate")),
    ],
)
def test_a_file_gives_the_scene_back(facts: tuple[Any, ...]) -> None:
    scene = scene_with(*facts)
    assert record_of(scene)["version"] == 2
    assert scene_from_json(scene_to_json(scene)) == scene


def test_the_words_of_a_file() -> None:
    record = record_of(scene_with(On("a", "plate"), On("b", "spot"), HandsEmpty()))
    assert record["goal"] == [["on", "a", "plate"], ["on", "b", "spot"], ["hands_empty"]]
    assert record["regions"][0] == {
        "name": "plate",
        "position": [-0.2, 0.0],
        "yaw": 0.1,
        "size": [0.2, 0.2],
    }
    assert record["regions"][1]["inside"] == "center"


def with_goal(*facts: list[str]) -> Callable[[], Scene]:
    record = {**record_of(scene_with(HandsEmpty())), "goal": list(facts)}
    return lambda: scene_from_json(json.dumps(record))


def with_region(**changed: Any) -> Callable[[], Scene]:
    record = record_of(scene_with(On("b", "plate")))
    record["regions"][0].update(changed)
    return lambda: scene_from_json(json.dumps(record))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (with_goal(), "the goal has no fact"),
        (with_goal([]), r"an empty fact; valid are .*\['on', 'object', 'region'\]"),
        (with_goal(["under", "a", "plate"]), r"\['under', 'a', 'plate'\]; valid are .*'clear'"),
        (with_goal(["on", "a"]), r"\['on', 'a'\]; valid are"),
        (with_goal(["on", "d", "plate"]), "names the object 'd'; the scene has 'a', 'b', 'c'"),
        (with_goal(["on", "a", "tray"]), "names the region 'tray'; the scene has 'plate', 'spot'"),
        (with_goal(["holding", "up", "a"]), "names the arm 'up'; the scene has 'left', 'right'"),
        (with_goal(["hands_empty"], ["hands_empty"]), "'hands empty' twice"),
        (with_goal(["on", "a", "plate"], ["on", "a", "spot"]), "'a' is in one place"),
        (with_goal(["on", "a", "plate"], ["holding", "left", "a"]), "cannot hold together"),
        (with_goal(["holding", "left", "a"], ["holding", "right", "a"]), "cannot hold together"),
        (with_goal(["holding", "left", "a"], ["holding", "left", "b"]), "left arm holds one"),
        (with_goal(["holding", "left", "a"], ["hands_empty"]), "cannot hold together; leave"),
        (with_goal(["on", "b", "plate"], ["clear", "plate"]), "cannot hold together; leave"),
        (with_goal(["holding", "left", "a"], ["clear", "plate"]), "cannot hold together; leave"),
        (with_region(name="table"), "a region is called 'table'"),
        (with_region(name="a"), "a region is called 'a'"),
        (with_region(name="spot"), "called 'spot'; each name may occur once"),
        (with_region(support="shelf"), "lies on 'shelf'; valid are 'table'"),
        (with_region(inside="edge"), "inside: .*'edge'"),
        (with_region(position=[5.0, 0.0]), "the region 'plate' at .* reaches off the table"),
        (with_region(size=[0.04, 0.2]), "the region 'plate' of .* cannot hold 'b'"),
    ],
)
def test_a_refusal_names_the_culprit(make: Callable[[], Scene], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()


def test_a_region_too_small_for_its_objects_together() -> None:
    def load(size: tuple[float, float]) -> Scene:
        facts = tuple(On(name, "plate") for name in "abc")
        scene = scene_with(*facts, regions=(replace(PLATE, size=size),))
        return scene_from_json(scene_to_json(scene))

    # Three objects of 5 x 8 cm side by side need 15 x 8 cm.
    assert load((0.15, 0.08)).regions[0].size == (0.15, 0.08)
    with pytest.raises(SceneError, match=r"too small for 'a', 'b', 'c' together: they cover 0.012"):
        load((0.149, 0.08))

    # Two thin plates find no place beside each other on a long strip of less than twice their width.
    plates = [
        SceneObject(n, "box", (0.08, 0.08, 0.02), (0.1, y), 0.0) for n, y in (("p", 0), ("q", 0.3))
    ]
    strip = Region((-0.2, 0.0), 0.0, (0.082, 0.158), "strip")
    scene = Scene(tuple(plates), Goal((On("p", "strip"), On("q", "strip"))), regions=(strip,))
    with pytest.raises(SceneError, match="cannot hold 'p' and 'q' side by side"):
        scene_from_json(scene_to_json(scene))


def test_version_1_scenes_keep_their_actions_and_states() -> None:
    for seed in range(20):
        scene = scene_of_seed(seed, 0, 3)
        grounding = ground_task(symbolic_task(scene))
        assert grounding == ground_actions(
            scene.object_names, scene.paper_goal.object, scene.workcell.arm_names
        )


def test_the_facts_at_the_start() -> None:
    # `a` lies on the plate, and the center of `c` does not lie on the spot.
    scene = scene_with(On("a", "plate"), On("b", "plate"))
    assert start_facts(scene) == {("on", "a", "plate")}
    there = replace(scene, objects=(*OBJECTS[:2], replace(OBJECTS[2], position=(0.3, 0.3))))
    assert start_facts(there) == {("on", "a", "plate"), ("on", "c", "spot")}

    # An object that covers a corner of a region that has to be clear occupies it.
    corner = replace(OBJECTS[0], position=(-0.31, 0.1))
    for goal, occupied in ((Clear("plate"), True), (On("a", "plate"), False)):
        moved = Scene((corner, *OBJECTS[1:]), Goal((goal, HandsEmpty())), regions=(PLATE,))
        assert (("on", "a", "plate") in start_facts(moved)) is occupied


@pytest.mark.parametrize(
    ("facts", "holds"),
    [
        ((On("a", "plate"), HandsEmpty()), True),
        ((On("a", "plate"), On("b", "plate")), False),
        ((Clear("spot"),), True),
        ((Clear("plate"),), False),
        ((Holding("left", "a"),), False),
    ],
)
def test_goals_that_hold_at_the_start(facts: tuple[Any, ...], holds: bool) -> None:
    assert goal_holds_at_start(scene_with(*facts)) is holds


@pytest.mark.parametrize(
    ("facts", "shortest"),
    [
        ((On("b", "plate"), On("c", "plate"), HandsEmpty()), 4),
        ((On("a", "plate"), On("b", "plate")), 2),
        ((Clear("plate"),), 2),
        ((Clear("plate"), On("b", "spot")), 4),
        ((Holding("left", "b"), Holding("right", "c")), 2),
        ((Holding("left", "b"), Clear("plate")), 3),
    ],
)
def test_the_shortest_sequences(facts: tuple[Any, ...], shortest: int) -> None:
    grounding = ground_task(symbolic_task(scene_with(*facts)))
    assert grounding.reaches_goal_in(grounding.initial_state, shortest)
    assert not any(grounding.reaches_goal_in(grounding.initial_state, k) for k in range(shortest))


def test_the_order_of_facts_does_not_change_the_task() -> None:
    facts = (On("b", "plate"), On("c", "spot"), HandsEmpty())
    tasks = [symbolic_task(scene_with(*order)) for order in permutations(facts)]
    assert len({(frozenset(t.goal), frozenset(t.forbidden), t.initial) for t in tasks}) == 1


def test_an_extra_region_is_a_further_support() -> None:
    goal = OnRegion("b", Region((0.0, -0.3), 0.0, (0.2, 0.2)))
    scene = Scene(OBJECTS, goal, regions=(PLATE,))
    assert scene_from_json(scene_to_json(scene)) == scene
    supports = {action.arguments[-1] for action in ground_task(symbolic_task(scene)).actions}
    assert {"table", "goal", "plate"} <= supports
