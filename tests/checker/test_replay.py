"""The check against motions made by hand: clean ones pass, and every kind of finding is provoked at least once."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from puppet import Case, layout_of
from wrong_motions import (
    CAN,
    CASES,
    LAYOUT,
    changed,
    held_lower,
    joint_jumps,
    limit_violated,
    with_object,
)

from dvr_jax.checker import KINDS, CheckReport, Finding, check_motion, describe
from dvr_jax.checker.kinds import GOAL_HELD, PENETRATION
from dvr_jax.errors import MotionError
from dvr_jax.logic import Action
from dvr_jax.motion import Motion


def check(case: Case) -> CheckReport:
    return check_motion(case.scene, case.actions, case.motion)


FINGER_RADIUS = 0.0093
"""Radius of the two capsules beside a pad [m]."""

FINGER_AXIS = 0.0083
"""Distance of their lower ends from the middle of the closed gripper [m]."""

FINGER_HALF = 0.0043
"""Half the distance of their lower ends from each other [m]."""

TIN_RADIUS = 0.03


@pytest.mark.parametrize(
    ("name", "deepest"),
    [
        ("carry", FINGER_RADIUS - FINGER_AXIS),
        (
            "carry_cylinder",
            TIN_RADIUS + FINGER_RADIUS - float(np.hypot(TIN_RADIUS + FINGER_AXIS, FINGER_HALF)),
        ),
        ("handover", FINGER_RADIUS - FINGER_AXIS),
    ],
)
def test_a_clean_motion_passes(name: str, deepest: float, request: pytest.FixtureRequest) -> None:
    """Nothing is penetrated but what the hand holds, and that by what the fingers' capsules reach over their pads."""
    case = request.getfixturevalue(name)
    report = check(case)
    assert report.passed and report.findings == (), describe(report)
    assert report.deepest_penetration == pytest.approx(deepest, abs=2e-6)
    assert report.samples == len(case.motion.time)
    assert report.duration == pytest.approx(case.motion.time[-1])
    assert describe(report).startswith("check passed: ")


@pytest.mark.parametrize(("change", "expected"), CASES)
def test_what_is_wrong_is_found(
    carry: Case, change: Callable[[Case], Case], expected: set[tuple[str, tuple[str, ...]]]
) -> None:
    report = check(change(carry))
    assert not report.passed
    assert {(finding.kind, finding.names) for finding in report.findings} == expected, describe(
        report
    )
    assert all(finding.value > finding.limit for finding in report.findings)
    times = [finding.time for finding in report.findings]
    assert times == sorted(times)
    said = describe(report)
    assert said.startswith("check failed") and len(said.splitlines()) == 1 + len(report.findings)


def test_a_cylinder_grasped_beside_its_axis(carry_beside: Case) -> None:
    (finding,) = check(carry_beside).findings
    assert (finding.kind, finding.names) == ("closing offset", ("object/tin", "left"))
    assert finding.value == pytest.approx(0.01, abs=1e-6)


def test_every_kind_is_provoked_here() -> None:
    provoked = {kind for _, expected in CASES for kind, _ in expected} | {"closing offset"}
    # `test_dynamics` provokes what the check looks at only if it is asked to.
    provoked |= {"joint jerk", "joint torque"}
    # `test_facts` provokes what facts of other goals than the paper's require.
    provoked |= {"region covered", "goal not held", "goal off hand"}
    # `test_stacked_objects` provokes what is required of objects on other objects.
    provoked |= {"off top"}
    assert provoked == {kind.name for kind in KINDS}


def test_values_and_times_are_those_of_the_worst_sample(carry: Case) -> None:
    (limit,) = check(limit_violated(carry)).findings
    assert limit.value == pytest.approx(0.02) and limit.time == pytest.approx(carry.motion.time[-1])
    speed = next(
        finding for finding in check(joint_jumps(carry)).findings if finding.kind == "joint speed"
    )
    assert speed.value == pytest.approx(0.1 / 0.02) and speed.time == pytest.approx(
        carry.motion.time[50]
    )
    lower = {finding.kind: finding for finding in check(held_lower(carry)).findings}
    assert lower["penetration"].value == pytest.approx(0.005, abs=1e-6)
    assert lower["penetration"].time >= carry.motion.time[carry.motion.switch[0]]


def test_fingers_do_not_go_into_what_they_hold(carry: Case) -> None:
    def squeeze(qpos: np.ndarray) -> None:
        grasp, place = carry.motion.switch
        qpos[grasp - 10 : place + 1, LAYOUT.fingers[0]] = 0.01

    report = check(changed(carry, squeeze))
    assert {finding.kind for finding in report.findings} == {"penetration", "grip", "finger speed"}
    # The travel is 15 mm too short, and the capsules reach 1 mm over the pads.
    assert report.deepest_penetration == pytest.approx(0.016, abs=1e-5)
    lower = check(held_lower(carry))
    assert lower.deepest_penetration == pytest.approx(0.005, abs=1e-6)
    limits = [
        {finding.limit for finding in found.findings if finding.kind == "penetration"}
        for found in (report, lower)
    ]
    assert limits == [{2.5e-3}, {1e-3}]


