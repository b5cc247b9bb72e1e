"""Every limit of the check from both sides: nine tenths of it pass, eleven tenths do not. The numbers are those of
README.md and of Franka's data sheet, written out again."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from puppet import Case, layout_of
from scipy.spatial.transform import Rotation
from wrong_motions import changed, with_object

from dvr_jax.checker import check_motion
from dvr_jax.logic import Action
from dvr_jax.motion import Motion
from dvr_jax.scene.mjcf import build_home_data, build_model

Floats = NDArray[np.float64]

STEP = 0.02
LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
SPEED = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]
ACCELERATION = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
FINGER_SPEED, FINGER_OPEN = 0.05, 0.04

ONE = layout_of(1)
TWO = layout_of(2)
FIRST, CAN = TWO.objects
"""States of what is carried and of what stands by, in the cases that carry."""

HAND = np.array([-0.20, 0.20, 0.07])
"""Where the gripper center grasps."""
CLOSING = np.array([np.cos(0.3), np.sin(0.3), 0.0])
"""Its closing axis there."""

Probe = tuple[str, str, tuple[str, ...], Callable[[Case, float], Case]]
"""Fixture of the motion, kind and names of the finding, and the motion's change by a multiple of the limit."""

PROBES: dict[str, Probe] = {}


def moved(
    samples: Callable[[Case], object], column: int, by: float, layout=TWO
) -> Callable[[Case, float], Case]:
    """The same column of some states changed by a multiple of `by`."""

    def change(case: Case, factor: float) -> Case:
        def add(qpos: Floats) -> None:
            qpos[samples(case), column] += factor * by  # type: ignore[call-overload]

        return changed(case, add)

    return change


def turned(
    samples: Callable[[Case], object], columns: Floats, axis: Floats, by: float
) -> Callable[[Case, float], Case]:
    """An object in some states, turned about a world axis by a multiple of `by`."""

    def change(case: Case, factor: float) -> Case:
        def turn(qpos: Floats) -> None:
            rows = np.arange(len(qpos))[samples(case)]  # type: ignore[index]
            for row in np.atleast_1d(rows):
                own = Rotation.from_quat(qpos[row, columns[3:]], scalar_first=True)
                after = Rotation.from_rotvec(factor * by * axis / np.linalg.norm(axis)) * own
                qpos[row, columns[3:]] = after.as_quat(scalar_first=True)

        return changed(case, turn)

    return change


def everywhere(case: Case) -> slice:
    return slice(None)


def from_sample_50(case: Case) -> slice:
    return slice(50, None)


def start(case: Case) -> int:
    return 0


def held(case: Case) -> slice:
    return slice(*case.motion.switch)


def middle(case: Case) -> int:
    return int(case.motion.switch.mean())


def grasp(case: Case) -> int:
    return int(case.motion.switch[0])


def placed(case: Case) -> slice:
    return slice(int(case.motion.switch[1]), None)


def before_switch(number: int) -> Callable[[Case], int]:
    return lambda case: int(case.motion.switch[number]) - 1


X, Y, Z = np.eye(3)

PROBES["penetration"] = (
    "carry",
    "penetration",
    ("object/can", "table"),
    moved(everywhere, CAN[2], -1e-3),
)


def squeezed(sample: Callable[[Case], int], finger: int) -> Callable[[Case, float], Case]:
    """A finger closed on the box that its hand grasps, at one sample: its capsules reach 1 mm over the pad."""

    def change(case: Case, factor: float) -> Case:
        def close(qpos: Floats) -> None:
            qpos[sample(case), TWO.fingers[0, finger]] = 0.025 + 1e-3 - factor * 2.5e-3

        return changed(case, close)

    return change


def palm_lowered(case: Case, factor: float) -> Case:
    """The box risen in the hand that holds it. The palm's capsule ends 3.38 cm above the gripper center."""

    def rise(qpos: Floats) -> None:
        qpos[middle(case), FIRST[2]] += HAND[2] + 0.0338 - 0.10 + factor * 2.5e-3

    return changed(case, rise)


FINGER_END = 0.0153
"""From the gripper center down to the end of a finger's capsules [m]."""


def can_under_a_finger(arm_name: str, sign: int) -> Callable[[Case, float], Case]:
    """The can, 12 cm high, at the start below the end of an open finger that never grasps it."""

    def change(case: Case, factor: float) -> Case:
        def put(qpos: Floats) -> None:
            gripper = build_home_data(build_model(case.scene)).site(f"{arm_name}/gripper")
            finger = gripper.xpos + sign * (FINGER_OPEN + 0.0083) * gripper.xmat.reshape(3, 3)[:, 1]
            top = finger[2] - FINGER_END + factor * 1e-3
            qpos[start(case), CAN] = [*finger[:2], top - 0.06, 1.0, 0.0, 0.0, 0.0]

        return changed(case, put)

    return change


