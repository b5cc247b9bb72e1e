"""Grounded scenes with stacks, against a model of stacks in plain Python."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import pytest
from stack_cases import APART, CASES, PAIR, PLATE, TABLE, scene_of

from dvr_jax.errors import DvrError
from dvr_jax.goals import On, OnRegion
from dvr_jax.logic import Action
from dvr_jax.operators import ground_scene
from dvr_jax.scene.types import Scene, SceneObject

ARMS = ("left", "right")


@dataclass(frozen=True)
class State:
    """Where every object is: on a support, or in a hand, written as "@left"."""

    places: tuple[tuple[str, str], ...]

    @property
    def of(self) -> dict[str, str]:
        return dict(self.places)

    def put(self, name: str, place: str) -> "State":
        return State(tuple(sorted({**self.of, name: place}.items())))

    def allows(self, action: Action) -> bool:
        arm, name = action.arguments[0], action.arguments[-1]
        if action.operator == "grasp":
            return f"@{arm}" not in self.of.values() and name not in self.of.values()
        _, name, support = action.arguments
        is_free = support not in self.of or (
            support not in self.of.values() and not self.of[support].startswith("@")
        )
        return self.of[name] == f"@{arm}" and name != support and is_free

    def after(self, action: Action) -> "State":
        if action.operator == "grasp":
            return self.put(action.arguments[-1], f"@{action.arguments[0]}")
        return self.put(action.arguments[1], action.arguments[2])


def all_actions(scene: Scene, tops: set[str]) -> list[Action]:
    grasps = product(ARMS, ("+x", "+y", "-x", "-y"), scene.object_names)
    places = product(ARMS, scene.object_names, (TABLE, "plate", *tops))
    return [Action("grasp", a) for a in grasps] + [Action("place", a) for a in places]


@pytest.mark.parametrize(("objects", "facts", "least"), CASES)
def test_the_same_actions_apply_in_all_states(
    objects: tuple[SceneObject, ...], facts: tuple[Any, ...], least: int
) -> None:
    scene = scene_of(objects, facts)
    grounding = ground_scene(scene)
    tops = {fact.support for fact in facts if isinstance(fact, On)} - {"plate"}
    tops |= {item.support for item in objects} - {TABLE}
    actions = all_actions(scene, tops)

    start = State(tuple(sorted((item.name, item.support) for item in objects)))
    level = {(start, grounding.initial_state)}
    seen = set(level)
    while level:
        found = set()
        for model, state in level:
            allowed = {str(action) for action in actions if model.allows(action)}
            assert {str(grounding.actions[i]) for i in grounding.applicable(state)} == allowed
            for index in grounding.applicable(state):
                after = grounding.successor(state, index)
                found.add((model.after(grounding.actions[index]), after))
        level = found - seen
        seen |= found
    # Each state of the model belongs to one state of the grounding, but for what it starts with.
    assert len({model for model, _ in seen}) > 30
    assert grounding.reaches_goal_in(grounding.initial_state, least)
    assert not grounding.can_reach_goal(grounding.initial_state, least - 1)


def test_the_papers_goal_with_a_stack_at_the_start() -> None:
    goal = OnRegion("a", replace(PLATE, name="goal"))
    scene = Scene(PAIR, goal)
    grounding = ground_scene(scene)
    assert grounding.reaches_goal_in(grounding.initial_state, 3)
    assert not grounding.can_reach_goal(grounding.initial_state, 2)
    with pytest.raises(DvrError, match=r"on\(b, a\) holds"):
        grounding.apply([Action("grasp", ("left", "+x", "a"))])


def test_a_scene_without_stacks_has_no_objects_as_supports() -> None:
    grounding = ground_scene(scene_of(APART, (On("a", "plate"),)))
    assert {a.arguments[2] for a in grounding.actions if a.operator == "place"} == {TABLE, "plate"}
