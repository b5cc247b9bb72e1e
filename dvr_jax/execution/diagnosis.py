"""When an executed motion first leaves its plan, and why.

An object has left its plan when it is farther from its planned pose than `LARGEST_DISPLACEMENT` or `LARGEST_TURN`. The
cause lies earlier, at the *onset*: the first record after which it was no longer near that pose. What the plan does
with the object at the onset, and what touches it there, tell the cause.

Near means within a fifth of the limits. An object that was displaced at the start is expected there until its grasp,
and may be off by as much afterwards: it is carried as it was grasped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import unquote

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.operators.operator import AttachmentInterval, Timeline
from dvr_jax.execution.commands import GripInterval
from dvr_jax.execution.report import Deviation, DeviationCause
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import Layout
from dvr_jax.scene.mjcf import fixed_body_name, object_body_name
from dvr_jax.scene.types import Scene

LARGEST_DISPLACEMENT = 0.01
"""An object that is farther from its planned position has left its plan [m]."""

LARGEST_TURN = 0.2
"""An object that is turned by more against its planned rotation has left its plan [rad]."""

ONSET_FRACTION = 0.2
"""Fraction of these limits up to which an object still counts as near its planned pose."""

AFTER_SWITCH = 1.0
"""Time after a switch in which a disturbance is a consequence of the switch [s]."""

TOUCH_TIME = 0.1
"""Time before an onset in which a touch may have caused it [s]."""


@dataclass(frozen=True, slots=True)
class ExecutedMotion:
    """A motion, and the states that physics reached at its samples and after its end."""

    scene: Scene
    """The scene."""

    motion: Motion
    """The planned motion."""

    timeline: Timeline
    """Intervals in which objects keep their attachments."""

    grips: tuple[GripInterval, ...]
    """When each gripper is closed on an object."""

    layout: Layout
    """Where each quantity lies in a state."""

    states: Float[np.ndarray, "records nq"]
    """States at the samples of the motion, and as often after its end."""

    touches: Sequence[frozenset[tuple[int, int]]]
    """Pairs of bodies of the model that touched each other at any step since the record before, for each record."""

    def planned_sample(self, record: int) -> int:
        """Return the sample of the motion that a record is compared with: the last one after the motion's end."""
        return min(record, len(self.motion.time) - 1)


def differences(
    planned: Float[np.ndarray, "records 7"], reached: Float[np.ndarray, "records 7"]
) -> tuple[Float[np.ndarray, " records"], Float[np.ndarray, " records"]]:
    """Compare poses, each a position and a unit quaternion w x y z.

    The angle between the quaternions p and r is ``2 arccos |p . r|``.

    Args:
        planned: Planned poses.
        reached: Reached poses.

    Returns:
        Distances of the positions [m], and angles between the rotations [rad].
    """
    distance = np.linalg.norm(reached[:, :3] - planned[:, :3], axis=1)
    cosine = np.abs(np.sum(planned[:, 3:] * reached[:, 3:], axis=1))
    return distance, 2 * np.arccos(np.clip(cosine, 0.0, 1.0))


def find_deviation(model: mujoco.MjModel, executed: ExecutedMotion) -> Deviation | None:
    """Find the first deviation of an executed motion from its plan.

    Args:
        model: The model in which the motion was executed.
        executed: The motion and the states that were reached.

    Returns:
        The deviation with the earliest onset; None if every object followed the plan to the end.
    """
    planned = _planned_states(executed)
    onsets: list[tuple[int, int, int]] = []
    for index, columns in enumerate(executed.layout.objects):
        distance, turn = differences(planned[:, columns], executed.states[:, columns])
        excess = np.maximum(distance / LARGEST_DISPLACEMENT, turn / LARGEST_TURN)
        beyond = np.flatnonzero(excess > 1)
        if len(beyond):
            allowed = ONSET_FRACTION + _initial_offset(executed, index)
            near = np.flatnonzero(excess[: beyond[0]] <= allowed)
            onset = int(near[-1]) + 1 if len(near) else 0
            onsets.append((onset, index, int(beyond[0])))
    if not onsets:
        return None

    record, index, far = min(onsets)
    touched_by = _touching(model, executed, index, record)
    return Deviation(
        time=record * executed.motion.step,
        object=executed.scene.objects[index].name,
        cause=_cause(executed, index, record, far, touched_by),
        touched_by=touched_by,
    )


