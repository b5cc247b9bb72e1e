"""Lower bounds of scenes with stacks, against the shortest sequences of the logic."""

from typing import Any

import pytest
from stack_cases import CASES, PAIR, PILE, PLATE, scene_of

from dvr_jax.goals import HandsEmpty, Holding, On, OnRegion, Region
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.search.object_graph import UNREACHED
from dvr_jax.search.tree import SequenceTree


def logical_tree(scene: Scene) -> SequenceTree:
    """A tree whose windows all count as feasible, so that its bounds are those of the logic alone."""
    tree = SequenceTree(scene, k_max=8)
    tree.relaxation.windows.verdict = lambda window, ignored: True  # type: ignore[method-assign]
    assert not list(tree.relaxation.compute(8))
    return tree


@pytest.mark.parametrize(("objects", "facts", "least"), CASES)
def test_the_lower_bound_is_not_above_the_shortest_sequence(
    objects: tuple[SceneObject, ...], facts: tuple[Any, ...], least: int
) -> None:
    tree = logical_tree(scene_of(objects, facts))
    assert tree.relaxation.lower_bound <= least
    assert tree.relaxation.remaining(()) <= least
    for index in tree.grounding.applicable(tree.grounding.initial_state):
        state = tree.grounding.successor(tree.grounding.initial_state, index)
        if tree.grounding.is_goal(state):
            continue
        needed = next((k for k in range(10) if tree.grounding.reaches_goal_in(state, k)), UNREACHED)
        assert tree.relaxation.remaining([tree.grounding.actions[index]]) <= needed


@pytest.mark.parametrize(
    ("objects", "facts", "bound"),
    [
        (PAIR, (Holding("left", "a"),), 2),
        (PAIR, (On("a", "c"), HandsEmpty()), 4),
        (PILE, (On("a", "plate"), HandsEmpty()), 6),
    ],
)
def test_what_stands_on_an_object_has_to_be_moved(
    objects: tuple[SceneObject, ...], facts: tuple[Any, ...], bound: int
) -> None:
    assert logical_tree(scene_of(objects, facts)).relaxation.lower_bound == bound


def test_what_stands_on_the_object_of_the_papers_goal_has_to_be_moved() -> None:
    """It may be in the other hand when the object is placed."""
    scene = Scene(PAIR, OnRegion("a", Region(PLATE.position, 0.0, PLATE.size)))
    assert logical_tree(scene).relaxation.lower_bound == 3