for finger, side in enumerate(("left", "right")):
    for when, sample in (("held", middle), ("before the grasp", before_switch(0))):
        PROBES[f"squeeze of the {side} finger, {when}"] = (
            "carry",
            "penetration",
            (f"left/finger_{side}", "object/yellow"),
            squeezed(sample, finger),
        )
    for arm_name in ("left", "right"):
        PROBES[f"{arm_name}/finger_{side} in the can"] = (
            "carry",
            "penetration",
            tuple(sorted((f"{arm_name}/finger_{side}", "object/can"))),
            can_under_a_finger(arm_name, 1 if side == "left" else -1),
        )
PROBES["palm in the box"] = ("carry", "penetration", ("left/hand", "object/yellow"), palm_lowered)


def to_limit(joint: int, bound: float, beyond: float) -> Callable[[Case, float], Case]:
    def change(case: Case, factor: float) -> Case:
        def go(qpos: Floats) -> None:
            column = TWO.arm_joints[1, joint]
            qpos[:, column] = np.linspace(qpos[0, column], bound + factor * beyond, len(qpos))

        return changed(case, go)

    return change


def rest(joint: int, at_end: bool) -> Callable[[Case, float], Case]:
    """Full speed from the first sample on, which a motion must not begin with, and slowly less; or the reverse."""

    def change(case: Case, factor: float) -> Case:
        def go(qpos: Floats) -> None:
            number = 40
            speeds = np.zeros(len(qpos))
            speeds[1 : 1 + number] = (
                factor * ACCELERATION[joint] * STEP * (1 - np.arange(number) / number)
            )
            way = np.cumsum(speeds) * STEP
            # The end's way comes from where it leads to, so that the posture at the start stays.
            qpos[:, TWO.arm_joints[1, joint]] += way[-1] - way[::-1] if at_end else way

        return changed(case, go)

    return change


for j in range(7):
    name, column = (f"right/joint{j + 1}",), TWO.arm_joints[1, j]
    PROBES[f"joint {j + 1} above"] = ("carry", "joint limit", name, to_limit(j, UPPER[j], 1e-3))
    PROBES[f"joint {j + 1} below"] = ("carry", "joint limit", name, to_limit(j, LOWER[j], -1e-3))
    for sign in (1, -1):
        step = moved(from_sample_50, column, sign * SPEED[j] * STEP)
        PROBES[f"joint {j + 1} speed {sign}"] = ("carry", "joint speed", name, step)
        step = moved(from_sample_50, column, sign * ACCELERATION[j] * STEP**2)
        PROBES[f"joint {j + 1} acceleration {sign}"] = ("carry", "joint acceleration", name, step)
    PROBES[f"joint {j + 1} home"] = ("carry", "home posture", name, moved(start, column, 1e-3))
for at_end in (False, True):
    PROBES[f"rest {at_end}"] = ("carry", "joint acceleration", ("right/joint2",), rest(1, at_end))

for arm, arm_name in enumerate(("left", "right")):
    for side, column in zip(("left", "right"), TWO.fingers[arm], strict=True):
        name = (f"{arm_name}/finger_{side}",)
        travels = (("open", FINGER_OPEN, 1e-4), ("closed", 0.0, -1e-4))
        for what, bound, beyond in travels:

            def set_travel(
                case: Case, factor: float, column=column, bound=bound, beyond=beyond
            ) -> Case:
                def put(qpos: Floats) -> None:
                    qpos[30, column] = bound + factor * beyond

                return changed(case, put)

            PROBES[f"{name[0]} {what}"] = ("carry", "finger travel", name, set_travel)
        PROBES[f"{name[0]} home"] = ("carry", "home finger", name, moved(start, column, -1e-3))
    name = (f"{arm_name}/finger_right",)
    speed = moved(lambda case: slice(5, None), TWO.fingers[arm, 1], -FINGER_SPEED * STEP)
    PROBES[f"{arm_name} finger speed"] = ("carry", "finger speed", name, speed)

# Joint 7 of the arm that grasps; of those that give and take; of the one that lets go.
for number, arm, arm_name in ((0, 0, "left"), (1, 0, "left"), (1, 1, "right"), (2, 1, "right")):
    nudge = moved(before_switch(number), ONE.arm_joints[arm, 6], 0.1 * STEP)
    PROBES[f"switch {number} of {arm_name}"] = (
        "handover",
        "switch speed",
        (f"{arm_name}/joint7",),
        nudge,
    )

