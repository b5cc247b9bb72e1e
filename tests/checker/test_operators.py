"""Operators, shapes and goals that only these tests define: the check takes them without a change of the package."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from puppet import OPEN, Case, Puppet, hand, layout_of
from wrong_motions import changed, never_released, placed_tilted, with_object

from dvr_jax import shapes
from dvr_jax.checker import (
    CHECKS,
    FindingKind,
    FindingLog,
    OperatorCheck,
    check_goal,
    check_motion,
    describe,
)
from dvr_jax.checker.kinds import GOAL_HELD
from dvr_jax.checker.operators import (
    ARM,
    OBJECT,
    Arguments,
    AttachmentInterval,
    Held,
    Moving,
    Timeline,
)
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.shapes import BOX_CHECK, register_shape_check, shape_check_named
from dvr_jax.checker.shapes import shape as shape_registry
from dvr_jax.checker.supports import check_standing
from dvr_jax.errors import MotionError, SceneError
from dvr_jax.logic import Action
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject

FINGER_END = 0.0153
"""From the gripper center down to the end of a finger's capsules [m]."""
FINGER_SIDE = 0.0152
"""From the middle of a gripper to the farthest point of a finger's capsules across the closing axis [m]."""
DOWN = (0.0, 0.0, -1.0)


def hand_must_be_empty(arguments: Arguments, holding: Mapping[str, str]) -> str:
    return f"{arguments['arm']} holds an object." if arguments["arm"] in holding else ""


# suction(arm, object): a gripper with closed fingers holds a box by its top face.

SUCTION_CENTER = FindingKind(
    "suction center", "the center of the {1} gripper is {value} off the top face of {0}", "mm"
)
SUCTION_FINGERS = FindingKind(
    "suction fingers", "the {1} gripper holds {0} with its fingers {value} open", "mm"
)


def suction_attachment(scene: Scene, arguments: Arguments) -> Held:
    return Held(scene.workcell.arm_index(arguments["arm"]))


def check_suction(
    motion: ReplayedMotion, timeline: Timeline, interval: AttachmentInterval, log: FindingLog
) -> None:
    arm = motion.scene.workcell.arm_index(interval.arguments["arm"])
    names = (motion.object_label(interval.object), motion.arm_name(arm))
    half = np.array(motion.scene.objects[interval.object].size) / 2

    to_object = motion.object_rotations[interval.start, interval.object].T
    center = to_object @ (
        motion.gripper_positions[interval.start, arm]
        - motion.object_positions[interval.start, interval.object]
    )
    beside = np.maximum(np.abs(center[:2]) - half[:2], 0.0)
    above = max(abs(center[2] - half[2]) - 0.02, 0.0)
    log.add(SUCTION_CENTER, interval.start, names, float(np.linalg.norm([*beside, above])), 1e-3)

    travels = motion.finger_travels(arm)[interval.start : interval.end].max(axis=1)
    log.add_worst(SUCTION_FINGERS, interval.start, names, travels, 1e-3)


SUCTION_CHECK = OperatorCheck(
    "suction", (ARM, OBJECT), hand_must_be_empty, suction_attachment, check_suction
)


@pytest.fixture(scope="module")
def sucked() -> Case:
    """The left arm carries a box by its top face onto the goal."""
    box = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (-0.20, 0.20), 0.3)
    puppet = Puppet(Scene((box,), OnRegion("yellow", Region((-0.15, -0.20), 0.3, (0.14, 0.14)))))
    pose = hand((np.cos(0.3), np.sin(0.3), 0.0), DOWN)
    top = 0.10 + FINGER_END
    puppet.fingers(0, 0.0)
    puppet.reach(0, pose, np.array([-0.20, 0.20, top + 0.05]))
    puppet.reach(0, pose, np.array([-0.20, 0.20, top]))
    puppet.attach(0, 0)
    puppet.reach(0, pose, np.array([-0.20, 0.20, top + 0.10]))
    puppet.reach(0, pose, np.array([-0.15, -0.20, top + 0.10]))
    puppet.reach(0, pose, np.array([-0.15, -0.20, top]))
    puppet.release(0)
    puppet.reach(0, pose, np.array([-0.15, -0.20, top + 0.05]))
    puppet.fingers(0, OPEN)
    actions = (Action("suction", ("left", "yellow")), Action("place", ("left", "yellow", "goal")))
    return Case(puppet.scene, actions, puppet.motion())


# nudge(arm, object): an arm with closed fingers slides a standing object on the table by at most 10 cm.

NUDGE_WAY = FindingKind("nudge way", "{0} slides by {value} as {1} nudges it", "mm")
NUDGE_FINGERS = FindingKind("nudge fingers", "{1} nudges {0} with its fingers {value} open", "mm")
NUDGE_ALONE = FindingKind("nudge alone", "{0} slides with the {1} gripper {value} away", "mm")
LONGEST_NUDGE = 0.10


