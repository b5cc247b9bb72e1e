"""The check against motions made by hand: clean ones pass, and every kind of finding is provoked at least once."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dvr_jax.check import KINDS, CheckReport, Finding, describe
from dvr_jax.check.motion import Motion
from dvr_jax.check.replay import check_motion
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.scene.mjcf import qpos_layout

Case = Any  # of conftest, which tests cannot import by name

LAYOUT = qpos_layout(2)
YELLOW, CAN = LAYOUT.objects
RIGHT_JOINT_7 = LAYOUT.arm_joints[1, 6]


def check(case: Case) -> CheckReport:
    return check_motion(case.scene, case.actions, case.motion)


def changed(case: Case, change: Callable[[np.ndarray], None]) -> Case:
    """The case with another motion: `change` works on a copy of the states."""
    qpos = case.motion.qpos.copy()
    change(qpos)
    return replace(case, motion=replace(case.motion, qpos=qpos))


def turned_about(axis: int, angle: float, quaternion: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) after a turn about a world axis."""
    w, xyz = np.cos(angle / 2), np.eye(3)[axis] * np.sin(angle / 2)
    scalar = w * quaternion[..., :1] - quaternion[..., 1:] @ xyz[:, None]
    vector = w * quaternion[..., 1:] + quaternion[..., :1] * xyz + np.cross(xyz, quaternion[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


@pytest.mark.parametrize("name", ["carry", "carry_cylinder", "handover"])
def test_a_clean_motion_passes(name: str, request: pytest.FixtureRequest) -> None:
    case = request.getfixturevalue(name)
    report = check(case)
    assert report.passed and report.findings == (), describe(report)
    assert report.deepest_penetration < 1e-3
    assert report.samples == len(case.motion.time)
    assert report.duration == pytest.approx(case.motion.time[-1])
    assert describe(report).startswith("check passed: ")


def limit_violated(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[:, RIGHT_JOINT_7] = np.linspace(qpos[0, RIGHT_JOINT_7], 2.8973 + 0.02, len(qpos))

    return changed(case, change)


def finger_beyond(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[5:10, LAYOUT.fingers[1, 0]] = 0.0405

    return changed(case, change)


def joint_jumps(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[50:, RIGHT_JOINT_7] += 0.1

    return changed(case, change)


def object_teleports(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[100:, CAN[0]] += 0.15

    return changed(case, change)


def object_creeps(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[:, CAN[0]] += np.linspace(0.0, 0.01, len(qpos))

    return changed(case, change)


def object_turns(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[100:, CAN[3:]] = turned_about(2, 0.05, qpos[100:, CAN[3:]])

    return changed(case, change)


def held_lower(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[slice(*case.motion.switch), YELLOW[2]] -= 0.005

    return changed(case, change)


def held_turned(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        held = slice(*case.motion.switch)
        qpos[held, YELLOW[3:]] = turned_about(2, 0.05, qpos[held, YELLOW[3:]])

    return changed(case, change)


def held_slips(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        grasp, place = case.motion.switch
        slip = 0.002 * np.sin(np.linspace(0.0, np.pi, place - grasp))
        qpos[grasp:place, YELLOW[2]] += slip

    return changed(case, change)


def held_twists(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        middle = int(case.motion.switch.mean())
        qpos[middle, YELLOW[3:]] = turned_about(2, 0.03, qpos[middle, YELLOW[3:]])

    return changed(case, change)


def grasped_outside(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        held = slice(*case.motion.switch)
        qpos[held, YELLOW[2]] += 0.5  # in the world, while the hand sways: it slips too

    return changed(case, change)


def grasped_at(face: str) -> Callable[[Case], Case]:
    return lambda case: replace(case, actions=(Action("grasp", ("left", face, "yellow")), case.actions[1]))


def with_object(index: int, **changes: Any) -> Callable[[Case], Case]:
    def change(case: Case) -> Case:
        objects = list(case.scene.objects)
        objects[index] = replace(objects[index], **changes)
        return replace(case, scene=replace(case.scene, objects=tuple(objects)))

    return change


def too_wide(case: Case) -> Case:
    return grasped_at("+y")(with_object(0, size=(0.05, 0.085, 0.10))(case))


def posture_off(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[0, RIGHT_JOINT_7] += 0.005

    return changed(case, change)


def fingers_off(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[0, LAYOUT.fingers[0, 0]] = 0.03

    return changed(case, change)


def goal_elsewhere(case: Case) -> Case:
    goal = case.scene.goal
    moved = replace(goal, region=replace(goal.region, position=(-0.10, -0.20)))
    return replace(case, scene=replace(case.scene, goal=moved))


def placed_too_high(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[case.motion.switch[1] :, YELLOW[2]] += 0.0022

    return changed(case, change)


def placed_tilted(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        after = slice(case.motion.switch[1], None)
        qpos[after, YELLOW[3:]] = turned_about(0, 0.015, qpos[after, YELLOW[3:]])

    return changed(case, change)


def never_released(case: Case) -> Case:
    motion, place = case.motion, case.motion.switch[1]
    cut = Motion(motion.time[:place], motion.qpos[:place], motion.switch[:1])
    return replace(case, actions=case.actions[:1], motion=cut)


def fingers_closed_too_early(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        closing = np.maximum(0.04 - 0.0005 * np.arange(case.motion.switch[0] + 1), 0.02)
        qpos[: len(closing), LAYOUT.fingers[0]] = np.minimum(closing, qpos[: len(closing), LAYOUT.fingers[0, 0]])[
            :, None
        ]
        qpos[case.motion.switch[0] - 10 : case.motion.switch[0] + 1, LAYOUT.fingers[0]] = np.linspace(0.02, 0.025, 11)[
            :, None
        ]

    return changed(case, change)


def joint_trembles(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[1:-1:2, RIGHT_JOINT_7] += 0.02

    return changed(case, change)


def arm_moves_as_it_grasps(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[case.motion.switch[0] - 1, LAYOUT.arm_joints[0, 6]] += 0.003

    return changed(case, change)


def finger_jumps(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[20:, LAYOUT.fingers[1, 0]] -= 0.005

    return changed(case, change)


def never_closed(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[:, LAYOUT.fingers[0]] = 0.04

    return changed(case, change)


def opened_under_way(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        grasp, place = case.motion.switch
        qpos[grasp:place, LAYOUT.fingers[0]] += 0.002 * np.sin(np.linspace(0.0, np.pi, place - grasp))[:, None]

    return changed(case, change)


YELLOW_NAME, CAN_NAME = ("object/yellow",), ("object/can",)
BY_LEFT = ("object/yellow", "left")
AT_GOAL = ("object/yellow", "goal")

CASES: list[tuple[Callable[[Case], Case], set[tuple[str, tuple[str, ...]]]]] = [
    (
        fingers_closed_too_early,
        {("penetration", (f"left/finger_{side}", "object/yellow")) for side in ("left", "right")},
    ),
    (limit_violated, {("joint limit", ("right/joint7",))}),
    (finger_beyond, {("finger travel", ("right/finger_left",))}),
    (joint_jumps, {("joint speed", ("right/joint7",)), ("joint acceleration", ("right/joint7",))}),
    (joint_trembles, {("joint acceleration", ("right/joint7",))}),
    (arm_moves_as_it_grasps, {("switch speed", ("left/joint7",))}),
    (finger_jumps, {("finger speed", ("right/finger_left",))}),
    (never_closed, {("grip", BY_LEFT)}),
    (opened_under_way, {("grip", BY_LEFT)}),
    (object_teleports, {("object speed", CAN_NAME), ("standing shift", CAN_NAME)}),
    (object_creeps, {("standing shift", CAN_NAME)}),
    (object_turns, {("standing turn", CAN_NAME)}),
    (held_lower, {("switch shift", YELLOW_NAME), ("penetration", ("object/yellow", "table"))}),
    (held_turned, {("switch turn", YELLOW_NAME), ("closing axis", BY_LEFT)}),
    (held_slips, {("slip shift", BY_LEFT)}),
    (held_twists, {("slip turn", BY_LEFT)}),
    (
        grasped_outside,
        {
            ("gripper centre", BY_LEFT),
            ("switch shift", YELLOW_NAME),
            ("object speed", YELLOW_NAME),
            ("slip shift", BY_LEFT),
            # It jumps through the hand.
            *(("penetration", (f"left/{part}", "object/yellow")) for part in ("hand", "link6", "link7")),
        },
    ),
    (grasped_at("+y"), {("closing axis", BY_LEFT), ("grip", BY_LEFT)}),
    (grasped_at("-x"), {("closing axis", BY_LEFT)}),
    (too_wide, {("closing axis", BY_LEFT), ("grip", BY_LEFT), ("width", BY_LEFT)}),
    (posture_off, {("home posture", ("right/joint7",))}),
    (fingers_off, {("home finger", ("left/finger_left",)), ("finger speed", ("left/finger_left",))}),
    (with_object(1, position=(0.25, 0.255)), {("home shift", CAN_NAME)}),
    (with_object(1, yaw=0.1), {("home turn", CAN_NAME)}),
    (goal_elsewhere, {("support overhang", AT_GOAL)}),
    (placed_too_high, {("support height", AT_GOAL)}),
    (placed_tilted, {("support tilt", AT_GOAL)}),
    (never_released, {("goal held", BY_LEFT)}),
]


@pytest.mark.parametrize(("change", "expected"), CASES)
def test_what_is_wrong_is_found(
    carry: Case, change: Callable[[Case], Case], expected: set[tuple[str, tuple[str, ...]]]
) -> None:
    report = check(change(carry))
    assert not report.passed
    assert {(finding.kind, finding.names) for finding in report.findings} == expected, describe(report)
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
    assert provoked == set(KINDS)


def test_values_and_times_are_those_of_the_worst_sample(carry: Case) -> None:
    (limit,) = check(limit_violated(carry)).findings
    assert limit.value == pytest.approx(0.02) and limit.time == pytest.approx(carry.motion.time[-1])
    speed = next(finding for finding in check(joint_jumps(carry)).findings if finding.kind == "joint speed")
    assert speed.value == pytest.approx(0.1 / 0.02) and speed.time == pytest.approx(carry.motion.time[50])
    lower = {finding.kind: finding for finding in check(held_lower(carry)).findings}
    assert lower["penetration"].value == pytest.approx(0.005, abs=1e-6)
    assert lower["penetration"].time >= carry.motion.time[carry.motion.switch[0]]


def test_fingers_do_not_go_into_what_they_hold(carry: Case) -> None:
    def squeeze(qpos: np.ndarray) -> None:
        grasp, place = carry.motion.switch
        qpos[grasp - 10 : place + 1, LAYOUT.fingers[0]] = 0.01

    report = check(changed(carry, squeeze))
    assert {finding.kind for finding in report.findings} == {"penetration", "grip", "finger speed"}
    assert report.deepest_penetration == pytest.approx(0.015, abs=1e-4)
    assert check(held_lower(carry)).deepest_penetration == pytest.approx(0.005, abs=1e-6)


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
    found = {finding.names for finding in check(replace(case, motion=coarse)).findings if finding.kind == "penetration"}
    assert ("object/can", "object/yellow") in found


def test_the_giving_gripper_opens_when_the_taking_one_has_closed(handover: Case) -> None:
    def too_early(qpos: np.ndarray) -> None:
        fingers, take = qpos_layout(1).fingers[0], int(handover.motion.switch[1])
        qpos[take - 60 :, fingers] = 0.04
        qpos[take - 60 : take, fingers] = np.linspace(0.025, 0.04, 60)[:, None]

    (finding,) = check(changed(handover, too_early)).findings
    assert (finding.kind, finding.names) == ("grip", ("object/bar", "left"))


def test_the_giving_gripper_may_not_stay(handover: Case) -> None:
    take = int(handover.motion.switch[1])

    def stay_closed(qpos: np.ndarray) -> None:
        qpos[take:, qpos_layout(1).fingers[0]] = 0.015

    findings = check(changed(handover, stay_closed)).findings
    assert {finding.names[0] for finding in findings} == {"left/finger_left", "left/finger_right"}
    assert {finding.kind for finding in findings} == {"penetration", "finger speed"}


def test_a_finding_is_one_sentence() -> None:
    finding = Finding("penetration", 3.214, ("left/hand", "object/blue"), 0.0042, 0.003)
    assert str(finding) == "at 3.21 s left/hand and object/blue penetrate by 4.2 mm (limit 3 mm)"
    held = Finding("goal held", 1.0, ("object/blue", "left"), 1.0, 0.0)
    assert str(held) == "at 1.00 s the goal's object/blue is still held by the left gripper"


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ((Action("place", ("left", "yellow", "goal")),) * 2, "action 1, .*left does not hold yellow"),
        ((Action("grasp", ("left", "+x", "yellow")),) * 2, "action 2, .*left already holds"),
        ((Action("push", ("left", "yellow")),) * 2, "action 1, push.*: valid are grasp"),
        ((Action("grasp", ("left", "+z", "yellow")),) * 2, "faces"),
        ((Action("grasp", ("left", "+x", "yellow")),), "2 switches; valid are 1"),
    ],
)
def test_actions_that_do_not_apply_are_refused(carry: Case, actions: tuple[Action, ...], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        check_motion(carry.scene, actions, carry.motion)


def test_states_that_do_not_fit_the_scene_are_refused(carry: Case, handover: Case) -> None:
    with pytest.raises(DvrError, match="32 numbers; valid are 25 for 1 objects"):
        check_motion(handover.scene, handover.actions, carry.motion)

    def scale(qpos: np.ndarray) -> None:
        qpos[3, CAN[3:]] *= 2

    with pytest.raises(DvrError, match="quaternion of length 2; valid is 1"):
        check(changed(carry, scale))


def test_the_check_knows_neither_jax_nor_the_planner() -> None:
    program = (
        "import sys, dvr_jax.check.replay\n"
        "bad = [name for name in sys.modules if name.split('.')[0] == 'jax' or name.startswith('dvr_jax.komo')"
        " or name.startswith('dvr_jax.geometry') or name.startswith('dvr_jax.robot')]\n"
        "sys.exit(str(bad) if bad else 0)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
