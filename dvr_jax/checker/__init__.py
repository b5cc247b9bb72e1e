"""The independent check of a plan: here what it can find and how that is said; `replay` does the checking.

Nothing in this package knows the planner: `motion` is what a planner hands over, `replay` runs it through MuJoCo C.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

KINDS: dict[str, tuple[str, str]] = {
    "penetration": ("{0} and {1} penetrate by {value}", "mm"),
    "joint limit": ("{0} is beyond its limit by {value}", "rad"),
    "finger travel": ("{0} is out of its range by {value}", "mm"),
    "joint speed": ("{0} turns at {value}", "rad/s"),
    "joint acceleration": ("{0} speeds up or slows down by {value}", "rad/s^2"),
    "switch speed": ("{0} turns at {value} as its gripper takes or gives", "rad/s"),
    "finger speed": ("{0} moves at {value}", "m/s"),
    "object speed": ("{0} moves at {value}", "m/s"),
    "standing shift": ("{0} moves by {value} while no arm holds it", "mm"),
    "standing turn": ("{0} turns by {value} while no arm holds it", "rad"),
    "switch shift": ("{0} jumps by {value} as its holder changes", "mm"),
    "switch turn": ("{0} turns by {value} as its holder changes", "rad"),
    "slip shift": ("{0} slips by {value} in the {1} gripper", "mm"),
    "slip turn": ("{0} turns by {value} in the {1} gripper", "rad"),
    "gripper centre": ("the centre of the {1} gripper is {value} outside {0} as it grasps", "mm"),
    "closing axis": ("the {1} gripper's closing axis is {value} off the normal of {0}'s face as it grasps", "rad"),
    "closing offset": ("the {1} gripper's closing axis passes {value} beside the axis of {0} as it grasps", "mm"),
    "grip": ("the fingers of the {1} gripper, which alone holds {0}, are {value} off its sides", "mm"),
    "width": ("{0} is {value} wide where the {1} gripper grasps it", "mm"),
    "home posture": ("{0} is {value} away from its home", "rad"),
    "home finger": ("{0} is {value} away from its home", "mm"),
    "home shift": ("{0} is {value} away from where the scene has it", "mm"),
    "home turn": ("{0} is turned by {value} from how the scene has it", "rad"),
    "support tilt": ("{0} is tilted by {value} on the {1}", "rad"),
    "support height": ("the bottom of {0} is {value} off the {1}", "mm"),
    "support overhang": ("{0} reaches {value} over the border of the {1}", "mm"),
    "goal held": ("the goal's {0} is still held by the {1} gripper", ""),
}
"""Every kind of finding: its words, with the places of its names, and the unit that it is told in."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, at its worst sample."""

    kind: str
    """A key of KINDS."""
    time: float
    """When, s."""
    names: tuple[str, ...]
    """What: bodies, joints, arms or a support."""
    value: float
    """How much, in m, rad, m/s, rad/s or rad/s^2."""
    limit: float
    """What would have been accepted, in the same unit."""

    def __str__(self) -> str:
        words, unit = KINDS[self.kind]
        scale = 1e3 if unit == "mm" else 1.0
        said = words.format(*self.names, value=f"{scale * self.value:.3g} {unit}")
        limit = f" (limit {scale * self.limit:.3g} {unit})" if unit else ""
        return f"at {self.time:.2f} s {said}{limit}"


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The verdict over a motion."""

    passed: bool
    """True without findings."""
    findings: tuple[Finding, ...]
    """By time; of each kind and names the worst sample only."""
    deepest_penetration: float
    """Over all samples and all pairs that may not touch, m; zero without contact."""
    samples: int
    """Number of states of the motion."""
    duration: float
    """Of the motion, s."""


def describe(report: CheckReport) -> str:
    """The report in words: the verdict, then one line a finding."""
    verdict = "passed" if report.passed else f"failed with {len(report.findings)} findings"
    head = (
        f"check {verdict}: {report.samples} states over {report.duration:.1f} s replayed in MuJoCo, "
        f"deepest penetration {1e3 * report.deepest_penetration:.2f} mm"
    )
    return "\n".join([head, *(f"  {finding}" for finding in report.findings)])


@dataclass(frozen=True, slots=True)
class FindingLog:
    """Collects findings, the worst of each kind and names."""

    time: NDArray[np.float64]
    """(T,) s."""
    worst: dict[tuple[str, tuple[str, ...]], Finding] = field(default_factory=dict)

    def add(self, kind: str, sample: int, names: tuple[str, ...], value: float, limit: float) -> None:
        """Keep a value that exceeds its limit (NaN does), unless a worse one of its kind and names is known."""
        known = self.worst.get((kind, names))
        if value <= limit or (known is not None and known.value - known.limit >= value - limit):
            return
        self.worst[kind, names] = Finding(kind, float(self.time[sample]), names, float(value), limit)

    def add_worst(
        self, kind: str, first: int, names: tuple[str, ...], values: NDArray[np.float64], limit: float
    ) -> None:
        """The same for the values of consecutive samples, the first of them at sample `first`."""
        if len(values):
            index = int(values.argmax())
            self.add(kind, first + index, names, float(values[index]), limit)
