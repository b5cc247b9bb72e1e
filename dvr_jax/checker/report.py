"""What the check answers: its findings, and the verdict over a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from dvr_jax.checker.kinds import FindingKind

MILLIMETERS = 1e3
"""Millimeters in a meter."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, at the sample at which it is worst."""

    definition: FindingKind
    """What is wrong."""

    time: float
    """When [s]."""

    names: tuple[str, ...]
    """The bodies, joints, arms or supports concerned."""

    value: float
    """By how much, in m, rad, m/s, rad/s, rad/s^2, rad/s^3 or N m."""

    limit: float
    """Largest value that is accepted, in the same unit."""

    @property
    def kind(self) -> str:
        """Name of the kind, as in "penetration"."""
        return self.definition.name

    def __str__(self) -> str:
        unit = self.definition.unit
        scale = MILLIMETERS if unit == "mm" else 1.0
        sentence = self.definition.sentence.format(
            *self.names, value=f"{scale * self.value:.3g} {unit}"
        )
        limit = f" (limit {scale * self.limit:.3g} {unit})" if unit else ""
        return f"at {self.time:.2f} s {sentence}{limit}"


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The verdict over a motion."""

    passed: bool
    """True when there is no finding."""

    findings: tuple[Finding, ...]
    """Findings in the order of their times; of each kind and names only the worst sample."""

    deepest_penetration: float
    """Deepest penetration over all samples and all pairs of bodies [m]; zero without contact."""

    samples: int
    """Number of samples of the motion."""

    duration: float
    """Duration of the motion [s]."""


def describe(report: CheckReport) -> str:
    """Write a report as text: one line for the verdict, then one line for each finding."""
    verdict = "passed" if report.passed else f"failed with {len(report.findings)} findings"
    depth = MILLIMETERS * report.deepest_penetration
    headline = (
        f"check {verdict}: {report.samples} states over {report.duration:.1f} s replayed in MuJoCo, "
        f"deepest penetration {depth:.2f} mm"
    )
    lines = [f"  {finding}" for finding in report.findings]
    return "\n".join([headline, *lines])


@dataclass(frozen=True, slots=True)
class FindingLog:
    """Collects findings and keeps the worst one of each kind and names."""

    time: Float[np.ndarray, " samples"]
    """Times of the motion's samples [s]."""

    worst: dict[tuple[str, tuple[str, ...]], Finding] = field(default_factory=dict)
    """Worst finding of each kind and names."""

    def add(
        self,
        kind: FindingKind,
        sample: int,
        names: tuple[str, ...],
        value: float,
        limit: float,
    ) -> None:
        """Keep a value that exceeds its limit, unless a worse one of its kind and names is known.

        Args:
            kind: What the value measures.
            sample: Sample at which it was measured.
            names: The bodies, joints, arms or supports concerned.
            value: The measured value; a value that is not a number exceeds every limit.
            limit: Largest value that is accepted.
        """
        if value <= limit:
            return

        known = self.worst.get((kind.name, names))
        if known is not None and known.value - known.limit >= value - limit:
            return
        self.worst[kind.name, names] = Finding(
            kind, float(self.time[sample]), names, float(value), limit
        )

    def add_worst(
        self,
        kind: FindingKind,
        first: int,
        names: tuple[str, ...],
        values: Float[np.ndarray, " n"],
        limit: float,
    ) -> None:
        """Add the largest of the values of consecutive samples.

        Args:
            kind: What the values measure.
            first: Sample of the first value.
            names: The bodies, joints, arms or supports concerned.
            values: The measured values; there may be none.
            limit: Largest value that is accepted.
        """
        if len(values):
            index = int(values.argmax())
            self.add(kind, first + index, names, float(values[index]), limit)

    def add_worst_of_each(
        self,
        kind: FindingKind,
        first: int,
        names: Sequence[tuple[str, ...]],
        values: Float[np.ndarray, "samples joints"],
        limits: Float[np.ndarray, " joints"] | float,
    ) -> None:
        """Add the largest of the values of consecutive samples of each joint that exceeds its limit.

        Args:
            kind: What the values measure.
            first: Sample of the first values.
            names: Names of each joint.
            values: The measured values.
            limits: Largest values that are accepted.
        """
        limit_of_joint = np.broadcast_to(limits, len(names))
        is_within = (values <= limit_of_joint).all(axis=0)
        for joint in np.flatnonzero(~is_within).tolist():
            limit = float(limit_of_joint[joint])
            self.add_worst(kind, first, names[joint], values[:, joint], limit)

    def findings(self) -> tuple[Finding, ...]:
        """Return all findings in the order of their times, kinds and names."""
        return tuple(
            sorted(
                self.worst.values(),
                key=lambda finding: (finding.time, finding.kind, finding.names),
            )
        )
