"""From actions to arrays: tables written out by hand, refutations, and what is refused."""

import math

import jax
import numpy as np
import pytest
from komo_cases import SCENE, grasp, place

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.nlp.problem import ABSENT, FIXED, HELD_LEFT, HELD_RIGHT, PLACED, Problem
from dvr_jax.nlp.transcription import ATTRACTION, GRASP_MARGIN, PITCH_LIMIT, grip_width, refute, transcribe
from dvr_jax.scene.files import Goal, Region, SceneObject, make_scene
from dvr_jax.workcell.constants import TABLE_HALF_EXTENTS

LEFT, RIGHT = HELD_LEFT, HELD_RIGHT


@pytest.fixture
def handover() -> Problem:
    """Left grasps yellow at +x (5 cm wide), right takes it at -y (16 cm: `transcribe` does not refute) and places it on
    the goal; then left grasps the can and puts it back on the table."""
    actions = [
        grasp("left", "+x", "yellow"),
        grasp("right", "-y", "yellow"),
        place("right", "yellow", "goal"),
        grasp("left", "+y", "can"),
        place("left", "can", "table"),
    ]
    return transcribe(SCENE, actions)


def test_attachments(handover: Problem) -> None:
    expected = [
        [FIXED, FIXED, FIXED],
        [LEFT, FIXED, FIXED],
        [RIGHT, FIXED, FIXED],
        [PLACED, FIXED, FIXED],
        [PLACED, LEFT, FIXED],
        [PLACED, PLACED, FIXED],
    ]
    by = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 3, 0], [2, 4, 0]]
    np.testing.assert_array_equal(handover.attachment, expected)
    np.testing.assert_array_equal(handover.attached_by, by)
    np.testing.assert_array_equal(handover.switched_object, [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(handover.is_grasp, [1, 1, 0, 1, 0])


def test_arms_at_rest(handover: Problem) -> None:
    """Both arms at a handover, else the one that acts."""
    np.testing.assert_array_equal(handover.resting, [[1, 0], [1, 1], [0, 1], [1, 0], [1, 0]])


def test_openings(handover: Problem) -> None:
    """Open when empty, else half the object's width along the closing axis: 5 cm at +x, 16 cm at -y, the can 7 cm."""
    expected = [[0.04, 0.04], [0.025, 0.04], [0.04, 0.08], [0.04, 0.04], [0.035, 0.04], [0.04, 0.04]]
    np.testing.assert_allclose(handover.opening, expected, atol=1e-15)


def test_faces_and_bounds(handover: Problem) -> None:
    np.testing.assert_allclose(handover.face_yaw, [0, 3 * math.pi / 2, 0, math.pi / 2, 0])
    """A cylinder's closing axis passes through its own: its yaw is free, its tangent pinned."""
    free = (handover.upper - handover.lower) > 100
    expected_free = [
        [False] * 4,
        [False] * 4,
        [True, True, True, False],
        [False, False, False, True],
        [True, True, True, False],
    ]
    np.testing.assert_array_equal(free, expected_free)
    # Along the face's tangent, along the height, pitch, yaw (pinned for boxes); 1 cm margin.
    np.testing.assert_allclose(handover.upper[0], [0.08 - GRASP_MARGIN, 0.05 - GRASP_MARGIN, PITCH_LIMIT, 0])
    np.testing.assert_allclose(handover.upper[1], [0.025 - GRASP_MARGIN, 0.05 - GRASP_MARGIN, PITCH_LIMIT, 0])
    np.testing.assert_allclose(handover.upper[3, :3], [0, 0.07 - GRASP_MARGIN, PITCH_LIMIT])
    np.testing.assert_array_equal(handover.lower[:2], -handover.upper[:2])
    np.testing.assert_array_equal(handover.lower[[2, 4], 3], 0)
    np.testing.assert_array_equal(handover.upper[[2, 4], 3], 0)


def test_supports(handover: Problem) -> None:
    np.testing.assert_allclose(handover.support[2], [0.3, -0.25, 0.4, 0.11, 0.1])
    np.testing.assert_allclose(handover.support[4], [0, 0, 0, *TABLE_HALF_EXTENTS])


def test_shapes_and_start(handover: Problem) -> None:
    np.testing.assert_allclose(handover.half, [[0.025, 0.08, 0.05, 0], [0, 0, 0.07, 0.035], [0.03, 0.03, 0.09, 0]])
    np.testing.assert_allclose(handover.initial_pose[0], [-0.15, 0.22, 0.05, 0.5])
    np.testing.assert_allclose(handover.initial_pose[1], [0.12, -0.2, 0.07, 0])
    np.testing.assert_allclose(handover.home, np.ravel(SCENE.home))
    np.testing.assert_array_equal(handover.reference, np.tile(handover.home, (5, 1)))
    np.testing.assert_array_equal(handover.attraction, np.full((5, 14), ATTRACTION))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(handover))


def test_ignored_objects_are_absent() -> None:
    problem = transcribe(SCENE, [grasp("left", "+x", "yellow")], ignored=["can", "green"])
    np.testing.assert_array_equal(problem.attachment, [[FIXED, ABSENT, ABSENT], [LEFT, ABSENT, ABSENT]])


def test_an_unknown_operator_is_refused_by_name() -> None:
    with pytest.raises(DvrError, match=r"'push'.*registered: grasp, place"):
        transcribe(SCENE, [Action("push", ("left", "yellow"))])


def test_no_action_is_refused() -> None:
    with pytest.raises(DvrError, match="no action"):
        transcribe(SCENE, [])


SIZES = make_scene(
    [
        SceneObject("wide", "box", (0.081, 0.05, 0.1), (-0.3, 0.3), 0.0),
        SceneObject("edge", "box", (0.08, 0.03, 0.1), (0.0, 0.3), 0.0),
        SceneObject("drum", "cylinder", (0.041, 0.1), (0.3, 0.3), 0.0),
        SceneObject("pin", "cylinder", (0.009, 0.1), (-0.3, -0.3), 0.0),
        SceneObject("slab", "box", (0.05, 0.05, 0.019), (0.0, -0.3), 0.0),
        SceneObject("blade", "box", (0.05, 0.019, 0.1), (0.3, -0.3), 0.0),
    ],
    Goal("edge", Region((0, 0), 0, (0.2, 0.2))),
)


@pytest.mark.parametrize("face", ["+x", "-x"])
def test_too_wide_at_its_x_faces_only(face: str) -> None:
    assert "8.1 cm" in refute(SIZES, grasp("left", face, "wide"))
    assert "wide" in refute(SIZES, grasp("left", face, "wide"))
    assert refute(SIZES, grasp("left", face.replace("x", "y"), "wide")) is None
    assert refute(SIZES, grasp("left", face, "edge")) is None


@pytest.mark.parametrize("face", ["+x", "+y", "-x", "-y"])
def test_too_wide_or_too_small_all_around(face: str) -> None:
    assert "8.2 cm" in refute(SIZES, grasp("right", face, "drum"))
    assert "too small" in refute(SIZES, grasp("right", face, "pin"))
    assert "too small" in refute(SIZES, grasp("right", face, "slab"))


def test_too_small_along_the_face() -> None:
    """The blade is 1.9 cm thick: closing along its length leaves the gripper's centre no room, the other way does."""
    assert "too small" in refute(SIZES, grasp("left", "+x", "blade"))
    assert refute(SIZES, grasp("left", "+y", "blade")) is None


def test_only_what_does_not_fit_on_the_region_is_refuted_to_be_placed_there() -> None:
    items = [
        SceneObject("cube", "box", (0.04, 0.04, 0.04), (-0.3, 0), 0),
        SceneObject("long", "box", (0.04, 0.23, 0.1), (0, 0), 0.2),
        SceneObject("disc", "cylinder", (0.06, 0.1), (0.3, 0), 0),
    ]
    for size, refuted in [
        ((0.18, 0.18), {"long"}),
        ((0.22, 0.11), {"long", "disc"}),
        ((0.11, 0.23), {"disc"}),
        ((0.12, 0.23), set()),
    ]:
        scene = make_scene(items, Goal("cube", Region((0, 0.4), 0.7, size)))
        reasons = {item.name: refute(scene, place("left", item.name, "goal")) for item in items}
        assert {name for name, reason in reasons.items() if reason} == refuted
        assert all(f"{name} does not fit on the goal region" in (reasons[name] or "") for name in refuted)
        assert all(refute(scene, place("left", item.name, "table")) is None for item in items)


@pytest.mark.parametrize(("face", "width"), [("+x", 0.05), ("-x", 0.05), ("+y", 0.16), ("-y", 0.16)])
def test_grip_width_of_a_box(face: str, width: float) -> None:
    assert grip_width(SCENE.objects[0], face) == width
