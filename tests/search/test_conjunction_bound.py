"""The lower bound for goals of several facts: never above the shortest sequence, whatever was done before."""

from typing import Any

import numpy as np
import pytest

from dvr_jax.goals import Clear, Goal, HandsEmpty, Holding, On, Region
from dvr_jax.operators import ground_scene
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.search.conjunction_bound import ConjunctionBound, free_arms_at_end
from dvr_jax.search.tree import SequenceTree

PLATE = Region((-0.2, 0.0), 0.1, (0.2, 0.2), "plate")
TRAY = Region((0.3, -0.2), 0.0, (0.3, 0.2), "tray")


def box(name: str, x: float, y: float) -> SceneObject:
    return SceneObject(name, "box", (0.05, 0.07, 0.08), (x, y), 0.3)


OBJECTS = (box("a", -0.2, 0.02), box("b", -0.3, 0.3), box("c", 0.3, 0.1))

GOALS = [
    (On("b", "plate"), On("c", "plate")),
    (On("b", "plate"), On("c", "tray"), HandsEmpty()),
    (On("a", "plate"), On("b", "plate")),
    (On("a", "plate"), On("b", "tray"), HandsEmpty()),
    (Clear("plate"), On("b", "tray")),
    (Clear("plate"), HandsEmpty()),
    (Holding("left", "b"), On("c", "tray")),
    (Holding("left", "a"), Holding("right", "b")),
]


def open_tree(facts: tuple[Any, ...]) -> SequenceTree:
    """A tree whose windows all count as feasible, so that the bound is that of the logic alone."""
    scene = Scene(OBJECTS, Goal(facts), regions=(PLATE, TRAY))
    tree = SequenceTree(scene, k_max=8)
    tree.relaxation.walks.is_open = lambda name: lambda edge: True  # type: ignore[method-assign]
    tree.relaxation._limit = 8
    return tree


def shortest_from(tree: SequenceTree, state: int) -> int:
    return next(k for k in range(20) if tree.grounding.reaches_goal_in(state, k))


@pytest.mark.parametrize("facts", GOALS)
def test_no_sequence_is_shorter_than_the_bound(facts: tuple[Any, ...]) -> None:
    tree = open_tree(facts)
    assert isinstance(tree.relaxation, ConjunctionBound)
    start = tree.grounding.initial_state
    assert tree.relaxation.remaining(()) == shortest_from(tree, start)

    generator = np.random.default_rng(0)
    exact = 0
    for _ in range(60):
        state = start
        prefix: list[Any] = []
        for _ in range(int(generator.integers(1, 6))):
            if tree.grounding.is_goal(state):
                break
            index = int(generator.choice(tree.grounding.applicable(state)))
            state = tree.grounding.successor(state, index)
            prefix.append(tree.grounding.actions[index])
        if tree.grounding.is_goal(state):
            continue
        bound = tree.relaxation.remaining(prefix)
        needed = shortest_from(tree, state)
        assert bound <= needed
        exact += bound == needed
    # The bound leaves out that hands are full, and little else.
    assert exact > 30


def test_an_object_that_is_needed_no_more_raises_the_bound_when_it_is_moved() -> None:
    tree = open_tree((On("b", "plate"), On("c", "plate"), HandsEmpty()))
    actions = tree.grounding.actions
    words = {str(action): action for action in actions}
    deliver = [words["grasp(left, +x, b)"], words["place(left, b, plate)"]]
    assert tree.relaxation.remaining(deliver) == 2
    assert tree.relaxation.remaining([*deliver, words["grasp(left, +x, b)"]]) == 3
    assert tree.relaxation.remaining([*deliver, words["grasp(left, +x, a)"]]) == 3


@pytest.mark.parametrize(
    ("facts", "free"),
    [
        ((On("b", "plate"), On("c", "plate")), 1),
        ((On("b", "plate"), HandsEmpty()), 0),
        ((On("b", "plate"), Holding("left", "c")), 1),
        ((Clear("plate"),), 2),
        ((Holding("left", "a"), Holding("right", "b")), 0),
    ],
)
def test_arms_that_may_hold_an_object_at_the_end(facts: tuple[Any, ...], free: int) -> None:
    tree = open_tree(facts)
    scene = tree.scene
    assert free_arms_at_end(scene, tree.relaxation.conditions) == free  # type: ignore[attr-defined]
    ends = {
        sum(fact[0] == "holding" for fact in tree.grounding.facts_in(state))
        for state in _ends(tree, 5)
    }
    named = sum(isinstance(fact, Holding) for fact in facts)
    assert max(ends) - named <= free
    # An object on a region that has to be clear has to be put down, so the last action is a place there too.
    assert max(ends) - named == free or isinstance(facts[0], Clear)
    assert ground_scene(scene).goal_forbidden == tree.grounding.goal_forbidden


def _ends(tree: SequenceTree, length: int) -> set[int]:
    """All states in which the goal first holds after at most so many actions."""
    states = {tree.grounding.initial_state}
    found: set[int] = set()
    for _ in range(length):
        states = {
            tree.grounding.successor(state, index)
            for state in states
            for index in tree.grounding.applicable(state)
        }
        ends = {state for state in states if tree.grounding.is_goal(state)}
        found |= ends
        states -= ends
    return found
