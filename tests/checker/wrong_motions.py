"""Motions made wrong on purpose, each with the findings that the check owes it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from puppet import Case, layout_of

from dvr_jax.logic import Action
from dvr_jax.motion import Motion

LAYOUT = layout_of(2)
YELLOW, CAN = LAYOUT.objects
RIGHT_JOINT_4 = LAYOUT.arm_joints[1, 3]
RIGHT_JOINT_7 = LAYOUT.arm_joints[1, 6]


def changed(case: Case, change: Callable[[np.ndarray], None]) -> Case:
    """The case with another motion: `change` works on a copy of the states."""
    qpos = case.motion.qpos.copy()
    change(qpos)
    return replace(case, motion=replace(case.motion, qpos=qpos))


def turned_about(axis: int, angle: float, quaternion: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) after a turn about a world axis."""
    w, xyz = np.cos(angle / 2), np.eye(3)[axis] * np.sin(angle / 2)
    scalar = w * quaternion[..., :1] - quaternion[..., 1:] @ xyz[:, None]
    vector = (
        w * quaternion[..., 1:] + quaternion[..., :1] * xyz + np.cross(xyz, quaternion[..., 1:])
    )
    return np.concatenate([scalar, vector], axis=-1)


def limit_violated(case: Case) -> Case:
    def change(qpos: np.ndarray) -> None:
        qpos[:, RIGHT_JOINT_4] = np.linspace(qpos[0, RIGHT_JOINT_4], -3.0718 - 0.02, len(qpos))

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
    return lambda case: replace(
        case, actions=(Action("grasp", ("left", face, "yellow")), case.actions[1])
    )


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
        qpos[: len(closing), LAYOUT.fingers[0]] = np.minimum(
            closing, qpos[: len(closing), LAYOUT.fingers[0, 0]]
        )[:, None]
        qpos[case.motion.switch[0] - 10 : case.motion.switch[0] + 1, LAYOUT.fingers[0]] = (
            np.linspace(0.02, 0.025, 11)[:, None]
        )

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
        qpos[grasp:place, LAYOUT.fingers[0]] += (
            0.002 * np.sin(np.linspace(0.0, np.pi, place - grasp))[:, None]
        )

    return changed(case, change)


YELLOW_NAME, CAN_NAME = ("object/yellow",), ("object/can",)
BY_LEFT = ("object/yellow", "left")
AT_GOAL = ("object/yellow", "goal")

CASES: list[tuple[Callable[[Case], Case], set[tuple[str, tuple[str, ...]]]]] = [
    (
        fingers_closed_too_early,
        {("penetration", (f"left/finger_{side}", "object/yellow")) for side in ("left", "right")},
    ),
    (limit_violated, {("joint limit", ("right/joint4",))}),
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
            ("gripper center", BY_LEFT),
            ("switch shift", YELLOW_NAME),
            ("object speed", YELLOW_NAME),
            ("slip shift", BY_LEFT),
            # It jumps through the hand.
            *(
                ("penetration", (f"left/{part}", "object/yellow"))
                for part in ("hand", "link5", "link6", "link7")
            ),
        },
    ),
    (grasped_at("+y"), {("closing axis", BY_LEFT), ("grip", BY_LEFT)}),
    (grasped_at("-x"), {("closing axis", BY_LEFT)}),
    (too_wide, {("closing axis", BY_LEFT), ("grip", BY_LEFT), ("width", BY_LEFT)}),
    (posture_off, {("home posture", ("right/joint7",))}),
    (
        fingers_off,
        {("home finger", ("left/finger_left",)), ("finger speed", ("left/finger_left",))},
    ),
    (with_object(1, position=(0.25, 0.255)), {("home shift", CAN_NAME)}),
    (with_object(1, yaw=0.1), {("home turn", CAN_NAME)}),
    (goal_elsewhere, {("support overhang", AT_GOAL)}),
    (placed_too_high, {("support height", AT_GOAL)}),
    (placed_tilted, {("support tilt", AT_GOAL)}),
    (never_released, {("goal held", BY_LEFT)}),
]
