"""The check of the objects' motion: the start, jumps, standing objects that move, held objects that slip."""

from __future__ import annotations

import numpy as np

from dvr_jax.checker.kinds import (
    HOME_SHIFT,
    HOME_TURN,
    OBJECT_SPEED,
    SLIP_SHIFT,
    SLIP_TURN,
    STANDING_SHIFT,
    STANDING_TURN,
    SWITCH_SHIFT,
    SWITCH_TURN,
)
from dvr_jax.checker.operators.operator import AttachmentInterval, Held, Standing
from dvr_jax.checker.replayed_motion import ReplayedMotion, angle_between
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.tolerances import (
    FASTEST_OBJECT,
    SHIFT,
    SHIFT_AT_SWITCH,
    TURN,
    TURN_AT_SWITCH,
)


def check_start_and_speed(motion: ReplayedMotion, log: FindingLog) -> None:
    """Check that every object starts where the scene has it, upright, and never jumps.

    Args:
        motion: The replayed motion.
        log: Takes the findings.
    """
    for index, item in enumerate(motion.scene.objects):
        names = (motion.object_label(index),)
        positions = motion.object_positions[:, index]
        cosine = np.cos(item.yaw)
        sine = np.sin(item.yaw)
        upright = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

        shift = np.linalg.norm(positions[0] - motion.scene.center_of(item))
        log.add(HOME_SHIFT, 0, names, float(shift), SHIFT)

        turn = angle_between(motion.object_rotations[0, index], upright)
        log.add(HOME_TURN, 0, names, float(turn), TURN)

        speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / motion.motion.step
        log.add_worst(OBJECT_SPEED, 1, names, speeds, FASTEST_OBJECT)


def check_switch(motion: ReplayedMotion, interval: AttachmentInterval, log: FindingLog) -> None:
    """Check that an object does not jump as its attachment changes.

    Args:
        motion: The replayed motion.
        interval: The interval that begins with the change.
        log: Takes the findings.
    """
    sample = interval.start
    if sample == 0:
        return

    names = (motion.object_label(interval.object),)
    positions = motion.object_positions[:, interval.object]
    rotations = motion.object_rotations[:, interval.object]

    shift = np.linalg.norm(positions[sample] - positions[sample - 1])
    log.add(SWITCH_SHIFT, sample, names, float(shift), SHIFT_AT_SWITCH)

    turn = angle_between(rotations[sample], rotations[sample - 1])
    log.add(SWITCH_TURN, sample, names, float(turn), TURN_AT_SWITCH)


def check_attachment(motion: ReplayedMotion, interval: AttachmentInterval, log: FindingLog) -> None:
    """Check that a standing object does not move in the world, and a held one not in its gripper.

    Args:
        motion: The replayed motion.
        interval: An interval of the object.
        log: Takes the findings.
    """
    label = motion.object_label(interval.object)
    match interval.attachment:
        case Standing():
            positions = motion.object_positions[:, interval.object]
            rotations = motion.object_rotations[:, interval.object]
            names: tuple[str, ...] = (label,)
            shift_kind = STANDING_SHIFT
            turn_kind = STANDING_TURN
        case Held(arm):
            positions, rotations = motion.object_in_gripper(interval.object, arm)
            names = (label, motion.arm_name(arm))
            shift_kind = SLIP_SHIFT
            turn_kind = SLIP_TURN
        case _:
            # The operator's own check says how the object may move.
            return

    within = slice(interval.start, interval.end)
    shifts = np.linalg.norm(positions[within] - positions[interval.start], axis=1)
    log.add_worst(shift_kind, interval.start, names, shifts, SHIFT)

    turns = angle_between(rotations[within], rotations[interval.start])
    log.add_worst(turn_kind, interval.start, names, turns, TURN)