YELLOW, BY_LEFT = ("object/yellow",), ("object/yellow", "left")
PROBES |= {
    "object speed": ("carry", "object speed", ("object/can",), moved(from_sample_50, CAN[0], 5.0 * STEP)),
    "standing shift": ("carry", "standing shift", ("object/can",), moved(from_sample_50, CAN[1], 1e-3)),
    "standing turn": ("carry", "standing turn", ("object/can",), turned(from_sample_50, CAN, Z, 1e-2)),
    "home shift": ("carry", "home shift", ("object/can",), moved(everywhere, CAN[0], 1e-3)),
    "home turn": ("carry", "home turn", ("object/can",), turned(everywhere, CAN, X, 1e-2)),
    "slip shift": ("carry", "slip shift", BY_LEFT, moved(middle, FIRST[2], 1e-3)),
    "slip turn": ("carry", "slip turn", BY_LEFT, turned(middle, FIRST, X, 1e-2)),
    "switch shift": ("carry", "switch shift", YELLOW, moved(held, FIRST[2], 3e-3)),
    "switch turn": ("carry", "switch turn", YELLOW, turned(held, FIRST, Z, 2e-2)),
    "closing axis of a box, yaw": ("carry", "closing axis", BY_LEFT, turned(grasp, FIRST, Z, 2e-2)),
    "closing axis of a box, tilt": ("carry", "closing axis", BY_LEFT, turned(grasp, FIRST, np.cross(Z, CLOSING), 2e-2)),
    "closing axis of a can": (
        "carry_cylinder", "closing axis", ("object/tin", "left"), turned(grasp, FIRST, np.cross(Z, CLOSING), 2e-2),
    ),
    "support tilt": ("carry", "support tilt", ("object/yellow", "goal"), turned(placed, FIRST, X, 1e-2)),
    "support above": ("carry", "support height", ("object/yellow", "goal"), moved(placed, FIRST[2], 2e-3)),
    "support below": ("carry", "support height", ("object/yellow", "goal"), moved(placed, FIRST[2], -2e-3)),
}  # fmt: skip


def center_at(direction: Floats, half: float) -> Callable[[Case, float], Case]:
    """The object at the grasp so that the gripper center is beyond its side, in the object's frame."""

    def change(case: Case, factor: float) -> Case:
        def put(qpos: Floats) -> None:
            row = grasp(case)
            R = Rotation.from_quat(qpos[row, FIRST[3:]], scalar_first=True)
            qpos[row, FIRST[:3]] = HAND - R.apply(direction * (half + factor * 1e-3))

        return changed(case, put)

    return change


def beside_axis(case: Case, factor: float) -> Case:
    def put(qpos: Floats) -> None:
        qpos[grasp(case), FIRST[:3]] += factor * 2e-3 * np.cross(Z, CLOSING)

    return changed(case, put)


for sign in (1, -1):
    for axis, half in enumerate((0.025, 0.04, 0.05)):
        PROBES[f"center {axis} {sign}"] = (
            "carry",
            "gripper center",
            BY_LEFT,
            center_at(sign * np.eye(3)[axis], half),
        )
    for what, direction, half in (("radius", np.array([0.6, 0.8, 0.0]), 0.03), ("height", Z, 0.05)):
        probe = center_at(sign * direction, half)
        PROBES[f"center of a can, {what} {sign}"] = (
            "carry_cylinder",
            "gripper center",
            ("object/tin", "left"),
            probe,
        )
PROBES["closing offset"] = ("carry_cylinder", "closing offset", ("object/tin", "left"), beside_axis)


def wide(case: Case, factor: float) -> Case:
    width = 0.08 + factor * 1e-3
    size = (width, 0.08, 0.10) if case.scene.objects[0].shape == "box" else (width / 2, 0.10)
    return with_object(0, size=size)(case)


PROBES["width of a box"] = ("carry", "width", BY_LEFT, wide)
PROBES["width of a can"] = ("carry_cylinder", "width", ("object/tin", "left"), wide)

for finger in range(2):
    for sign in (1, -1):
        PROBES[f"grip {finger} {sign}"] = (
            "carry",
            "grip",
            BY_LEFT,
            moved(middle, TWO.fingers[0, finger], sign * 1e-3),
        )


def region_moved(axis: int, sign: int, slack: float) -> Callable[[Case, float], Case]:
    """The goal's region shifted along its own axis until what is placed sticks out."""

    def change(case: Case, factor: float) -> Case:
        region = case.scene.goal.region
        way = (
            sign
            * (slack + factor * 2e-3)
            * np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])[axis]
        )
        position = (region.position[0] + way[0], region.position[1] + way[1])
        goal = replace(case.scene.goal, region=replace(region, position=position))
        return replace(case, scene=replace(case.scene, goal=goal))

    return change


