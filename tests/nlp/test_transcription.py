"""From actions to arrays: tables written out by hand, refutations, and what is refused."""

import math

import jax
import numpy as np
import pytest
from nlp_cases import FIXED, SCENE, SIDE_BY_SIDE, SINGLE_ARM, grasp, place

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.blocks.straight_motion import StraightKind
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.transcription import KEYFRAME_REGULARIZATION, transcribe, transcribe_switch
from dvr_jax.operators import OPERATORS, refute
from dvr_jax.operators.grasp import GRASP_MARGIN, HEIGHT_MARGIN, PITCH_LIMIT
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.workcell.workcell import base_positions, base_rotations

FIXED_KIND, PLACED, HELD, ABSENT = ModeKind.FIXED, ModeKind.PLACED, ModeKind.HELD, ModeKind.ABSENT


def why_not(scene: Scene, action: Action) -> str | None:
    return refute(scene, action, OPERATORS)


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


def test_modes(handover: Problem) -> None:
    kinds = [
        [FIXED_KIND, FIXED_KIND, FIXED_KIND],
        [HELD, FIXED_KIND, FIXED_KIND],
        [HELD, FIXED_KIND, FIXED_KIND],
        [PLACED, FIXED_KIND, FIXED_KIND],
        [PLACED, HELD, FIXED_KIND],
        [PLACED, PLACED, FIXED_KIND],
    ]
    # The left arm is 0, the right one 1; 0 also where none holds the object.
    parents = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    by = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 3, 0], [2, 4, 0]]
    np.testing.assert_array_equal(handover.mode_kind, kinds)
    np.testing.assert_array_equal(handover.mode_parent, parents)
    np.testing.assert_array_equal(handover.mode_action, by)
    np.testing.assert_array_equal(handover.switched_object, [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(handover.acting_arm, [0, 1, 1, 0, 0])
    np.testing.assert_array_equal(handover.on_support, [0, 0, 1, 0, 1])


def test_arms_at_rest(handover: Problem) -> None:
    """Both arms at a handover, else the one that acts."""
    np.testing.assert_array_equal(handover.arm_at_rest, [[1, 0], [1, 1], [0, 1], [1, 0], [1, 0]])


def test_openings(handover: Problem) -> None:
    """Open when empty, else half the object's width along the closing axis: 5 cm at +x, 16 cm at -y, the can 7 cm."""
    expected = [
        [0.04, 0.04],
        [0.025, 0.04],
        [0.04, 0.08],
        [0.04, 0.04],
        [0.035, 0.04],
        [0.04, 0.04],
    ]
    np.testing.assert_allclose(handover.finger_opening, expected, atol=1e-15)


def test_faces_and_bounds(handover: Problem) -> None:
    np.testing.assert_allclose(handover.closing_yaw, [0, 3 * math.pi / 2, 0, math.pi / 2, 0])
    """A cylinder's closing axis passes through its own: its yaw is free, its tangent pinned."""
    free = (handover.parameter_upper - handover.parameter_lower) > 100
    expected_free = [
        [False] * 4,
        [False] * 4,
        [True, True, True, False],
        [False, False, False, True],
        [True, True, True, False],
    ]
    np.testing.assert_array_equal(free, expected_free)
    # Along the face's tangent, along the height, pitch, yaw (pinned for boxes).
    np.testing.assert_allclose(
        handover.parameter_upper[0], [0.08 - GRASP_MARGIN, 0.05 - HEIGHT_MARGIN, PITCH_LIMIT, 0]
    )
    np.testing.assert_allclose(
        handover.parameter_upper[1], [0.025 - GRASP_MARGIN, 0.05 - HEIGHT_MARGIN, PITCH_LIMIT, 0]
    )
    np.testing.assert_allclose(
        handover.parameter_upper[3, :3], [0, 0.07 - HEIGHT_MARGIN, PITCH_LIMIT]
    )
    np.testing.assert_array_equal(handover.parameter_lower[:2], -handover.parameter_upper[:2])
    np.testing.assert_array_equal(handover.parameter_lower[[2, 4], 3], 0)
    np.testing.assert_array_equal(handover.parameter_upper[[2, 4], 3], 0)


def test_supports(handover: Problem) -> None:
    """Of a region 4 mm are left free at its edges, of the table nothing."""
    np.testing.assert_allclose(handover.support[2], [0.3, -0.25, 0.4, 0.105, 0.095])
    np.testing.assert_allclose(handover.support[4], [0, 0, 0, *SCENE.workcell.table.half_extents])


def test_shapes_and_start(handover: Problem) -> None:
    np.testing.assert_allclose(
        handover.prism, [[0.025, 0.08, 0.05, 0], [0, 0, 0.07, 0.035], [0.03, 0.03, 0.09, 0]]
    )
    np.testing.assert_allclose(handover.initial_pose[0], [-0.15, 0.22, 0.05, 0.5])
    np.testing.assert_allclose(handover.initial_pose[1], [0.12, -0.2, 0.07, 0])
    np.testing.assert_allclose(handover.home, np.ravel(SCENE.home))
    np.testing.assert_array_equal(handover.regularization_target, np.tile(handover.home, (5, 1)))
    np.testing.assert_array_equal(
        handover.regularization_weight, np.full((5, 14), KEYFRAME_REGULARIZATION)
    )
    np.testing.assert_array_equal(handover.sample_fraction, np.ones((5, 1)))
    np.testing.assert_array_equal(handover.sample_offset, np.zeros((5, 1, 14)))
    assert handover.fixed_prism.shape == handover.fixed_pose.shape == (0, 4)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(handover))


def test_fixed_bodies() -> None:
    """In the order of the scene; they change nothing else."""
    actions = [grasp("left", "+x", "yellow")]
    problem = transcribe(FIXED.scene, actions)
    np.testing.assert_allclose(problem.fixed_prism, [[0.20, 0.12, 0.01, 0], [0, 0, 0.25, 0.04]])
    np.testing.assert_allclose(
        problem.fixed_pose, [[-0.20, 0.10, 0.50, 0.4], [0.40, 0.15, 0.25, 0]]
    )
    pairs = 3 + 3 * 2  # of two objects, and of an object and a fixed body
    without = problem._replace(
        fixed_prism=np.zeros((0, 4)),
        fixed_pose=np.zeros((0, 4)),
        phase_clearance=problem.phase_clearance[..., : 3 - pairs],
        clearance=problem.clearance[..., : 3 - pairs],
    )
    for ours, theirs in zip(without, transcribe(SCENE, actions), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("setting", [SIDE_BY_SIDE, SINGLE_ARM], ids=["side by side", "single arm"])
def test_other_workcells(setting) -> None:
    """Arms are counted in the workcell's order; bases, homes and openings are its own."""
    workcell = setting.scene.workcell
    last = workcell.arm_names[-1]
    problem = transcribe(
        setting.scene, [grasp(last, "+x", "yellow"), place(last, "yellow", "table")]
    )
    index = workcell.number_of_arms - 1
    np.testing.assert_array_equal(problem.base_rotation, base_rotations(workcell))
    np.testing.assert_array_equal(problem.base_position, base_positions(workcell))
    np.testing.assert_array_equal(problem.home, np.ravel(workcell.home))
    np.testing.assert_array_equal(problem.acting_arm, [index, index])
    np.testing.assert_array_equal(problem.mode_parent[:, 0], [0, index, 0])
    np.testing.assert_array_equal(
        problem.arm_at_rest, np.eye(workcell.number_of_arms)[[index, index]]
    )
    opening = np.full((3, workcell.number_of_arms), 0.04)
    opening[1, index] = 0.025
    np.testing.assert_allclose(problem.finger_opening, opening)


def test_ignored_objects_are_absent() -> None:
    problem = transcribe(SCENE, [grasp("left", "+x", "yellow")], ignored=["can", "green"])
    np.testing.assert_array_equal(
        problem.mode_kind, [[FIXED_KIND, ABSENT, ABSENT], [HELD, ABSENT, ABSENT]]
    )


def test_a_switch_alone() -> None:
    """The object is held from the start, all others are left out of the first slice."""
    before, action = grasp("right", "+x", "can"), place("right", "can", "table")
    whole = transcribe(SCENE, [before, action], ignored=["green"])
    problem = transcribe_switch(SCENE, before, action, ignored=["green"])
    np.testing.assert_array_equal(
        problem.mode_kind,
        [[ABSENT, HELD, ABSENT], [FIXED_KIND, HELD, ABSENT], [FIXED_KIND, PLACED, ABSENT]],
    )
    np.testing.assert_array_equal(problem.mode_parent, [[0, 1, 0], [0, 1, 0], [0, 0, 0]])
    changed = problem._replace(mode_kind=whole.mode_kind, mode_parent=whole.mode_parent)
    for ours, theirs in zip(changed, whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    # What is written down first is not changed afterwards.
    np.testing.assert_array_equal(
        transcribe(SCENE, [before, action], ignored=["green"]).mode_kind, whole.mode_kind
    )


def test_an_unknown_operator_is_refused_by_name() -> None:
    with pytest.raises(DvrError, match=r"'push'.*known: grasp, place"):
        transcribe(SCENE, [Action("push", ("left", "yellow"))])


def test_an_unknown_arm_is_refused_by_name() -> None:
    with pytest.raises(DvrError, match=r"'left'.*valid: arm\."):
        transcribe(SINGLE_ARM.scene, [grasp("left", "+x", "yellow")])


def test_no_action_is_refused() -> None:
    with pytest.raises(DvrError, match="no action"):
        transcribe(SCENE, [])


SIZES = make_scene(
    [
        SceneObject("wide", "box", (0.081, 0.05, 0.1), (-0.3, 0.3), 0.0),
        SceneObject("edge", "box", (0.08, 0.03, 0.1), (0.0, 0.3), 0.0),
        SceneObject("drum", "cylinder", (0.041, 0.1), (0.3, 0.3), 0.0),
        SceneObject("pin", "cylinder", (0.009, 0.1), (-0.3, -0.3), 0.0),
        SceneObject("slab", "box", (0.05, 0.05, 0.0059), (0.0, -0.3), 0.0),
        SceneObject("blade", "box", (0.05, 0.019, 0.1), (0.3, -0.3), 0.0),
    ],
    OnRegion("edge", Region((0, 0), 0, (0.2, 0.2))),
)


@pytest.mark.parametrize("face", ["+x", "-x"])
def test_too_wide_at_its_x_faces_only(face: str) -> None:
    assert "8.1 cm" in why_not(SIZES, grasp("left", face, "wide"))
    assert "wide" in why_not(SIZES, grasp("left", face, "wide"))
    assert why_not(SIZES, grasp("left", face.replace("x", "y"), "wide")) is None
    assert why_not(SIZES, grasp("left", face, "edge")) is None


@pytest.mark.parametrize("face", ["+x", "+y", "-x", "-y"])
def test_too_wide_or_too_small_all_around(face: str) -> None:
    assert "8.2 cm" in why_not(SIZES, grasp("right", face, "drum"))
    assert "too small" in why_not(SIZES, grasp("right", face, "pin"))
    assert "too small" in why_not(SIZES, grasp("right", face, "slab"))


def test_too_small_along_the_face() -> None:
    """The blade is 1.9 cm thick: closing along its length leaves the gripper's centre no room, the other way does."""
    assert "too small" in why_not(SIZES, grasp("left", "+x", "blade"))
    assert why_not(SIZES, grasp("left", "+y", "blade")) is None


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
        scene = make_scene(items, OnRegion("cube", Region((0, 0.4), 0.7, size)))
        reasons = {item.name: why_not(scene, place("left", item.name, "goal")) for item in items}
        assert {name for name, reason in reasons.items() if reason} == refuted
        assert all(
            f"{name} does not fit on the goal region" in (reasons[name] or "") for name in refuted
        )
        assert all(why_not(scene, place("left", item.name, "table")) is None for item in items)


@pytest.mark.parametrize(
    ("face", "width"), [("+x", 0.05), ("-x", 0.05), ("+y", 0.16), ("-y", 0.16)]
)
def test_grip_width_of_a_box(face: str, width: float) -> None:
    item = SCENE.objects[0]
    assert item.kind.grip_width(item.size, face) == width


def test_straight_motions(handover: Problem) -> None:
    """Hands come to grasps and leave what they release along their approach; objects are lifted and lowered."""
    clearances = SCENE.workcell.clearances
    approach = (StraightKind.APPROACH, clearances.approach)
    vertical = (StraightKind.VERTICAL, clearances.lift)
    left, right = 0, 1
    expected = [
        # Left comes to yellow. Left lifts it and right comes to it. Left leaves it and right lowers it.
        [None, (left, *approach)],
        [(left, *vertical), (right, *approach)],
        [(left, *approach), (right, *vertical)],
        # Right leaves yellow and left comes to the can. Left lifts the can and lowers it.
        [(right, *approach), (left, *approach)],
        [(left, *vertical), (left, *vertical)],
    ]
    for phase, motions in enumerate(expected):
        for motion, wanted in enumerate(motions):
            found = (
                handover.straight_arm[phase, motion],
                handover.straight_kind[phase, motion],
                handover.straight_distance[phase, motion],
            )
            assert found == wanted if wanted else found[2] == 0
