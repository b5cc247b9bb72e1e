"""The speed benchmark's times: how they are printed, and their metrics with unit, direction and tolerance."""

from __future__ import annotations

from dataclasses import dataclass

from dvr_jax.bench.metrics import Direction, Metric

TOLERANCE = 0.05
"""Relative change of a time that is still no change: what two runs in turn on one machine differ by."""


def _time(name: str, value: float, unit: str) -> Metric:
    return Metric(name, value, unit, Direction.LOWER, TOLERANCE)


def _count(name: str, value: float, unit: str) -> Metric:
    return Metric(name, value, unit, Direction.HIGHER)


@dataclass(frozen=True)
class SliceTimes:
    """Times of the Gauss-Newton system of one keyframe slice."""

    objects: int
    """Objects of the scene."""
    rows: int
    """Distances in a slice."""
    values: float
    """Time of the values [s]."""
    derivatives: float
    """Time of the derivatives and of the matrix [s]."""

    @property
    def name(self) -> str:
        """Name of the time."""
        return f"Gauss-Newton system, {self.objects} objects"

    def line(self) -> str:
        """Give the line that is printed."""
        values = 1e6 * self.values
        derivatives = 1e6 * self.derivatives
        return (
            f"{self.name} ({self.rows} rows): {values + derivatives:.1f} us a slice "
            f"({values:.1f} values, {derivatives:.1f} derivatives)"
        )

    def metrics(self) -> list[Metric]:
        """Give the metrics."""
        return [
            _time(self.name, 1e6 * (self.values + self.derivatives), "us/slice"),
            _time(f"{self.name}: values", 1e6 * self.values, "us/slice"),
            _time(f"{self.name}: derivatives", 1e6 * self.derivatives, "us/slice"),
        ]


@dataclass(frozen=True)
class KeyframeTimes:
    """Times of the verdict on one prefix, in a batch."""

    length: int
    """Number of actions."""
    problems: int
    """Prefixes of the batch."""
    beam: float
    """Time of the beam of keyframe candidates [s]."""
    nlp: float
    """Time of the NLPs, spread over all prefixes [s]."""
    proved: int
    """Prefixes that a candidate proves feasible."""
    found: int
    """Other prefixes whose NLP is feasible."""

    @property
    def name(self) -> str:
        """Name of the time."""
        return f"keyframes of length {self.length}"

    def line(self) -> str:
        """Give the line that is printed."""
        beam = 1e3 * self.beam
        nlp = 1e3 * self.nlp
        return (
            f"{self.name}, {beam + nlp:.1f} ms a problem in a batch of {self.problems}: "
            f"{beam:.1f} ms for the beam, which proves {self.proved} feasible, {nlp:.1f} ms for the NLPs of the "
            f"others, {self.found} feasible"
        )

    def metrics(self) -> list[Metric]:
        """Give the metrics."""
        return [
            _time(self.name, 1e3 * (self.beam + self.nlp), "ms"),
            _time(f"{self.name}: beam", 1e3 * self.beam, "ms"),
            _time(f"{self.name}: NLPs", 1e3 * self.nlp, "ms"),
            _count(f"{self.name}: problems", self.problems, "problems"),
            _count(f"{self.name}: feasible", self.proved + self.found, "problems"),
        ]


@dataclass(frozen=True)
class PathTimes:
    """Times of path NLPs from one start each."""

    length: int
    """Number of actions."""
    problems: int
    """Paths."""
    median: float
    """Median time of a path [s]."""
    iterations: float
    """Median number of iterations."""
    feasible: int
    """Feasible paths."""

    @property
    def name(self) -> str:
        """Name of the time."""
        return f"path NLPs of length {self.length}"

    def line(self) -> str:
        """Give the line that is printed."""
        return (
            f"{self.name}: median {1e3 * self.median:.0f} ms, {self.iterations:.0f} iterations, "
            f"{self.feasible} of {self.problems} feasible"
        )

    def metrics(self) -> list[Metric]:
        """Give the metrics."""
        return [
            _time(self.name, 1e3 * self.median, "ms"),
            Metric(
                f"{self.name}: iterations",
                self.iterations,
                "iterations",
                Direction.LOWER,
                TOLERANCE,
            ),
            _count(f"{self.name}: problems", self.problems, "problems"),
            _count(f"{self.name}: feasible", self.feasible, "problems"),
        ]
