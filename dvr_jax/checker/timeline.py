"""Who holds what, from which switch of a motion to which, as its actions say."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.logic import FACES, Action
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.constants import ARM_NAMES


@dataclass(frozen=True, slots=True)
class AttachmentInterval:
    """Samples start to end - 1, in which an object is held by an arm or stands on a support."""

    object: int
    start: int
    end: int
    arm: int = -1
    face: str = ""
    support: str = ""
    """Where a place has put it; empty for one that stands where the scene has it."""


def attachment_timeline(
    scene: Scene, actions: Sequence[Action], end: int, switch: NDArray[np.int64]
) -> tuple[AttachmentInterval, ...]:
    """Each object's spans over samples 0 to end - 1, without gaps; DvrError for an action that does not apply."""
    indices = {item.name: index for index, item in enumerate(scene.objects)}
    done: list[AttachmentInterval] = []
    now = {index: AttachmentInterval(index, 0, end) for index in indices.values()}  # one span of each object is open
    for number, (action, sample) in enumerate(zip(actions, switch.tolist(), strict=True), start=1):
        held_by = {span.arm: index for index, span in now.items() if span.arm >= 0}
        match action:
            case Action("grasp", (arm, face, name)) if arm in ARM_NAMES and face in FACES and name in indices:
                if ARM_NAMES.index(arm) in held_by:
                    raise DvrError(f"action {number}, {action}: {arm} already holds an object; its hand must be empty.")
                span = AttachmentInterval(indices[name], sample, end, ARM_NAMES.index(arm), face)
            case Action("place", (arm, name, support)) if name in indices and support in ("table", "goal"):
                if arm not in ARM_NAMES or held_by.get(ARM_NAMES.index(arm)) != indices[name]:
                    raise DvrError(f"action {number}, {action}: {arm} does not hold {name}, so it cannot place it.")
                span = AttachmentInterval(indices[name], sample, end, support=support)
            case _:
                raise DvrError(
                    f"action {number}, {action}: valid are grasp(arm, face, object) and place(arm, object, support) "
                    f"with arms {', '.join(ARM_NAMES)}; faces {', '.join(FACES)}; objects {', '.join(indices)}; "
                    "supports table, goal."
                )
        done.append(replace(now[span.object], end=sample))
        now[span.object] = span
    return tuple(sorted((*done, *now.values()), key=lambda span: (span.start, span.object)))


def next_interval(story: tuple[AttachmentInterval, ...], span: AttachmentInterval) -> AttachmentInterval | None:
    """Who has the object after a span."""
    return next((other for other in story if other.object == span.object and other.start == span.end), None)
