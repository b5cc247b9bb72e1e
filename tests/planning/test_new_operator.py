"""An operator that only these tests define is planned with and checked, without any change of the package."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from add_an_operator import SUCTION, SUCTION_CHECK

from dvr_jax.checker import CHECKS
from dvr_jax.checker.replay import check_motion
from dvr_jax.errors import DvrError, MotionError, OptionError
from dvr_jax.model.predictor import load_network
from dvr_jax.operators import OPERATORS
from dvr_jax.planning.check import check
from dvr_jax.planning.feasibility import feasibility
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject

WITH_SUCTION = (*OPERATORS, SUCTION)
WITH_CHECK = (*CHECKS, SUCTION_CHECK)

WIDE = SceneObject("crate", "box", (0.10, 0.12, 0.08), (-0.35, 0.25), 0.4)
SCENE = Scene((WIDE,), OnRegion("crate", Region((-0.35, -0.25), 0.2, (0.2, 0.2))))
"""A box that no gripper can grasp, in reach of one arm."""


@pytest.fixture(scope="module")
def lifted() -> Plan:
    return plan(SCENE, "mbts", k_max=2, operators=WITH_SUCTION, checks=WITH_CHECK)


def test_without_the_operator_there_is_no_plan() -> None:
    refused = plan(SCENE, "mbts", k_max=2)
    assert refused.status == "tree exhausted"


def test_a_box_too_wide_for_the_gripper_is_moved(lifted: Plan) -> None:
    assert lifted.solved
    assert [action.operator for action in lifted.actions] == ["suction", "place"]
    assert lifted.action_descriptions == (
        "left lifts crate by its top face",
        "left places crate on goal",
    )
    assert lifted.motion is not None
    assert check(SCENE, lifted.actions, lifted.motion, WITH_CHECK).passed

    # It hangs below a closed gripper while it is held, until the fingers open in the last second.
    layout = qpos_layout(SCENE)
    held = slice(int(lifted.motion.switch[0]), int(lifted.motion.switch[1]))
    np.testing.assert_allclose(lifted.motion.qpos[held][:-60, layout.fingers[0]], 0.0, atol=1e-9)
    assert lifted.motion.qpos[held, layout.objects[0, 2]].max() > WIDE.height / 2 + 0.03
    assert lifted.scene_after().objects[0].footprint.center == pytest.approx(
        (-0.35, -0.25), abs=0.1
    )


def test_the_check_knows_the_operator_only_where_it_is_given(lifted: Plan) -> None:
    assert lifted.motion is not None
    with pytest.raises(MotionError, match=r"valid are grasp\(.*and place\("):
        check_motion(SCENE, lifted.actions, lifted.motion)
    open_fingers = np.array(lifted.motion.qpos)
    open_fingers[:, qpos_layout(SCENE).fingers[0]] = 0.02
    report = check_motion(
        SCENE, lifted.actions, replace(lifted.motion, qpos=open_fingers), WITH_CHECK
    )
    assert "suction fingers" in {finding.kind for finding in report.findings}


def test_a_plan_with_the_operator_is_saved_and_read_back(lifted: Plan, tmp_path: Path) -> None:
    lifted.save(tmp_path, pictures=False, animation=False)
    assert Plan.load(tmp_path, operators=WITH_SUCTION) == lifted
    with pytest.raises(DvrError, match="there is no operator 'suction'"):
        Plan.load(tmp_path)


def test_feasibility_judges_sequences_of_the_operator() -> None:
    sequences = [
        ["suction(left, crate)", "place(left, crate, goal)"],
        ["suction(right, crate)", "place(right, crate, goal)"],
        ["grasp(left, +x, crate)", "place(left, crate, goal)"],
    ]
    verdicts = feasibility(SCENE, sequences, operators=WITH_SUCTION, checks=WITH_CHECK)
    assert [verdict.feasible for verdict in verdicts] == [True, False, False]
    # Out of the right arm's reach; too wide for the gripper.
    assert [verdict.bound for verdict in verdicts] == ["", "pose", "symbolic"]


def test_the_shipped_network_gives_way_to_a_search_that_knows_the_operator() -> None:
    lines: list[str] = []
    guided = plan(
        SCENE, "dvr", k_max=2, progress=lines.append, operators=WITH_SUCTION, checks=WITH_CHECK
    )
    assert (
        guided.solved and guided.options["search"] == "mbts" and guided.options["network"] is None
    )
    about_the_network = [line for line in lines if "network" in line]
    assert len(about_the_network) == 1
    assert about_the_network[0].startswith("the shipped network does not fit: ")
    assert "suction" in about_the_network[0] and about_the_network[0].endswith(
        "mbts searches in its place"
    )


def test_a_given_network_that_does_not_know_the_operator_is_refused() -> None:
    with pytest.raises(OptionError, match=r"the network does not fit: .*suction"):
        plan(
            SCENE,
            "dvr",
            k_max=2,
            network=load_network("dvr"),
            operators=WITH_SUCTION,
            checks=WITH_CHECK,
        )


@pytest.mark.slow
def test_what_is_held_by_suction_is_handed_over_to_a_grasp() -> None:
    """A bar that the left arm lifts by its top face and the right arm takes at a side that it can grasp."""
    bar = SceneObject("bar", "box", (0.05, 0.20, 0.06), (-0.45, 0.0), 0.3)
    scene = Scene((bar,), OnRegion("bar", Region((0.45, 0.1), 0.0, (0.26, 0.26))))
    sequence = ["suction(left, bar)", "grasp(right, +x, bar)", "place(right, bar, goal)"]
    (verdict,) = feasibility(scene, [sequence], operators=WITH_SUCTION, checks=WITH_CHECK)
    assert verdict.feasible and verdict.motion is not None