def nudge_refusal(arguments: Arguments, holding: Mapping[str, str]) -> str:
    if arguments["object"] in holding.values():
        return f"{arguments['object']} is held; only a standing object can be nudged."
    return hand_must_be_empty(arguments, holding)


def nudge_attachment(scene: Scene, arguments: Arguments) -> Moving:
    return Moving()


def check_nudge(
    motion: ReplayedMotion, timeline: Timeline, interval: AttachmentInterval, log: FindingLog
) -> None:
    arm = motion.scene.workcell.arm_index(interval.arguments["arm"])
    item = motion.scene.objects[interval.object]
    names = (motion.object_label(interval.object), motion.arm_name(arm))
    positions = motion.object_positions[interval.start : interval.end, interval.object]

    # All the way, not only from the first to the last sample.
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    log.add(NUDGE_WAY, interval.end - 1, names, float(steps.sum()), LONGEST_NUDGE)
    for sample in range(interval.start, interval.end):
        check_standing(motion, interval.object, "table", sample, log)

    # As long as the object slides, closed fingers are next to it.
    for sample in interval.start + 1 + np.flatnonzero(steps > 1e-5):
        travel = float(motion.finger_travels(arm)[sample].max())
        log.add(NUDGE_FINGERS, int(sample), names, travel, 1e-3)
        to_object = motion.object_rotations[sample, interval.object].T
        center = (
            motion.gripper_positions[sample, arm] - motion.object_positions[sample, interval.object]
        )
        away = shape_check_named(item.shape).distance_outside(item.size, to_object @ center)
        log.add(NUDGE_ALONE, int(sample), names, away, 0.018)


NUDGE_CHECK = OperatorCheck("nudge", (ARM, OBJECT), nudge_refusal, nudge_attachment, check_nudge)


class Pusher(Puppet):
    """Slides an object along +y, level with the left gripper."""

    pushing = False

    def record(self) -> None:
        if self.pushing:
            _, p = self.gripper(0, self.qpos)
            column = self.layout.objects[0][1]
            # Half a millimeter beyond the fingers and half the box.
            self.qpos[column] = max(self.qpos[column], p[1] + FINGER_SIDE + 0.0005 + 0.04)
        super().record()


def nudged(way: float) -> Case:
    """A box that stands before the goal's region is pushed into it."""
    box = SceneObject("yellow", "box", (0.06, 0.08, 0.06), (-0.20, 0.0), 0.0)
    puppet = Pusher(Scene((box,), OnRegion("yellow", Region((-0.20, 0.08), 0.0, (0.10, 0.20)))))
    pose = hand((1.0, 0.0, 0.0), DOWN)
    behind = -0.04 - FINGER_SIDE - 0.001
    puppet.fingers(0, 0.0)
    puppet.reach(0, pose, np.array([-0.20, behind - 0.05, 0.20]))
    puppet.reach(0, pose, np.array([-0.20, behind, 0.04]))
    puppet.switch.append(len(puppet.samples) - 1)
    puppet.pushing = True
    puppet.reach(0, pose, np.array([-0.20, behind + way, 0.04]))
    puppet.pushing = False
    puppet.reach(0, pose, np.array([-0.20, behind + way - 0.05, 0.04]))
    puppet.fingers(0, OPEN)
    return Case(puppet.scene, (Action("nudge", ("left", "yellow")),), puppet.motion())


OPERATORS = (*CHECKS, SUCTION_CHECK, NUDGE_CHECK)
LAYOUT = layout_of(1)


def found(case: Case) -> set[tuple[str, tuple[str, ...]]]:
    report = check_motion(case.scene, case.actions, case.motion, OPERATORS)
    assert str(describe(report))
    return {(finding.kind, finding.names) for finding in report.findings}


BY_LEFT = ("object/yellow", "left")


def test_a_box_is_carried_by_suction(sucked: Case) -> None:
    assert found(sucked) == set()


def test_an_operator_is_known_only_where_it_is_given(sucked: Case) -> None:
    with pytest.raises(
        MotionError, match=r"valid are grasp\(arm, face, object\) and place\(arm, object, support\)"
    ):
        check_motion(sucked.scene, sucked.actions, sucked.motion)
    push = replace(sucked, actions=(Action("push", ("left", "yellow")), sucked.actions[1]))
    with pytest.raises(
        MotionError,
        match=r"grasp\(.*place\(.*suction\(arm, object\) and nudge\(arm, object\) with arms",
    ):
        found(push)


def fingers_open_under_suction(qpos: np.ndarray) -> None:
    qpos[:, LAYOUT.fingers[0]] = 0.04


def test_suction_with_open_fingers(sucked: Case) -> None:
    assert {
        kind
        for kind, names in found(changed(sucked, fingers_open_under_suction))
        if names == BY_LEFT
    } == {"suction fingers"}


