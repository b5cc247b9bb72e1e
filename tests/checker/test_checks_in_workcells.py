"""The check of other workcells and of fixed bodies: clean motions pass, and what is hit is named."""

from dataclasses import replace

import numpy as np
import pytest
from puppet import Case, carry_in_workcell
from wrong_motions import changed

from dvr_jax.checker import check_motion, describe
from dvr_jax.scene.mjcf import qpos_layout
from dvr_jax.scene.types import FixedBody
from dvr_jax.workcell.workcell import SIDE_BY_SIDE_WORKCELL, SINGLE_ARM_WORKCELL, WORKCELLS

LAST_JOINT = {"single": "arm/joint7", "side-by-side": "right/joint7", "facing-1.0": "left/joint7"}
"""A joint of the arm that carries."""


def carried(name: str) -> Case:
    workcell = WORKCELLS[name]
    arm = workcell.arm_index(LAST_JOINT[name].split("/")[0])
    return carry_in_workcell(workcell, arm)


def kinds_and_names(case: Case) -> set[tuple[str, tuple[str, ...]]]:
    report = check_motion(case.scene, case.actions, case.motion)
    return {(finding.kind, finding.names) for finding in report.findings}


@pytest.mark.parametrize("name", LAST_JOINT)
def test_any_workcell_is_checked(name: str) -> None:
    case = carried(name)
    report = check_motion(case.scene, case.actions, case.motion)
    assert report.passed, describe(report)

    joint = LAST_JOINT[name]
    workcell = case.scene.workcell
    column = qpos_layout(case.scene).arm_joints[workcell.arm_index(joint.split("/")[0]), -1]

    def jump(qpos: np.ndarray) -> None:
        qpos[-1, column] += 0.2

    assert kinds_and_names(changed(case, jump)) == {
        ("joint speed", (joint,)),
        ("joint acceleration", (joint,)),
    }


def test_the_home_is_that_of_the_arm() -> None:
    case = carry_in_workcell(SINGLE_ARM_WORKCELL, 0)
    arm = SINGLE_ARM_WORKCELL.arms[0]
    other = replace(arm, home=(*arm.home[:-1], arm.home[-1] + 0.01))
    scene = replace(case.scene, workcell=replace(SINGLE_ARM_WORKCELL, arms=(other,)))
    assert kinds_and_names(replace(case, scene=scene)) == {("home posture", ("arm/joint7",))}


def wall(height: float, name: str = "the wall") -> FixedBody:
    """Between where the box stands and where it shall stand."""
    return FixedBody(name, "box", (0.2, 0.02, height), (0.55, 0.0, height / 2), 0.0)


def test_a_box_is_carried_over_a_low_wall_and_through_a_high_one() -> None:
    low = carry_in_workcell(SIDE_BY_SIDE_WORKCELL, 1, (wall(0.09),))
    assert kinds_and_names(low) == set()

    high = carry_in_workcell(SIDE_BY_SIDE_WORKCELL, 1, (wall(0.20),))
    names = {names for kind, names in kinds_and_names(high) if kind == "penetration"}
    assert ("fixed/the wall", "object/yellow") in names
    assert ("fixed/the wall", "right/hand") in names or (
        "fixed/the wall",
        "right/finger_left",
    ) in names
    report = check_motion(high.scene, high.actions, high.motion)
    assert report.deepest_penetration > 0.02


@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_a_fixed_body_may_be_penetrated_as_deep_as_any_other(shape: str) -> None:
    """A post beside the box where the box is put down, from both sides of the limit."""
    size = (0.04, 0.04, 0.06) if shape == "box" else (0.02, 0.06)

    def post(depth: float) -> FixedBody:
        return FixedBody("post", shape, size, (0.55, -0.20 - 0.04 - 0.02 + depth, 0.03), 0.0)

    for depth, expected in (
        (0.9e-3, set()),
        (1.1e-3, {("penetration", ("fixed/post", "object/yellow"))}),
    ):
        assert (
            kinds_and_names(carry_in_workcell(SINGLE_ARM_WORKCELL, 0, (post(depth),))) == expected
        )


def test_fixed_bodies_may_touch_each_other_and_the_table() -> None:
    shelf = FixedBody("shelf", "box", (0.3, 0.3, 0.02), (0.9, 0.6, 0.5), 0.3)
    post = FixedBody("post", "cylinder", (0.03, 0.6), (0.9, 0.6, 0.25), 0.0)
    assert kinds_and_names(carry_in_workcell(SINGLE_ARM_WORKCELL, 0, (shelf, post))) == set()
