"""Plan sampled scenes, execute the plans in physics, and count successes by length and failures by cause."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from typing import Literal

import tyro

from dvr_jax.bench.results_file import ResultsFile, Row
from dvr_jax.bench.scenes import (
    ScenesOptions,
    header_options,
    load_search_network,
    plan_scene,
    prepare_worker,
)
from dvr_jax.execution import execute
from dvr_jax.execution.repetition import ConditionRange
from dvr_jax.execution.report import NO_DEVIATION
from dvr_jax.runtime.processes import worker_processes

MILLIMETERS = 1e3
"""Millimeters in a meter."""


@dataclass(frozen=True)
class ExecuteOptions(ScenesOptions):
    """Plan sampled scenes and execute the plans in physics, open loop."""

    search: str = "dvr"
    """dvr, classifier, mbts or bfs."""
    termination: Literal["feasible", "optimal"] = "optimal"
    """Whether plans take the first feasible path or an optimal one."""
    object_noise: float = 0.0
    """Standard deviation of the initial displacement of each object along x and along y [mm]."""
    friction: tuple[float, float] = (1.0, 1.0)
    """Least and largest factor of the objects' friction, from which each execution draws its own."""

    def variation(self) -> ConditionRange:
        """The conditions of the executions."""
        return ConditionRange(self.object_noise / MILLIMETERS, self.friction, self.seed)


def _execute_one(options: ExecuteOptions, index: int) -> Row:
    """Plan a scene and execute the plan; the row of the results file."""
    plan = plan_scene(options, index, options.termination)
    row: Row = {"scene": index, "status": str(plan.status), "length": len(plan.actions)}
    if plan.motion is None:
        return row

    conditions = options.variation().conditions(index)
    report = execute(plan.scene, plan.actions, plan.motion, conditions).report
    row["succeeded"] = report.succeeded
    row["duration"] = round(float(plan.motion.time[-1]), 3)
    if not report.succeeded:
        row["cause"] = report.failure
    if report.deviation is not None:
        row["deviation"] = report.deviation.sentence()
    return row


def execute_scenes(options: ExecuteOptions) -> Iterator[Row]:
    """Give the rows of all scenes, first those that the file has.

    Raises:
        DvrError: An option makes no sense, or the file holds results of other options or of another version.
    """
    options.check()
    options.variation()

    # The network is loaded here once, so that a bad file is refused before any worker starts.
    load_search_network(options.search, options.network)

    results_file = ResultsFile(options.out, header_options(options))
    todo = results_file.missing(options.number)
    yield from (row for index, row in results_file.rows.items() if index < options.number)
    if not todo:
        return

    with worker_processes(options.workers, prepare_worker, options) as pool:
        tasks = [pool.submit(_execute_one, options, index) for index in todo]
        for task in as_completed(tasks):
            row = task.result()
            results_file.add(row)
            print(f"  scene {row['scene']}: {_outcome(row)}", file=sys.stderr, flush=True)
            yield row


def run(arguments: list[str]) -> int:
    """Plan and execute the scenes, and print the tables."""
    options = tyro.cli(ExecuteOptions, prog="python -m dvr_jax.bench execute", args=arguments)
    rows = list(execute_scenes(options))
    executed = [row for row in rows if "succeeded" in row]
    print(
        f"{len(rows)} scenes of {options.objects} objects ({options.shape}, seed {options.seed}), {options.search}: "
        f"{len(executed)} solved and executed"
    )
    _print_share("all lengths", executed)
    for length in sorted({row["length"] for row in executed}):
        _print_share(f"length {length}", [row for row in executed if row["length"] == length])

    failed = [row for row in executed if not row["succeeded"]]
    causes = Counter(row.get("cause", NO_DEVIATION) for row in failed)
    for cause, count in causes.most_common():
        print(f"  {count} failed: {cause}")
    return 0


def _print_share(name: str, rows: Sequence[Row]) -> None:
    """Print how many of some executions succeeded."""
    succeeded = sum(row["succeeded"] for row in rows)
    share = succeeded / len(rows) if rows else 0.0
    print(f"  {name:<12} {succeeded:>4} of {len(rows):>4} succeed ({share:.0%})")


def _outcome(row: Row) -> str:
    """Return in words what became of a scene."""
    if "succeeded" not in row:
        return str(row["status"])
    if row["succeeded"]:
        return "succeeds"
    return f"fails: {row.get('deviation', row['cause'])}"
