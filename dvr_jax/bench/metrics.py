"""Metrics of a benchmark in one small JSON file: value, unit, direction, tolerance, and the version and machine."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path

from dvr_jax.bench.results_file import describe_machine
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import read_whole, write_whole
from dvr_jax.runtime.json_text import parse_json


class Direction(Enum):
    """Which values of a metric are better."""

    LOWER = "lower"
    HIGHER = "higher"
    EQUAL = "equal"
    """Only the same value is right."""


@dataclass(frozen=True)
class Metric:
    """One figure of a benchmark."""

    metric: str
    """What was measured."""
    value: float
    """The figure, in the unit."""
    unit: str
    """Unit of the value."""
    direction: Direction
    """Which values are better."""
    tolerance: float = 0.0
    """Relative change for the worse that is still no change."""


@dataclass(frozen=True)
class MetricsFile:
    """What a benchmark wrote."""

    benchmark: str
    """Name of the benchmark."""
    version: str
    """Version of this package that measured."""
    machine: str
    """Processor."""
    cores: int
    """Number of cores of the machine."""
    metrics: tuple[Metric, ...]
    """The figures."""

    def value(self, name: str) -> float:
        """Give the value of a metric.

        Raises:
            DvrError: There is no metric of this name.
        """
        for metric in self.metrics:
            if metric.metric == name:
                return metric.value
        raise DvrError(
            f"the results of the benchmark {self.benchmark} have no metric '{name}'; run it again."
        )


def save_metrics(path: Path, benchmark: str, metrics: Sequence[Metric]) -> None:
    """Write the metrics of a benchmark with the version and the machine of this process.

    Args:
        path: JSON file; its folder is made if it is missing.
        benchmark: name of the benchmark.
        metrics: its figures.
    """
    described = describe_machine()
    content = {
        "benchmark": benchmark,
        "version": described["versions"]["dvr_jax"],
        "machine": described["machine"],
        "cores": described["cores"],
        "metrics": [{**asdict(metric), "direction": metric.direction.value} for metric in metrics],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, (json.dumps(content, indent=1) + "\n").encode())


def load_metrics(path: Path) -> MetricsFile:
    """Read what `save_metrics` wrote.

    Raises:
        DvrError: The file holds no metrics.
        OSError: The file cannot be read.
    """
    try:
        content = parse_json(read_whole(path), constants=True)
        metrics = tuple(
            Metric(
                metric=str(row["metric"]),
                value=float(row["value"]),
                unit=str(row["unit"]),
                direction=Direction(row["direction"]),
                tolerance=float(row["tolerance"]),
            )
            for row in content["metrics"]
        )
        return MetricsFile(
            benchmark=str(content["benchmark"]),
            version=str(content["version"]),
            machine=str(content["machine"]),
            cores=int(content["cores"]),
            metrics=metrics,
        )
    except (ValueError, LookupError, TypeError) as error:
        raise DvrError(
            f"{path} holds no metrics of a benchmark ({error}); valid is what --out writes."
        ) from None
