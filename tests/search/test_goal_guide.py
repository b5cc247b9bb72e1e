"""Best-first search for several facts: the ranks of a network that knows one fact at a time, and completeness."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dvr_jax.goals import Goal, HandsEmpty, On, OnRegion, Region
from dvr_jax.logic import Action, enumerate_sequences
from dvr_jax.operators import OPERATORS
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.types import FixedBody, Scene, SceneObject
from dvr_jax.search.front import PrefixFront
from dvr_jax.search.goal_guide import GoalGuide, action_for_fact, scene_of_fact
from dvr_jax.search.node import Node
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree

PLATE = Region((-0.2, 0.0), 0.1, (0.2, 0.2), "plate")
TRAY = Region((0.3, -0.2), 0.0, (0.3, 0.2), "tray")


def box(name: str, x: float, y: float) -> SceneObject:
    return SceneObject(name, "box", (0.05, 0.07, 0.08), (x, y), 0.3)


FACTS = (On("a", "plate"), On("b", "tray"))
SCENE = Scene(
    (box("a", -0.2, 0.3), box("b", -0.4, 0.3)),
    Goal((*FACTS, HandsEmpty())),
    regions=(PLATE, TRAY),
)


def open_tree(k_max: int) -> SequenceTree:
    """A tree whose windows all count as feasible."""
    tree = SequenceTree(SCENE, k_max)
    tree.relaxation.walks.is_open = lambda name: lambda edge: True  # type: ignore[method-assign]
    tree.relaxation.check_cached = lambda node: True  # type: ignore[method-assign]
    tree.relaxation._limit = k_max
    tree.relaxation.lower_bound = 4
    return tree


class Network:
    """Knows the goal's object: its actions get 0.9, others 0.1; a hidden state counts the actions since its start."""

    def render(self, scene: Scene) -> Any:
        return scene.paper_goal

    def encode_scene(self, scene: Scene, grounding: Any, images: Any) -> Any:
        assert images == scene.paper_goal
        encoding = SimpleNamespace(goal=images, actions=grounding.actions)
        encoding.initial_hidden = lambda: np.zeros((1, 1))
        return encoding

    def predict(self, encoding: Any, hidden: Any, actions: Sequence[int]) -> tuple[Any, Any]:
        chosen = [encoding.actions[index] for index in actions]
        likes = np.array([0.9 if encoding.goal.object in a.arguments else 0.1 for a in chosen])
        # A place on the goal region is better than one on the table.
        likes += np.array([0.05 * (a.arguments[-1] == "goal") for a in chosen])
        return likes - 0.01 * hidden[0, 0], hidden + np.ones((len(chosen), 1))


def descend(tree: SequenceTree, *texts: str) -> Node:
    node = tree.root
    for text in texts:
        action = Action.parse(text)
        node = next(child for child in tree.expand(node) if child.actions[-1] == action)
    return node


def ranks(tree: SequenceTree, guide: Any, node: Node) -> dict[str, float]:
    children = tree.expand(node)
    found = guide.rank(node, children)
    return {str(c.actions[-1]): rank for c, rank in zip(children, found, strict=True)}


def test_the_scene_of_a_fact_is_one_of_the_paper() -> None:
    scene = scene_of_fact(SCENE, FACTS[1])
    assert isinstance(scene.goal, OnRegion) and scene.goal.object == "b" and not scene.regions
    assert scene.goal.region.position == TRAY.position
    renamed = [
        str(action_for_fact(Action.parse(f"place(left, a, {where})"), FACTS[1], OPERATORS))
        for where in ("tray", "plate", "table")
    ]
    assert renamed == ["place(left, a, goal)", "place(left, a, table)", "place(left, a, table)"]


def test_the_network_sees_a_raised_region_at_its_height() -> None:
    bench = FixedBody("bench", "box", (0.3, 0.3, 0.2), (-0.1, 0.5, 0.1), 0.0)
    upper = Region((-0.1, 0.5), 0.0, (0.2, 0.2), "upper", support="bench")
    scene = replace(SCENE, fixed=(bench,), regions=(*SCENE.regions, upper))
    asked = scene_of_fact(scene, On("b", "upper"))
    alone = replace(scene, regions=(upper,))
    assert np.array_equal(render_depth(asked).goal_mask, render_depth(alone).goal_mask)


def test_an_action_ranks_as_high_as_for_the_open_fact_that_it_serves_best() -> None:
    tree = open_tree(6)
    guide = GoalGuide(tree, Network())  # type: ignore[arg-type, var-annotated]
    first = ranks(tree, guide, tree.root)
    assert set(first.values()) == {0.9}

    # In the hand, `a` is wanted on the plate; the network for `b` would put it on the tray.
    holding = ranks(tree, guide, descend(tree, "grasp(left, +x, a)"))
    assert holding["place(left, a, plate)"] == pytest.approx(0.94)
    assert holding["place(left, a, plate)"] > holding["place(left, a, tray)"]

    # After `a` was delivered only `b` counts, and its history begins anew.
    delivered = descend(tree, "grasp(left, +x, a)", "place(left, a, plate)")
    after = ranks(tree, guide, delivered)
    assert after["grasp(left, +x, b)"] == pytest.approx(0.9)
    assert after["grasp(left, +x, a)"] == pytest.approx(0.1)

    # With `b` in the other hand, the history goes on.
    both = descend(tree, "grasp(right, +x, b)", "grasp(left, +x, a)", "place(left, a, plate)")
    assert ranks(tree, guide, both)["place(right, b, tray)"] == pytest.approx(0.95 - 0.03)


class PassingSession(SearchSession):
    """A search all of whose prefixes are feasible."""

    def judge_children(self, nodes: list[Node]) -> Any:
        yield from ()
        return nodes


def all_leaves(tree: SequenceTree, guide: Any) -> list[tuple[Action, ...]]:
    session = PassingSession(tree, lambda *_: True, lambda _: None)
    front = PrefixFront(session, guide)
    found = []
    while len(front):
        steps = front.advance(10)
        with pytest.raises(StopIteration) as stop:
            next(steps)
        found += [leaf.actions for leaf in stop.value.value]
    return found


@pytest.mark.parametrize("is_guided", [False, True])
def test_the_front_finds_every_sequence_the_short_ones_first(is_guided: bool) -> None:
    tree = open_tree(4)
    guide = GoalGuide(tree, Network()) if is_guided else None  # type: ignore[arg-type]
    found = all_leaves(tree, guide)
    actions = tree.grounding.actions
    wanted = {
        tuple(actions[index] for index in sequence)
        for length in range(5)
        for sequence in enumerate_sequences(tree.grounding, length)
    }
    assert len(found) == len(set(found)) and set(found) == wanted
    lengths = [len(sequence) for sequence in found]
    assert lengths == sorted(lengths)


def test_a_delivered_object_is_not_moved_while_a_shorter_way_is_left() -> None:
    found = all_leaves(open_tree(4), None)
    for sequence in found:
        assert sorted(action.operator for action in sequence) == [
            "grasp",
            "grasp",
            "place",
            "place",
        ]
