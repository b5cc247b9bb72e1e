"""The check's own description of each operator, and the intervals into which the actions divide a motion.

Each action changes how one object is attached, at the action's switch. The object's motion up to its next switch is one
`AttachmentInterval`. What the check requires of every object in every interval follows from the attachment:

- a standing object does not move in the world;
- a held object does not move in the frame of the gripper that holds it, and that hand is not empty;
- for a moving object only its operator says what is required.

Everything else is checked by `OperatorCheck.check`. Nothing here is shared with the planner's operators: in particular,
`Attachment` and `Parameter` are other classes than those of `dvr_jax.modes` and `dvr_jax.operators`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from dvr_jax.checker.operators.parameter import Arguments, Parameter
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.tolerances import SHIFT_AT_SWITCH
from dvr_jax.scene.types import Scene


@dataclass(frozen=True, slots=True)
class Standing:
    """The object does not move in the world."""


@dataclass(frozen=True, slots=True)
class Held:
    """The object does not move in the gripper of one arm."""

    arm: int
    """Number of the arm."""


@dataclass(frozen=True, slots=True)
class Moving:
    """The object moves as its operator's own check allows; no arm holds it."""


Attachment = Standing | Held | Moving
"""How an object is attached: to the world, to a gripper, or to nothing."""


@dataclass(frozen=True, slots=True)
class AttachmentInterval:
    """The samples from `start` to `end - 1`, in which one object keeps its attachment."""

    object: int
    """Number of the object."""

    start: int
    """First sample: 0, or the switch of the action that opened the interval."""

    end: int
    """One past the last sample."""

    attachment: Attachment
    """How the object is attached."""

    operator: OperatorCheck
    """Operator of the action that opened the interval."""

    arguments: Arguments
    """Arguments of that action."""

    @property
    def holder(self) -> int | None:
        """Number of the arm that holds the object; None where no arm does."""
        return self.attachment.arm if isinstance(self.attachment, Held) else None


@dataclass(frozen=True, slots=True)
class Timeline:
    """The intervals of all objects; those of one object follow each other without gaps."""

    intervals: tuple[AttachmentInterval, ...]
    """In the order of their first samples, then of their objects."""

    def before(self, interval: AttachmentInterval) -> AttachmentInterval | None:
        """Return the interval of the same object that ends where this one starts; None for the first one."""
        for other in self.intervals:
            if other.object == interval.object and other.end == interval.start:
                return other
        return None

    def after(self, interval: AttachmentInterval) -> AttachmentInterval | None:
        """Return the interval of the same object that starts where this one ends; None for the last one."""
        for other in self.intervals:
            if other.object == interval.object and other.start == interval.end:
                return other
        return None

    def last(self, index: int) -> AttachmentInterval:
        """Return the interval that an object ends in."""
        return max(
            (other for other in self.intervals if other.object == index),
            key=lambda other: other.end,
        )


def in_place(motion: ReplayedMotion, interval: AttachmentInterval) -> Bool[np.ndarray, " samples"]:
    """Find the samples at which an object is already where an interval begins.

    Args:
        motion: The replayed motion.
        interval: An interval of the object.

    Returns:
        True where the object is within `SHIFT_AT_SWITCH` of its position at the interval's first sample.
    """
    positions = motion.object_positions[:, interval.object]
    distance = np.linalg.norm(positions - positions[interval.start], axis=1)
    return np.asarray(distance <= SHIFT_AT_SWITCH)


@dataclass(frozen=True)
class OperatorCheck:
    """The check's description of an operator.

    To check plans with a further operator, pass such an object together with `CHECKS` to
    `dvr_jax.checker.check_motion`.
    """

    name: str
    """Name of the operator in actions."""

    parameters: tuple[Parameter, ...]
    """Parameters in the order of an action's arguments. `ARM` and `OBJECT` are among them: the arm must be at rest at
    the switch, and the object is the one whose attachment changes."""

    refusal: Callable[[Arguments, Mapping[str, str]], str]
    """Function that returns why an action does not apply, in one sentence, or "" if it applies. Its second argument
    maps the name of each arm that holds an object to the name of this object."""

    attachment: Callable[[Scene, Arguments], Attachment]
    """Function that returns how the object is attached after the switch."""

    check: Callable[[ReplayedMotion, Timeline, AttachmentInterval, FindingLog], None]
    """Function that logs everything that is wrong at the switch and during the interval that begins with it, in
    addition to what the attachment requires of every object."""

    secured: Callable[[ReplayedMotion, AttachmentInterval], Bool[np.ndarray, " samples"]] = in_place
    """Function that returns at which samples the object is already secured for the interval that begins with this
    action, so that an arm that held the object until the switch may open its fingers."""