def wall_in_the_way(case: Case) -> Case:
    """The can is a wall, 1 cm thin, over which the box would have to be lifted higher."""
    walled = with_object(1, shape="box", size=(0.5, 0.01, 0.4), position=(-0.2, 0.0), yaw=0.0)(case)

    def change(qpos: np.ndarray) -> None:
        qpos[:, CAN] = [-0.2, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0]

    return changed(walled, change)


@pytest.mark.parametrize("every", [1, 10, 25])
def test_what_is_hit_between_two_samples_is_found(carry: Case, every: int) -> None:
    case = wall_in_the_way(carry)
    motion = case.motion
    last = (len(motion.time) - 1) // every * every
    kept = np.append(np.arange(0, last, every), [last])
    coarse = Motion(motion.time[kept], motion.qpos[kept], motion.switch // every)
    found = {
        finding.names
        for finding in check(replace(case, motion=coarse)).findings
        if finding.kind == "penetration"
    }
    assert ("object/can", "object/yellow") in found


def test_the_giving_gripper_opens_when_the_taking_one_has_closed(handover: Case) -> None:
    def too_early(qpos: np.ndarray) -> None:
        fingers, take = layout_of(1).fingers[0], int(handover.motion.switch[1])
        qpos[take - 60 :, fingers] = 0.04
        qpos[take - 60 : take, fingers] = np.linspace(0.025, 0.04, 60)[:, None]

    (finding,) = check(changed(handover, too_early)).findings
    assert (finding.kind, finding.names) == ("grip", ("object/bar", "left"))


def test_the_giving_gripper_may_not_stay(handover: Case) -> None:
    take = int(handover.motion.switch[1])

    def stay_closed(qpos: np.ndarray) -> None:
        qpos[take:, layout_of(1).fingers[0]] = 0.015

    findings = check(changed(handover, stay_closed)).findings
    assert {finding.names[0] for finding in findings} == {"left/finger_left", "left/finger_right"}
    assert {finding.kind for finding in findings} == {"penetration", "finger speed"}


def test_a_finding_is_one_sentence() -> None:
    finding = Finding(PENETRATION, 3.214, ("left/hand", "object/blue"), 0.0042, 0.0025)
    assert str(finding) == "at 3.21 s left/hand and object/blue penetrate by 4.2 mm (limit 2.5 mm)"
    held = Finding(GOAL_HELD, 1.0, ("object/blue", "left"), 1.0, 0.0)
    assert str(held) == "at 1.00 s the goal's object/blue is still held by the left gripper"


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (
            (Action("place", ("left", "yellow", "goal")),) * 2,
            "action 1, .*left does not hold yellow",
        ),
        ((Action("grasp", ("left", "+x", "yellow")),) * 2, "action 2, .*left already holds"),
        ((Action("push", ("left", "yellow")),) * 2, "action 1, push.*: valid are grasp"),
        ((Action("grasp", ("left", "+z", "yellow")),) * 2, "faces"),
        ((Action("grasp", ("left", "+x", "yellow")),), "2 switches; valid are 1"),
    ],
)
def test_actions_that_do_not_apply_are_refused(
    carry: Case, actions: tuple[Action, ...], message: str
) -> None:
    with pytest.raises(MotionError, match=message):
        check_motion(carry.scene, actions, carry.motion)


def test_states_that_do_not_fit_the_scene_are_refused(carry: Case, handover: Case) -> None:
    with pytest.raises(MotionError, match="32 numbers; valid are 25 for 1 objects"):
        check_motion(handover.scene, handover.actions, carry.motion)

    def scale(qpos: np.ndarray) -> None:
        qpos[3, CAN[3:]] *= 2

    with pytest.raises(MotionError, match="quaternion of length 2; valid is 1"):
        check(changed(carry, scale))


FORBIDDEN = (
    "modes",
    "operators",
    "nlp",
    "solver",
    "seeds",
    "search",
    "planning",
    "model",
    "dataset",
)
"""Packages of the planner."""


def test_the_check_knows_neither_jax_nor_the_planner() -> None:
    program = (
        "import sys, dvr_jax.checker\n"
        f"planner = tuple('dvr_jax.' + name for name in {FORBIDDEN})\n"
        "arrays = ('dvr_jax.geometry.vectors', 'dvr_jax.geometry.prisms', 'dvr_jax.workcell.kinematics')\n"
        "is_jax = [name for name in sys.modules if name.split('.')[0] in ('jax', 'jaxlib')]\n"
        "bad = is_jax + [name for name in sys.modules if name.startswith(planner + arrays)]\n"
        "sys.exit(str(bad) if bad else 0)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