def _planned_states(executed: ExecutedMotion) -> Float[np.ndarray, "records nq"]:
    """Return the planned state for each record; an object that was displaced at the start stays so until its grasp."""
    samples = [executed.planned_sample(record) for record in range(len(executed.states))]
    planned = executed.motion.qpos[samples].copy()

    for interval in executed.timeline.intervals:
        if interval.start == 0:
            columns = executed.layout.objects[interval.object]
            end = interval.end if interval.end < len(executed.motion.time) else len(planned)
            planned[:end, columns] = executed.states[0, columns]
    return planned


def _initial_offset(executed: ExecutedMotion, index: int) -> float:
    """Return how far an object was displaced at the start, as a fraction of `LARGEST_DISPLACEMENT`."""
    columns = executed.layout.objects[index]
    distance, _ = differences(executed.motion.qpos[:1, columns], executed.states[:1, columns])
    return float(distance[0]) / LARGEST_DISPLACEMENT


def _cause(
    executed: ExecutedMotion, index: int, record: int, far: int, touched_by: tuple[str, ...]
) -> DeviationCause:
    """Classify a disturbance by what the plan does with the object at its onset.

    Args:
        executed: The executed motion.
        index: Number of the object.
        record: The onset.
        far: First record at which the object has left its plan.
        touched_by: What touched the object at the onset.
    """
    sample = executed.planned_sample(record)
    interval = next(
        other
        for other in executed.timeline.intervals
        if other.object == index and other.start <= sample < other.end
    )
    before = executed.timeline.before(interval)
    after = executed.timeline.after(interval)
    is_recent = (record - interval.start) * executed.motion.step < AFTER_SWITCH

    if interval.holder is not None:
        was_held = before is not None and before.holder is not None
        if (is_recent and was_held) or _closes_on(executed, after, record):
            return DeviationCause.HANDOVER
        return (
            DeviationCause.SLIPPED if _has_moved(executed, interval, far) else DeviationCause.MISSED
        )

    if before is not None and (is_recent or record > sample):
        return DeviationCause.RELEASE

    # The object stands. Whether the arm that touches it is the one that grasps it next makes the difference.
    if after is not None and after.holder is not None:
        prefix = executed.scene.workcell.arm_names[after.holder] + "/"
        if any(name.startswith(prefix) for name in touched_by):
            return DeviationCause.PUSHED
    return DeviationCause.COLLISION


def _has_moved(executed: ExecutedMotion, interval: AttachmentInterval, record: int) -> bool:
    """Tell whether an object has moved at all since its grasp."""
    columns = executed.layout.objects[interval.object]
    poses = executed.states[[interval.start, record]][:, columns]
    distance, turn = differences(poses[:1], poses[1:])
    return bool(
        distance[0] > ONSET_FRACTION * LARGEST_DISPLACEMENT
        or turn[0] > ONSET_FRACTION * LARGEST_TURN
    )


def _closes_on(executed: ExecutedMotion, after: AttachmentInterval | None, record: int) -> bool:
    """Tell whether the gripper that takes an object next is closed on it already, before the switch."""
    if after is None or after.holder is None:
        return False
    return any(
        grip.arm == after.holder
        and grip.object == after.object
        and grip.first <= record <= after.start
        for grip in executed.grips
    )


def _touching(
    model: mujoco.MjModel, executed: ExecutedMotion, index: int, record: int
) -> tuple[str, ...]:
    """Return the names of the bodies that touched an object shortly before a record.

    The table is left out, and so are the fixed bodies on which objects may stand.
    """
    body = model.body(object_body_name(executed.scene.objects[index].name)).id
    scene = executed.scene
    owners = {place.owner for place in scene.supports().values()}
    owners |= {item.support for item in scene.objects}
    tops = {
        model.body(fixed_body_name(item.name)).id for item in scene.fixed if item.name in owners
    }
    tops.add(model.body("table").id)
    earlier = math.ceil(TOUCH_TIME / executed.motion.step)
    touches = frozenset[tuple[int, int]]().union(
        *executed.touches[max(record - earlier, 0) : record + 1]
    )

    others = {other for pair in touches if body in pair for other in pair} - {body} - tops
    return tuple(sorted(unquote(model.body(other).name) for other in others))
