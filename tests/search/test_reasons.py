"""Reasons of refutation name what a scene was built to fail by, with its amount."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from relaxation_cases import (
    OUT_OF_REACH,
    TOO_LARGE,
    TOO_WIDE,
    WALLED,
    box,
    obstructed,
    single,
)

from dvr_jax.logic import Action
from dvr_jax.operators import OPERATORS
from dvr_jax.scene.types import Scene
from dvr_jax.search.counterfactual import confirm, shifted, without_body
from dvr_jax.search.explanation import explain_scene
from dvr_jax.search.reasons import (
    NO_MOTION,
    Reason,
    ReasonKind,
    as_cause,
    as_symptom,
    centimeters,
    reach_reason,
    static_reason,
)
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import run_alone


def scene_reason(scene: Scene, k_max: int = 6) -> Reason:
    with jax.enable_x64(True):
        tree = SequenceTree(scene, k_max)
        run_alone(tree.judge_scene())
        reason = explain_scene(tree)
    assert reason is not None
    return reason


def test_a_box_that_is_too_wide_is_named_with_its_width() -> None:
    reason = scene_reason(TOO_WIDE)
    assert str(reason) == "'cube' is 10 x 12 cm; the gripper opens 8 cm."
    assert (reason.kind, reason.bodies, reason.action) == (ReasonKind.WIDTH, ("cube",), "")
    assert reason.amount == pytest.approx(0.02)


def test_a_box_that_does_not_fit_is_named_with_what_lacks() -> None:
    reason = scene_reason(TOO_LARGE)
    assert reason.kind == ReasonKind.FOOTPRINT and reason.bodies == ("cube", "goal")
    # A strip of 5 x 15 cm lies diagonally in a square of side s if 5 + 15 <= s sqrt(2).
    assert reason.amount == pytest.approx(0.20 / np.sqrt(2) - 0.10, abs=1e-6)


def test_a_target_out_of_reach_is_named_with_its_distance() -> None:
    reason = scene_reason(OUT_OF_REACH)
    distance = np.hypot(0.75, 0.85)
    assert str(reason).startswith(
        f"No arm reaches the target: it is {distance:.2f} m from the nearer base"
    )
    assert reason.kind == ReasonKind.REACH and 0.05 < reason.amount < 0.2


def test_an_action_out_of_reach_names_its_arm() -> None:
    window = (None, Action.parse("grasp(right, +x, cube)"))
    reason = reach_reason(OUT_OF_REACH, window, OPERATORS)
    assert reason is not None and reason.bodies == ("right arm", "cube")
    assert "it is 1.15 m from the base" in str(reason)
    near = (None, Action.parse("grasp(left, +x, cube)"))
    assert reach_reason(OUT_OF_REACH, near, OPERATORS) is None


def test_a_possible_action_has_no_static_reason() -> None:
    narrow = Action.parse("grasp(left, +x, cube)")
    assert static_reason(TOO_LARGE, narrow, OPERATORS) is None
    wide = static_reason(TOO_LARGE, Action.parse("grasp(left, +y, cube)"), OPERATORS)
    assert wide is not None and wide.amount == pytest.approx(0.07)


def test_more_actions_than_allowed_are_asked_for_by_number() -> None:
    reason = scene_reason(obstructed(1), k_max=3)
    assert str(reason) == (
        "The scene needs at least 4 actions, because 'b1' has to be moved out of the way; "
        "3 are allowed (try --k-max 4)."
    )
    assert (reason.kind, reason.bodies, reason.amount) == (ReasonKind.ACTIONS, ("b1",), 1)


def test_what_stands_in_the_way_and_is_too_wide_is_named() -> None:
    scene = obstructed(1)
    heavy = box("b1", (0.1, 0.1, 0.05), (-0.38, 0.17))
    reason = scene_reason(replace(scene, objects=(scene.objects[0], heavy)))
    assert str(reason).startswith("'b1' stands in the way and cannot be moved. 'b1' is 10 x 10 cm")


def test_the_body_without_which_an_action_is_possible_is_the_reason() -> None:
    grasp = (Action.parse("grasp(left, +y, cube)"),)
    symptom = Reason(ReasonKind.REACH, str(grasp[0]), ("left arm", "cube"), 0.1, "Too short.")
    with jax.enable_x64(True):
        (reason,) = confirm(WALLED, [(grasp, symptom)], 0, OPERATORS)
    assert reason.kind == ReasonKind.COLLISION and reason.bodies == ("cube", "wall")


def test_the_smallest_shift_with_which_an_action_is_possible_is_the_reason() -> None:
    scene = single((0.05, 0.05, 0.05), (-0.4, 0.35))
    far = replace(scene, objects=(box("cube", (0.05, 0.05, 0.05), (0.25, 0.0)),))
    grasp = (Action.parse("grasp(left, +x, cube)"),)
    symptom = Reason(ReasonKind.COLLISION, str(grasp[0]), ("left hand", "table"), 0.01, "Close.")
    with jax.enable_x64(True):
        (reason,) = confirm(far, [(grasp, symptom)], 0, OPERATORS)
    assert reason.kind == ReasonKind.REACH and reason.bodies == ("left arm", "cube")
    assert 0 < reason.amount <= 0.3


def test_a_body_that_is_left_out_is_far_away_and_nothing_else_moves() -> None:
    scene = obstructed(2)
    left = without_body(scene, "b1")
    assert np.hypot(*left.objects[1].position) > 10
    assert (left.objects[0], left.objects[2]) == (scene.objects[0], scene.objects[2])


def test_a_shift_is_along_the_line_from_the_base() -> None:
    assert shifted((0.3, 0.4), (0.0, 0.0), 0.5) == pytest.approx((0.6, 0.8))
    assert shifted((0.3, 0.4), (0.0, 0.0), -0.25) == pytest.approx((0.15, 0.2))
    assert shifted((0.3, 0.4), (0.0, 0.0), -2.0) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize(
    ("length", "text"), [(0.08, "8"), (0.055, "5.5"), (0.0, "0"), (1.0, "100"), (0.0049, "0.5")]
)
def test_centimeters_are_short(length: float, text: str) -> None:
    assert centimeters(length) == text


@pytest.mark.parametrize("before", ["", NO_MOTION])
def test_a_symptom_says_that_it_is_one_and_a_confirmed_reason_does_not(before: str) -> None:
    plain = Reason(ReasonKind.COLLISION, "place", ("a", "b"), 0.01, "When a is placed, b is near.")
    symptom = as_symptom(plain)
    assert (plain.confirmed, symptom.confirmed) == (True, False)
    assert str(symptom) == "Closest approach found: when a is placed, b is near."
    named = replace(symptom, sentence=before + symptom.sentence)
    assert as_cause(named) == replace(plain, sentence=before + plain.sentence)


def test_exact_reasons_are_confirmed() -> None:
    assert scene_reason(TOO_WIDE).confirmed and scene_reason(TOO_LARGE).confirmed
    # An arm that falls short by at least so much may fall short by more.
    assert not scene_reason(OUT_OF_REACH).confirmed
    assert scene_reason(obstructed(1), k_max=3).confirmed
