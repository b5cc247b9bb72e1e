"""The benchmarks of lower bounds and of reasons: what they report holds for the scenes that they draw."""

from dataclasses import replace

import jax
import pytest
from relaxation_cases import TOO_LARGE, TOO_WIDE, box

from dvr_jax.bench.reasons import ReasonsOptions, draw_refuted, holds
from dvr_jax.bench.relaxation import compare_scene
from dvr_jax.logic import Action
from dvr_jax.planning.feasibility import Verdict, feasibility
from dvr_jax.scene.types import OnRegion, Region, Scene
from dvr_jax.search.reasons import Reason, ReasonKind


def test_exact_reasons_hold() -> None:
    for scene, text in ((TOO_WIDE, "grasp(left, +x, cube)"), (TOO_LARGE, "grasp(left, +y, cube)")):
        (verdict,) = feasibility(scene, [[text]])
        assert verdict.bound == "symbolic" and holds(scene, verdict)


def test_a_wrong_reason_does_not_hold() -> None:
    beside = box("b", (0.04, 0.04, 0.04), (-0.4, 0.4))
    cube = box("cube", (0.05, 0.05, 0.05), (0.25, 0.0))
    scene = Scene((cube, beside), OnRegion("cube", Region((-0.4, -0.3), 0.0, (0.2, 0.2))))
    grasp = (Action.parse("grasp(left, +x, cube)"),)
    wrong = Reason(ReasonKind.COLLISION, str(grasp[0]), ("cube", "b"), 0.01, "They touch.")
    verdict = Verdict(grasp, False, "pose", 2.0, wrong, grasp)
    assert not holds(scene, verdict)
    right = replace(wrong, kind=ReasonKind.REACH, bodies=("left arm", "cube"), amount=0.5)
    assert holds(scene, replace(verdict, reason=right))


def test_what_a_tree_finds_in_one_box_is_allowed_by_the_bounds() -> None:
    with jax.enable_x64(True):
        found = compare_scene(6, 3, 1)
    assert found.prefixes > 20 and found.refuted == 0
    assert found.leaves > 0 and found.too_long == 0


@pytest.mark.slow
def test_what_a_tree_finds_is_allowed_by_the_bounds() -> None:
    found = [compare_scene(7, index, 2) for index in range(10)]
    assert sum(each.prefixes for each in found) > 1000
    assert sum(each.refuted for each in found) == 0
    assert sum(each.too_long for each in found) == 0


@pytest.mark.slow
def test_nine_in_ten_confirmed_reasons_hold() -> None:
    drawn = list(draw_refuted(ReasonsOptions(number=60)))
    assert sum(holds(scene, verdict) for scene, verdict in drawn) >= 54
