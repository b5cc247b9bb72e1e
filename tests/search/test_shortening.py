"""Sequences without needless actions are subsequences that the logic allows, at any face."""

from relaxation_cases import NEEDLESS_GRASP, single

from dvr_jax.logic import Action
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.shortening import shorter_leaves
from dvr_jax.search.tree import SequenceTree


def shorter(scene: Scene, *texts: str) -> set[tuple[str, ...]]:
    """The shorter sequences of one, without any verdict of a bound."""
    tree = SequenceTree(scene, 6, is_relaxed=False)
    node = tree.root
    for text in texts:
        (node,) = [child for child in tree.expand(node) if child.actions[-1] == Action.parse(text)]
    assert node.reaches_goal
    found: list[Node] = shorter_leaves(tree, node)
    assert all(each.reaches_goal for each in found)
    return {tuple(map(str, each.actions)) for each in found}


def test_a_grasp_of_a_bystander_is_left_out() -> None:
    needed = ("grasp(left, +x, a)", "place(left, a, goal)")
    assert shorter(NEEDLESS_GRASP, "grasp(right, +x, b)", *needed) == {needed}


def test_two_actions_cannot_be_shortened() -> None:
    assert not shorter(NEEDLESS_GRASP, "grasp(left, +x, a)", "place(left, a, goal)")


def test_what_remains_may_be_grasped_at_another_face() -> None:
    scene = single((0.05, 0.05, 0.05), (-0.4, 0.35))
    texts = (
        "grasp(left, +x, cube)",
        "place(left, cube, table)",
        "grasp(left, +y, cube)",
        "place(left, cube, goal)",
    )
    faces = ("+x", "-x", "+y", "-y")
    assert shorter(scene, *texts) == {
        (f"grasp(left, {face}, cube)", "place(left, cube, goal)") for face in faces
    }


def test_a_handover_that_needs_both_arms_is_left_out_only_where_the_logic_allows() -> None:
    scene = single((0.05, 0.05, 0.05), (-0.4, 0.35))
    found = shorter(
        scene, "grasp(left, +x, cube)", "grasp(right, +y, cube)", "place(right, cube, goal)"
    )
    assert found == {
        (f"grasp(right, {face}, cube)", "place(right, cube, goal)")
        for face in ("+x", "-x", "+y", "-y")
    }