for sign in (1, -1):
    for axis in range(2):
        # The region is 14 cm wide, the box 5 x 8 cm and turned as the region is, the can 6 cm thick.
        probe = region_moved(axis, sign, (0.045, 0.03)[axis])
        PROBES[f"overhang {axis} {sign}"] = (
            "carry",
            "support overhang",
            ("object/yellow", "goal"),
            probe,
        )
        probe = region_moved(axis, sign, 0.04)
        PROBES[f"overhang of a can {axis} {sign}"] = (
            "carry_cylinder",
            "support overhang",
            ("object/tin", "goal"),
            probe,
        )


def tilted_can(sign: int) -> Callable[[Case, float], Case]:
    """A can that stands on its rim, above or below the table."""

    def change(case: Case, factor: float) -> Case:
        def put(qpos: Floats) -> None:
            tilt, rows = 0.009, placed(case)
            qpos[rows, FIRST[3:]] = Rotation.from_euler("x", tilt).as_quat(scalar_first=True)
            qpos[rows, FIRST[2]] = 0.05 * np.cos(tilt) + 0.03 * np.sin(tilt) + sign * factor * 2e-3

        return changed(case, put)

    return change


for sign in (1, -1):
    PROBES[f"rim {sign}"] = (
        "carry_cylinder",
        "support height",
        ("object/tin", "goal"),
        tilted_can(sign),
    )


def at_the_tables_edge(case: Case, factor: float) -> Case:
    """Put down on the table, and there at its edge."""

    def put(qpos: Floats) -> None:
        qpos[placed(case), FIRST] = [1.1 - 0.025 + factor * 2e-3, 0.5, 0.05, 1.0, 0.0, 0.0, 0.0]

    return replace(
        changed(case, put), actions=(case.actions[0], Action("place", ("left", "yellow", "table")))
    )


PROBES["overhang of the table"] = (
    "carry",
    "support overhang",
    ("object/yellow", "table"),
    at_the_tables_edge,
)


@pytest.mark.parametrize("name", PROBES)
def test_a_limit_lies_where_it_is_said_to(name: str, request: pytest.FixtureRequest) -> None:
    fixture, kind, names, change = PROBES[name]
    case = request.getfixturevalue(fixture)

    def found(factor: float) -> bool:
        wrong = change(case, factor)
        report = check_motion(wrong.scene, wrong.actions, wrong.motion)
        return (kind, names) in {(finding.kind, finding.names) for finding in report.findings}

    assert not found(0.9)
    assert found(1.1)


def opened_from(case: Case, row: int, place: int, column: int) -> Motion:
    qpos = case.motion.qpos.copy()
    qpos[row:place, column] += 2e-3
    return replace(case.motion, qpos=qpos)


def test_fingers_may_open_where_the_object_will_stand_and_not_before(carry: Case) -> None:
    place = int(carry.motion.switch[1])
    away = np.linalg.norm(
        carry.motion.qpos[:, FIRST[:3]] - carry.motion.qpos[place, FIRST[:3]], axis=1
    )
    near = next(row for row in range(place, 0, -1) if away[row - 1] > 2.9e-3)
    far = next(row for row in range(place, 0, -1) if away[row] > 3.1e-3)
    for row, expected in ((near, set()), (far, {"grip"})):
        motion = opened_from(carry, row, place, TWO.fingers[0, 0])
        kinds = {
            finding.kind for finding in check_motion(carry.scene, carry.actions, motion).findings
        }
        assert kinds - {"finger speed"} == expected


def test_a_closed_gripper_elsewhere_does_not_let_the_giving_one_open(handover: Case) -> None:
    """The taking gripper closes in the air, and only then the giving one opens, with the object on its way."""
    grasped, taken, _ = handover.motion.switch.tolist()

    def change(qpos: Floats) -> None:
        closing, opening = ONE.fingers[1], ONE.fingers[0]
        qpos[grasped : grasped + 20, closing] = np.linspace(0.04, 0.025, 20)[:, None]
        qpos[grasped + 20 : taken + 1, closing] = 0.025
        qpos[grasped + 20 : grasped + 40, opening] = np.linspace(0.025, 0.04, 20)[:, None]
        qpos[grasped + 40 : taken, opening] = 0.04

    wrong = changed(handover, change)
    findings = check_motion(wrong.scene, wrong.actions, wrong.motion).findings
    assert ("grip", ("object/bar", "left")) in {
        (finding.kind, finding.names) for finding in findings
    }


def test_the_sign_of_a_quaternion_means_nothing(carry: Case) -> None:
    def flip(qpos: Floats) -> None:
        qpos[::2, FIRST[3:]] *= -1
        qpos[::3, CAN[3:]] *= -1

    flipped = changed(carry, flip)
    reports = [check_motion(case.scene, case.actions, case.motion) for case in (carry, flipped)]
    assert reports[0].passed and reports[1].passed
    assert reports[1].deepest_penetration == pytest.approx(reports[0].deepest_penetration, abs=1e-9)
