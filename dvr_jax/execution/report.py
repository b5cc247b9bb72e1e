"""What became of a plan in physics."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

NO_DEVIATION = "no object left its plan"
"""Why an execution failed in which the goal was missed by less than counts as a deviation."""

DIVERGED = "the simulation diverged"
"""Why an execution failed whose numbers mean nothing."""


class DeviationCause(StrEnum):
    """Why an object first left the pose that the plan has for it."""

    PUSHED = "pushed before its grasp"
    """An arm touched the object while it stood, and grasps it next."""

    COLLISION = "hit while it stood"
    """The object moved while it stood: something touched it that is not the arm that grasps it next."""

    SLIPPED = "slipped in the gripper"
    """The object moved in the gripper that holds it."""

    HANDOVER = "touched at the handover"
    """The object moved in its gripper while another one closed on it, or soon after."""

    RELEASE = "knocked at its release"
    """The object moved after its gripper had opened."""

    MISSED = "not grasped"
    """The gripper closed, and the object did not come along."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """The first moment at which an object is not where the plan has it."""

    time: float
    """Time since the start of the motion [s]."""

    object: str
    """Name of the object."""

    cause: DeviationCause
    """Why."""

    touched_by: tuple[str, ...]
    """Bodies that touched it at this moment or shortly before, other than those on which objects may stand."""

    def sentence(self) -> str:
        """Return the deviation in words."""
        touching = f" (touched by {', '.join(self.touched_by)})" if self.touched_by else ""
        verb = "" if self.cause is DeviationCause.SLIPPED else "was "
        return f"at {self.time:.2f} s {self.object} {verb}{self.cause.value}{touching}"


@dataclass(frozen=True, slots=True)
class ObjectResult:
    """Where an object is at the end, compared with the plan."""

    name: str
    """Name of the object."""

    displacement: float
    """Distance of its center from the planned one [m]."""

    turn: float
    """Angle of its rotation against the planned one [rad]."""


@dataclass(frozen=True, slots=True)
class ExecutionReport:
    """What became of a plan in physics."""

    succeeded: bool
    """Whether the goal holds at the end."""

    is_stable: bool
    """False if the simulation diverged; then nothing else of the report means anything."""

    objects: tuple[ObjectResult, ...]
    """Every object at the end."""

    deviation: Deviation | None
    """The first deviation; None if every object followed the plan to the end, or if the simulation diverged."""

    duration: float
    """Simulated time [s]."""

    @property
    def failure(self) -> str:
        """Why the execution failed, in words; empty if it succeeded."""
        if self.succeeded:
            return ""
        if not self.is_stable:
            return DIVERGED
        return self.deviation.cause.value if self.deviation else NO_DEVIATION
