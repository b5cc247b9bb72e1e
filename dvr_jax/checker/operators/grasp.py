"""The check of grasp(arm, face, object): a gripper closes on an object that stands or that another arm holds.

At the switch the gripper center lies in the object, the closing axis is the normal of the named face, and the object
fits between the fingers. For a cylinder, the closing axis is horizontal and passes through the cylinder's own axis.
From the switch on the fingers are closed on the object's sides.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.checker.kinds import (
    CLOSING_AXIS,
    CLOSING_OFFSET,
    GRIP,
    GRIPPER_CENTER,
    WIDTH,
)
from dvr_jax.checker.operators.operator import (
    AttachmentInterval,
    Held,
    OperatorCheck,
    Timeline,
)
from dvr_jax.checker.operators.parameter import ARM, FACE, OBJECT, Arguments
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.shapes import shape_check_named
from dvr_jax.checker.tolerances import (
    AXIS_OFFSET,
    AXIS_TOLERANCE,
    CENTER_TOLERANCE,
    GRIP_TOLERANCE,
    SHIFT_AT_SWITCH,
)
from dvr_jax.scene.types import Scene


def _refusal(arguments: Arguments, holding: Mapping[str, str]) -> str:
    arm = arguments["arm"]
    if arm in holding:
        return f"{arm} already holds an object; its hand must be empty."
    return ""


def _attachment(scene: Scene, arguments: Arguments) -> Held:
    return Held(scene.workcell.arm_index(arguments["arm"]))


def _arm(motion: ReplayedMotion, interval: AttachmentInterval) -> int:
    """Number of the arm that grasps."""
    return motion.scene.workcell.arm_index(interval.arguments["arm"])


def _check(
    motion: ReplayedMotion,
    timeline: Timeline,
    interval: AttachmentInterval,
    log: FindingLog,
) -> None:
    _check_switch(motion, interval, log)
    _check_fingers(motion, interval, timeline.after(interval), log)


def _check_switch(motion: ReplayedMotion, interval: AttachmentInterval, log: FindingLog) -> None:
    """Check the gripper's center and axis, and the object's width between the fingers, at the switch."""
    item = motion.scene.objects[interval.object]
    shape = shape_check_named(item.shape)
    face = interval.arguments["face"]
    arm = _arm(motion, interval)
    sample = interval.start
    names = (motion.object_label(interval.object), motion.arm_name(arm))

    # The gripper in the object's frame.
    to_object = motion.object_rotations[sample, interval.object].T
    offset = (
        motion.gripper_positions[sample, arm] - motion.object_positions[sample, interval.object]
    )
    center = to_object @ offset
    closing = to_object @ motion.gripper_rotations[sample, arm][:, 1]

    outside = shape.distance_outside(item.size, center)
    log.add(GRIPPER_CENTER, sample, names, outside, CENTER_TOLERANCE)

    deviation = shape.closing_deviation(item.size, face, closing)
    log.add(CLOSING_AXIS, sample, names, deviation, AXIS_TOLERANCE)

    beside = shape.closing_offset(item.size, center, closing)
    log.add(CLOSING_OFFSET, sample, names, beside, AXIS_OFFSET)

    width = 2 * shape.half_width(item.size, face)
    opening = motion.scene.workcell.robot.maximum_opening
    log.add(WIDTH, sample, names, width, opening + CENTER_TOLERANCE)


def _check_fingers(
    motion: ReplayedMotion,
    interval: AttachmentInterval,
    following: AttachmentInterval | None,
    log: FindingLog,
) -> None:
    """Check that the fingers stay closed on the object.

    Just before the interval ends they may open, once the action that ends it has secured the object: it lies where it
    will stand, or another gripper has closed on it.
    """
    gap = _finger_gap(motion, interval)
    if following is not None:
        gap = np.where(following.operator.secured(motion, following), 0.0, gap)

    names = (
        motion.object_label(interval.object),
        motion.arm_name(_arm(motion, interval)),
    )
    within = slice(interval.start, interval.end)
    log.add_worst(GRIP, interval.start, names, gap[within], GRIP_TOLERANCE)


def _finger_gap(
    motion: ReplayedMotion, interval: AttachmentInterval
) -> Float[np.ndarray, " samples"]:
    """Distance of the fingers from closed on the object at all samples, the larger one of both fingers [m]."""
    item = motion.scene.objects[interval.object]
    half_width = shape_check_named(item.shape).half_width(item.size, interval.arguments["face"])
    travels = motion.finger_travels(_arm(motion, interval))
    return np.asarray(np.abs(travels - half_width).max(axis=1))


def _secured(motion: ReplayedMotion, interval: AttachmentInterval) -> Bool[np.ndarray, " samples"]:
    """A handover: the object lies in the taking gripper as it will at the switch, and that gripper is closed on it."""
    positions, _ = motion.object_in_gripper(interval.object, _arm(motion, interval))
    distance = np.linalg.norm(positions - positions[interval.start], axis=1)
    closed = _finger_gap(motion, interval) <= GRIP_TOLERANCE
    return np.asarray((distance <= SHIFT_AT_SWITCH) & closed)


GRASP_CHECK = OperatorCheck(
    name="grasp",
    parameters=(ARM, FACE, OBJECT),
    refusal=_refusal,
    attachment=_attachment,
    check=_check,
    secured=_secured,
)
"""The operator grasp; where another arm holds the object, it is a handover."""