def test_suction_beside_the_top_face(sucked: Case) -> None:
    aside = with_object(0, size=(0.05, 0.08, 0.06))(sucked)
    assert ("suction center", BY_LEFT) in found(aside)


def test_what_is_held_by_suction_does_not_slip_and_is_put_down(sucked: Case) -> None:
    take, place = sucked.motion.switch

    def slip(qpos: np.ndarray) -> None:
        qpos[take:place, LAYOUT.objects[0, 2]] += 0.002 * np.sin(
            np.linspace(0.0, np.pi, place - take)
        )

    assert ("slip shift", BY_LEFT) in found(changed(sucked, slip))

    held = replace(sucked, actions=sucked.actions[:1], motion=never_released(sucked).motion)
    assert ("goal held", BY_LEFT) in found(held)


def test_suction_and_grasp_know_of_each_other(sucked: Case) -> None:
    twice = (sucked.actions[0], Action("grasp", ("left", "+x", "yellow")))
    with pytest.raises(MotionError, match=r"action 2, grasp.*left already holds an object"):
        found(replace(sucked, actions=twice))
    nudge = (sucked.actions[0], Action("nudge", ("right", "yellow")))
    with pytest.raises(MotionError, match=r"action 2, nudge.*yellow is held"):
        found(replace(sucked, actions=nudge))


def test_a_box_is_nudged_onto_the_goal() -> None:
    assert found(nudged(0.06)) == set()


def test_a_nudge_is_short() -> None:
    assert found(nudged(0.095)) == set()
    assert found(nudged(0.12)) == {("nudge way", BY_LEFT)}


def test_a_nudge_needs_closed_fingers_beside_the_object() -> None:
    case = nudged(0.06)

    def slide_on(qpos: np.ndarray) -> None:
        qpos[-10:, LAYOUT.objects[0, 1]] += 0.002 * np.arange(10)

    assert ("nudge alone", BY_LEFT) in found(changed(case, slide_on))

    def open_fingers(qpos: np.ndarray) -> None:
        qpos[:, LAYOUT.fingers[0]] = 0.04

    assert ("nudge fingers", BY_LEFT) in found(changed(case, open_fingers))


def test_a_nudged_object_stays_upright() -> None:
    case = nudged(0.06)
    middle = (int(case.motion.switch[0]) + len(case.motion.time)) // 2

    def lift(qpos: np.ndarray) -> None:
        qpos[middle, LAYOUT.objects[0, 2]] += 0.003

    assert ("support height", ("object/yellow", "table")) in found(changed(case, lift))


def test_a_shape_is_one_value(carry: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crate looks like a box; later its check says that it is gripped by handles, 2 cm thick."""
    monkeypatch.setitem(shapes.shape._SHAPES, "crate", replace(shapes.BOX, name="crate"))
    crate = with_object(0, shape="crate")(carry)
    with pytest.raises(
        SceneError, match="does not know the shape 'crate'; it knows 'box', 'cylinder'"
    ):
        check_motion(crate.scene, crate.actions, crate.motion)

    # So that the registry forgets the crate after the test.
    monkeypatch.setitem(shape_registry._SHAPE_CHECKS, "crate", BOX_CHECK)
    register_shape_check(replace(BOX_CHECK, name="crate"))
    assert check_motion(crate.scene, crate.actions, crate.motion).passed
    tilted = placed_tilted(crate)
    assert not check_motion(tilted.scene, tilted.actions, tilted.motion).passed

    register_shape_check(replace(BOX_CHECK, name="crate", half_width=lambda size, face: 0.01))
    report = check_motion(crate.scene, crate.actions, crate.motion)
    assert {finding.kind for finding in report.findings} == {"grip"}


@dataclass(frozen=True, slots=True)
class InHand(OnRegion):
    """The object shall be in some hand at the end."""


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """A goal that no check is registered for."""

    region: Region

    @property
    def regions(self) -> tuple[Region, ...]:
        return (self.region,)


def test_a_goal_is_one_function(carry: Case) -> None:
    not_held = replace(GOAL_HELD, name="goal not held", sentence="no arm holds {0}")

    @check_goal.register
    def check_in_hand(
        goal: InHand, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
    ) -> None:
        index = motion.scene.object_index(goal.object)
        if timeline.last(index).holder is None:
            log.add(not_held, motion.last_sample, (motion.object_label(index),), 1.0, 0.0)

    goal = InHand(carry.scene.goal.object, carry.scene.goal.region)
    case = replace(carry, scene=replace(carry.scene, goal=goal))
    assert found(case) == {("goal not held", ("object/yellow",))}
    assert found(never_released(case)) == set()

    unknown = replace(carry.scene, goal=Elsewhere(carry.scene.goal.region))
    with pytest.raises(
        SceneError, match="does not know goals of the type Elsewhere; it knows OnRegion"
    ):
        check_motion(unknown, carry.actions[:1], never_released(carry).motion)
