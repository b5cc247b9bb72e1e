"""Raised supports in the planner: heights of placements, clearances from what objects stand on, proposals, reach."""

import jax
import numpy as np
import pytest
from nlp_cases import grasp, place

from dvr_jax.goals import Clear, Goal, On, Region
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.body_clearances import STANDING_ROOM, PhasePart
from dvr_jax.nlp.collision_rows import object_pairs
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators import OPERATORS, operator_of
from dvr_jax.operators.proposal import UNIFORM_NUMBERS, ObjectBefore, ProposedPoses
from dvr_jax.scene.types import FixedBody, Scene, SceneObject
from dvr_jax.search.obstruction import obstructions
from dvr_jax.search.reach import missing_reach, reach_of
from dvr_jax.seeds.beam_batches import beam_step

BENCH = FixedBody("bench", "box", (0.3, 0.2, 0.12), (-0.2, 0.3, 0.06), 0.0)
UPPER = Region((-0.2, 0.3), 0.0, (0.2, 0.15), "upper", support="bench")
GROUND = Region((-0.2, 0.3), 0.0, (0.2, 0.15), "ground")
RAISED = SceneObject("raised", "box", (0.05, 0.07, 0.08), (-0.2, 0.3), 0.2, support="bench")
LOW = SceneObject("low", "box", (0.05, 0.07, 0.10), (-0.2, -0.2), 0.2)
SCENE = Scene((RAISED, LOW), Goal((On("low", "upper"),)), fixed=(BENCH,), regions=(UPPER, GROUND))
ACTIONS = [
    grasp("left", "+x", "raised"),
    place("left", "raised", "table"),
    grasp("left", "+x", "low"),
    place("left", "low", "upper"),
]
HEIGHT = 0.12


@pytest.fixture
def problem() -> Problem:
    return transcribe(SCENE, ACTIONS)


def clearances_of(problem: Problem, item: int) -> dict[str, list[float]]:
    """Clearances of an object and the bench in all phases, by the part of the phase."""
    first, second = object_pairs(2, 1)
    [pair] = np.flatnonzero((first == item) & (second == 2))
    of_pairs = problem.phase_clearance[:, :, -len(first) :]
    return {part.name: of_pairs[:, part, pair].tolist() for part in PhasePart}


def test_heights_are_constants(problem: Problem) -> None:
    np.testing.assert_allclose(problem.initial_pose[:, 2], [HEIGHT + 0.04, 0.05])
    for bounds in (problem.parameter_lower, problem.parameter_upper):
        np.testing.assert_allclose(bounds[[1, 3], 3], [0.0, HEIGHT])


def test_an_object_may_touch_its_support_and_keeps_its_distance_otherwise(problem: Problem) -> None:
    """Before and after each action: raised stands, is held, stands on the table; low is placed on the bench last."""
    wanted = SCENE.workcell.clearances.object_to_object
    raised = clearances_of(problem, 0)
    assert raised["MIDDLE"] == [-STANDING_ROOM, wanted, wanted, wanted, wanted]
    assert raised["START"] == [-STANDING_ROOM, 0, wanted, wanted, wanted]
    assert raised["END"] == [-STANDING_ROOM, wanted, wanted, wanted, wanted]
    low = clearances_of(problem, 1)
    assert low["MIDDLE"] == [wanted, wanted, wanted, wanted, -STANDING_ROOM]
    assert low["START"] == [wanted, wanted, wanted, wanted, -STANDING_ROOM]
    assert low["END"] == [wanted, wanted, wanted, 0, -STANDING_ROOM]


def proposed(problem: Problem, k: int, kind: ModeKind, parameters: list[float]) -> ProposedPoses:
    """Proposals of action k for one candidate with these parameters of the object before it."""
    proposal = operator_of(ACTIONS[k], OPERATORS).proposal(kind)
    prefix = transcribe(SCENE, ACTIONS[: k + 1])
    step = jax.tree.map(lambda leaf: np.asarray(leaf)[None], beam_step(prefix, proposal))
    before = ObjectBefore(
        np.array([kind], np.int32),
        np.zeros(1, np.float32),
        np.array([[parameters]], np.float32),
    )
    uniform = np.random.default_rng(0).random((UNIFORM_NUMBERS, 1, 64), np.float32)
    return proposal.propose(step, before, uniform)


def test_placements_are_at_the_height_of_the_support(problem: Problem) -> None:
    """With a grasp at the object's center from above, the gripper is at the center of the placed object."""
    found = proposed(problem, 3, ModeKind.HELD, [0, 0, 0, 0])
    np.testing.assert_allclose(np.asarray(found.m)[3], HEIGHT, atol=1e-6)
    np.testing.assert_allclose(np.asarray(found.position)[0, 2], HEIGHT + 0.05, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "bottom"), [(ModeKind.FIXED, HEIGHT), (ModeKind.PLACED, 0.0), (ModeKind.PLACED, 0.3)]
)
def test_grasps_are_at_the_height_at_which_the_object_stands(
    problem: Problem, kind: ModeKind, bottom: float
) -> None:
    found = proposed(problem, 0, kind, [0.1, 0.2, 0.3, bottom])
    m = np.asarray(found.m)
    height = np.asarray(found.position)[0, 2]
    # The second parameter is the height of the gripper's center in the object's frame.
    np.testing.assert_allclose(height, bottom + 0.04 + m[1], atol=1e-6)


def test_a_region_on_another_body_is_not_kept_clear() -> None:
    goal = Goal((Clear("ground"), On("low", "upper")))
    scene = Scene(SCENE.objects, goal, fixed=SCENE.fixed, regions=SCENE.regions)
    kept = transcribe(scene, ACTIONS).kept_clear
    assert np.abs(kept[1]).max() > 0
    assert np.abs(kept[3]).max() == 0


def test_what_stands_on_another_body_is_no_obstruction() -> None:
    large = SceneObject("large", "box", (0.2, 0.15, 0.08), (-0.2, 0.3), 0.0, support="bench")
    scene = Scene((large, LOW), SCENE.goal, fixed=SCENE.fixed, regions=SCENE.regions)
    assert list(obstructions(scene, "low", "upper")) == ["large"]
    assert obstructions(scene, "low", "ground") == {}


def test_reach_ends_at_the_height_of_the_support() -> None:
    """A column that is higher than the arm reaches makes its top unreachable."""
    reach = reach_of(SCENE.workcell.robot)
    for height, is_reached in ((0.3, True), (reach + 0.6, False)):
        column = FixedBody("bench", "box", (0.3, 0.2, height), (-0.4, 0.3, height / 2), 0.0)
        region = Region((-0.4, 0.3), 0.0, (0.2, 0.15), "upper", support="bench")
        scene = Scene((LOW,), SCENE.goal, fixed=(column,), regions=(region,))
        missing = missing_reach(scene, (ACTIONS[2], ACTIONS[3]), OPERATORS)
        assert (missing <= 0) is is_reached
