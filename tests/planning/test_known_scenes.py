"""Scenes whose least number of actions, or whose reason for having no solution, is known by construction."""

from itertools import combinations

import mujoco
import pytest
from relaxation_cases import (
    BORDERLINE,
    BYSTANDER,
    HAND_STILL_FULL,
    NEEDLESS_GRASP,
    OUT_OF_REACH,
    TOO_WIDE,
    obstructed,
)

from dvr_jax.checker.tolerances import DEEPEST_CONTACT
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.mjcf import scene_xml
from dvr_jax.scene.types import Scene
from dvr_jax.search.reasons import ReasonKind
from dvr_jax.search.status import PlanStatus


def require_solved(result: Plan, length: int) -> None:
    assert result.solved and len(result.actions) == length, result.action_descriptions
    assert result.report is not None and result.report.passed


@pytest.mark.parametrize(
    ("scene", "kind", "words"),
    [
        (OUT_OF_REACH, ReasonKind.REACH, "No arm reaches the target: it is 1.13 m from"),
        (TOO_WIDE, ReasonKind.WIDTH, "'cube' is 10 x 12 cm; the gripper opens 8 cm."),
    ],
    ids=["out of reach", "too wide"],
)
@pytest.mark.parametrize("search", ["dvr", "mbts", "bfs"])
def test_a_scene_without_a_solution_is_refused_at_once_with_a_reason(
    scene: Scene, kind: ReasonKind, words: str, search: str
) -> None:
    result = plan(scene, search)
    assert result.status == PlanStatus.EXHAUSTED and not result.nlps
    assert result.reason is not None and result.reason.kind == kind
    assert str(result.reason).startswith(words)


def test_too_few_actions_are_refused_with_the_number_that_is_needed() -> None:
    result = plan(obstructed(1), "mbts", k_max=3)
    assert result.status == PlanStatus.EXHAUSTED and result.reason is not None
    assert "at least 4 actions" in str(result.reason) and "--k-max 4" in str(result.reason)


def test_no_action_is_needless() -> None:
    for search in ("dvr", "mbts"):
        require_solved(plan(NEEDLESS_GRASP, search), 2)


def test_the_least_number_of_actions_is_found_if_it_is_asked_for() -> None:
    result = plan(NEEDLESS_GRASP, shortest=True)
    require_solved(result, 2)
    assert result.options["shortest"] is True


def deepest_overlap(result: Plan) -> float:
    """Return by how much two objects overlap at most after the plan, as MuJoCo measures it [m]; negative if apart."""
    assert result.motion is not None
    model = mujoco.MjModel.from_xml_string(scene_xml(result.scene))
    data = mujoco.MjData(model)
    data.qpos[:] = result.motion.qpos[-1]
    mujoco.mj_forward(model, data)
    geoms = [int(model.body(f"object/{name}").geomadr[0]) for name in result.scene.object_names]
    return -min(
        mujoco.mj_geomDistance(model, data, first, second, 1.0, None)
        for first, second in combinations(geoms, 2)
    )


def test_a_hand_that_holds_what_was_in_the_way_is_no_obstacle() -> None:
    result = plan(HAND_STILL_FULL)
    assert result.solved and result.report is not None and result.report.passed
    assert "grasp" in {a.operator for a in result.actions if "blocker" in a.arguments}
    assert deepest_overlap(result) <= DEEPEST_CONTACT


@pytest.mark.slow
def test_no_plan_ends_with_overlapping_bodies() -> None:
    result = plan(BORDERLINE, time_limit=600)
    assert result.solved == (result.motion is not None)
    assert not result.solved or deepest_overlap(result) <= DEEPEST_CONTACT


@pytest.mark.slow
def test_a_box_is_carried_past_a_bystander() -> None:
    result = plan(BYSTANDER)
    assert result.solved and result.report is not None and result.report.passed


@pytest.mark.slow
@pytest.mark.parametrize("blockers", [2, 3])
def test_boxes_on_the_target_are_moved_away_one_after_the_other(blockers: int) -> None:
    length = 2 * blockers + 2
    result = plan(obstructed(blockers), k_max=length, time_limit=600)
    require_solved(result, length)
    moved = {action.arguments[-1] for action in result.actions if action.operator == "grasp"}
    assert moved == {"target", *(f"b{index + 1}" for index in range(blockers))}


@pytest.mark.slow
def test_without_a_limit_more_than_six_actions_are_found() -> None:
    result = plan(obstructed(3), time_limit=600)
    require_solved(result, 8)
