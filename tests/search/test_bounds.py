"""The bounds of the tree say "feasible" only of what is."""

import jax

from dvr_jax.scene.types import Goal, Region, Scene, SceneObject
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone


def verdicts_of_goal_sequences(side: float) -> list[bool | None]:
    """Sequence bound of all grasps and places of one 5 x 15 cm box onto a square region with this side [m]."""
    box = SceneObject("a", "box", (0.05, 0.15, 0.1), (-0.2, 0.1), 0.3)
    scene = Scene((box,), Goal("a", Region((-0.1, -0.2), 0.2, (side, side))))
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max=2)
        grasps = tree.expand(tree.root)
        run_alone(tree.judge_sequences(grasps))
        places = [place for grasp in grasps if grasp.feasible for place in tree.expand(grasp)]
        run_alone(tree.judge_sequences(places))
    assert places
    return [place.feasible for place in places]


def test_a_cylinder_is_grasped_at_one_face_for_all() -> None:
    box = SceneObject("a", "box", (0.05, 0.05, 0.1), (-0.3, 0.3), 0.3)
    can = SceneObject("b", "cylinder", (0.03, 0.1), (-0.3, -0.3), 0.0)
    tree = SequenceTree(Scene((box, can), Goal("a", Region((-0.1, -0.2), 0.2, (0.1, 0.1)))), k_max=3)
    grasped = [child.actions[0].arguments[1:] for child in tree.expand(tree.root)]
    assert grasped.count(("+x", "b")) == 2 and len([name for _, name in grasped if name == "b"]) == 2
    assert len([name for _, name in grasped if name == "a"]) == 8


def test_an_object_larger_than_its_region_is_refuted() -> None:
    assert not any(verdicts_of_goal_sequences(0.10))


def test_an_object_that_fits_its_region_is_not() -> None:
    assert any(verdicts_of_goal_sequences(0.22))
