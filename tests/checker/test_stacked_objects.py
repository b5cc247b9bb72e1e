"""The check of stacks, with motions made by hand: a cube is put on another one, or beside it, or is moved under it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from puppet import OPEN, Case, Puppet, hand

from dvr_jax.checker import check_motion
from dvr_jax.checker.shapes import Outline
from dvr_jax.checker.supports import distance_beyond
from dvr_jax.errors import MotionError
from dvr_jax.goals import Goal, HandsEmpty, On
from dvr_jax.logic import Action
from dvr_jax.motion import make_motion
from dvr_jax.scene.layout import home_qpos, qpos_layout
from dvr_jax.scene.types import Scene, SceneObject

SIZE = 0.05
LOWER = SceneObject("lower", "box", (SIZE, SIZE, SIZE), (-0.2, -0.2), 0.0)
UPPER = SceneObject("upper", "box", (SIZE, SIZE, SIZE), (-0.2, 0.2), 0.0)
STACK = (Action("grasp", ("left", "+x", "upper")), Action("place", ("left", "upper", "lower")))
TABLE_INSTEAD = Action("place", ("left", "upper", "table"))
GOAL = Goal((On("upper", "lower"), HandsEmpty()))
ABOVE = hand((1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def carry(puppet: Puppet, index: int, start: tuple[float, ...], end: tuple[float, ...]) -> None:
    """The left arm carries a cube from one place of its center to another, high above the rest."""
    high = 0.3
    puppet.reach(0, ABOVE, np.array([*start[:2], high]))
    puppet.reach(0, ABOVE, np.array(start))
    puppet.fingers(0, SIZE / 2)
    puppet.attach(0, index)
    puppet.reach(0, ABOVE, np.array([*start[:2], high]))
    puppet.reach(0, ABOVE, np.array([*end[:2], high]))
    puppet.reach(0, ABOVE, np.array(end))
    puppet.release(index)
    puppet.fingers(0, OPEN)
    puppet.reach(0, ABOVE, np.array([*end[:2], high]))


@cache
def stacked(x: float = -0.2, height: float = SIZE) -> Case:
    scene = Scene((LOWER, UPPER), GOAL)
    puppet = Puppet(scene)
    carry(puppet, 1, (-0.2, 0.2, SIZE / 2), (x, -0.2, height + SIZE / 2))
    return Case(scene, STACK, puppet.motion())


def kinds(case: Case) -> set[str]:
    report = check_motion(case.scene, case.actions, case.motion)
    assert report.passed == (not report.findings)
    return {finding.kind for finding in report.findings}


def test_a_stack_passes() -> None:
    assert kinds(stacked()) == set()


def test_a_center_within_the_margin_passes_and_one_beyond_is_refused() -> None:
    """The top ends 25 mm from its center, of which 5 mm are margin; the check tolerates 2 mm of it."""
    assert kinds(stacked(-0.181)) == set()
    assert kinds(stacked(-0.175)) == {"off top"}


def test_an_upper_object_in_the_air_is_refused() -> None:
    assert kinds(stacked(-0.2, SIZE + 0.006)) == {"support height"}


def test_the_place_of_the_lower_object_counts() -> None:
    """It is moved in the states of the motion, and the scene starts there."""
    case = stacked()
    lower = replace(LOWER, position=(-0.17, -0.2))
    qpos = case.motion.qpos.copy()
    qpos[:, qpos_layout(case.scene).objects[0][0]] += 0.03
    moved = replace(
        case,
        scene=replace(case.scene, objects=(lower, UPPER)),
        motion=replace(case.motion, qpos=qpos),
    )
    assert kinds(moved) == {"off top"}


def test_a_lower_object_that_moves_under_the_upper_one_is_refused() -> None:
    """It slides by 4 mm after the upper cube was put there."""
    case = stacked()
    qpos = case.motion.qpos.copy()
    after = case.motion.switch[1] + 5
    qpos[after:, qpos_layout(case.scene).objects[0][0]] += 0.004
    assert kinds(replace(case, motion=replace(case.motion, qpos=qpos))) == {"standing shift"}


def test_an_action_on_a_lower_object_is_refused() -> None:
    case = stacked()
    twice = replace(
        case.motion, switch=np.array([*case.motion.switch, *case.motion.switch[-1:] + 9])
    )
    again = (*case.actions, Action("grasp", ("left", "+x", "lower")))
    with pytest.raises(MotionError, match=r"action 3, .*upper stands on lower, so lower cannot be"):
        check_motion(case.scene, again, twice)

    start = (LOWER, replace(UPPER, position=LOWER.position, support="lower"))
    with pytest.raises(MotionError, match=r"action 1, .*upper stands on lower"):
        check_motion(replace(case.scene, objects=start), again[2:] * 2, case.motion)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (
            (("grasp", "right", "+x", "lower"), *[(a.operator, *a.arguments) for a in STACK]),
            "an arm holds lower, so nothing can be placed on it",
        ),
        (
            (("grasp", "left", "+x", "lower"), ("place", "left", "lower", "lower")),
            "lower cannot stand on itself",
        ),
        (
            (
                ("grasp", "left", "+x", "third"),
                ("place", "left", "third", "lower"),
                ("grasp", "left", "+x", "upper"),
                ("place", "left", "upper", "lower"),
            ),
            "third stands on lower already, so upper has no room there",
        ),
    ],
)
def test_a_place_where_none_is_refused(actions: tuple[tuple[str, ...], ...], message: str) -> None:
    third = replace(UPPER, name="third", position=(0.2, 0.3))
    scene = Scene((LOWER, UPPER, third), Goal((On("upper", "lower"),)))
    states = np.repeat(home_qpos(scene)[None], 20, axis=0)
    still = make_motion(0.02 * np.arange(20), states, 5 + np.arange(len(actions)))
    named = tuple(Action(words[0], words[1:]) for words in actions)
    with pytest.raises(MotionError, match=message):
        check_motion(scene, named, still)


def test_the_goal_is_the_stack_and_not_the_table() -> None:
    """The same motion under another action: the cube is not on the table where it ends."""
    case = stacked()
    found = kinds(replace(case, actions=(STACK[0], TABLE_INSTEAD)))
    assert found == {"support height"}


def test_distances_beyond_an_outline() -> None:
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    for point, expected in (((0.0, 0.0), -1.0), ((0.9, 0.2), -0.1), ((1.5, -0.3), 0.5)):
        assert distance_beyond(np.array(point), Outline(square, 0.0)) == pytest.approx(expected)
    disc = Outline(np.array([[1.0, 0.0]]), 2.0)
    assert distance_beyond(np.array([4.0, 0.0]), disc) == pytest.approx(1.0)
