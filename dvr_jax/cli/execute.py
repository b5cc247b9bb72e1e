"""Command line `python -m dvr_jax.execute PLAN_FOLDER`: execute a plan in physics, open loop."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from dvr_jax.cli.options import LARGEST, LARGEST_NUMBER, parse_options, require_range
from dvr_jax.errors import DataError, OptionError, run_command

if TYPE_CHECKING:
    from dvr_jax.execution import Execution, ExecutionConditions, ExecutionReport
    from dvr_jax.execution.repetition import ConditionRange
    from dvr_jax.planning.result import Plan

EXIT_SUCCEEDED = 0
"""Exit code for an execution at whose end the goal holds."""

EXIT_FAILED = 1
"""Exit code for an execution at whose end the goal does not hold."""

MILLIMETERS = 1e3
"""Millimeters in a meter."""


@dataclass(frozen=True)
class ExecuteOptions:
    """Execute a plan in a physics simulation (MuJoCo), open loop, and say what became of it.

    Exit code 0: the goal holds at the end; 1: it does not, or not in every repetition; 2: bad input.
    """

    plan: Annotated[Path, tyro.conf.Positional]
    """Folder that a plan was saved to."""
    out: Path | None = None
    """GIF file to write the animation of the execution to; by default PLAN/execution.gif."""
    animation: bool = True
    """Whether to write the animation."""
    repeat: int = 1
    """Number of executions. With more than one, there is no animation."""
    object_noise: float = 0.0
    """Standard deviation of the initial displacement of each object along x and along y [mm]."""
    friction: tuple[float, float] = (1.0, 1.0)
    """Least and largest factor of the objects' friction, from which each execution draws its own. Objects whose scene
    states no friction have the coefficient 1."""
    seed: int = 0
    """Seed of displacements and friction."""
    workers: int = os.cpu_count() or 1
    """Number of processes for repeated executions in MuJoCo C."""
    backend: Literal["mujoco", "mjx"] = "mujoco"
    """What simulates: MuJoCo C on the CPU, or MuJoCo MJX on the device of JAX, which runs all executions as one batch.
    MJX needs a minute to compile and is much slower on a CPU; its scenes may have no cylinders."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Execute a plan and report.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    options = parse_options(ExecuteOptions, "execute", arguments)

    from dvr_jax.execution.repetition import ConditionRange
    from dvr_jax.planning.result import Plan

    require_range("repeat", options.repeat, 1, LARGEST_NUMBER)
    require_range("workers", options.workers, 1, LARGEST["workers"])
    variation = ConditionRange(options.object_noise / MILLIMETERS, options.friction, options.seed)
    if options.repeat > 1 and options.out is not None:
        raise OptionError(
            "--out names an animation, and repeated executions have none; leave it out."
        )
    plan = Plan.load(options.plan)
    if plan.motion is None:
        raise DataError(f"the plan in {options.plan} is not solved, so that it has no motion.")

    if options.repeat > 1:
        return _repeat(plan, variation, options)
    return _execute_once(plan, variation, options)


def _execute_once(plan: Plan, variation: ConditionRange, options: ExecuteOptions) -> int:
    """Execute a plan once, write the animation, and report on every object."""
    from dvr_jax.runtime.files import require_writable
    from dvr_jax.runtime.progress import Progress

    path = options.out or options.plan / "execution.gif"
    if options.animation:
        # A place that cannot be written to is refused now, and not after the simulation.
        require_writable(path)
    with Progress("simulating"):
        execution = _execution_under(plan, variation.conditions(0), options)
    report = execution.report
    if options.animation:
        with Progress("drawing the animation"):
            _animate(path, plan, execution)

    print(f"{_verdict(report)} after {report.duration:.1f} s of simulated time")
    for item in report.objects:
        print(
            f"  {item.name}: {MILLIMETERS * item.displacement:.1f} mm and {item.turn:.3f} rad "
            "from its planned pose"
        )
    if report.deviation is not None:
        print(f"first deviation: {report.deviation.sentence()}")

    if options.animation:
        print(f"animation: {path}")
    return EXIT_SUCCEEDED if report.succeeded else EXIT_FAILED


def _execution_under(
    plan: Plan, conditions: ExecutionConditions, options: ExecuteOptions
) -> Execution:
    """Execute a plan under given conditions in the backend that the options name."""
    from dvr_jax.execution import PhysicsBackend, execute

    assert plan.motion is not None
    if PhysicsBackend(options.backend) is PhysicsBackend.MUJOCO:
        return execute(plan.scene, plan.actions, plan.motion, conditions)

    from dvr_jax.execution.mjx_batch import execute_batch

    [execution] = execute_batch(
        plan.scene, plan.actions, plan.motion, [conditions], report_progress=_show_progress
    )
    return execution


def _repeat(plan: Plan, variation: ConditionRange, options: ExecuteOptions) -> int:
    """Execute a plan several times, and count the successes and the causes of failures."""
    from dvr_jax.execution import PhysicsBackend
    from dvr_jax.execution.repetition import execute_repeatedly
    from dvr_jax.runtime.progress import Progress

    assert plan.motion is not None
    succeeded = 0
    causes: Counter[str] = Counter()
    reports = execute_repeatedly(
        plan.scene,
        plan.actions,
        plan.motion,
        variation,
        options.repeat,
        options.workers,
        PhysicsBackend(options.backend),
        _show_progress,
    )
    with Progress("simulating", options.repeat, "executions") as progress:
        for index, report in enumerate(reports):
            progress.advance()
            succeeded += report.succeeded
            if not report.succeeded:
                causes[report.failure] += 1
            print(f"  execution {index}: {_verdict(report)}", file=sys.stderr, flush=True)

    print(f"the goal holds after {succeeded} of {options.repeat} executions")
    for cause, count in causes.most_common():
        print(f"  {count} failed: {cause}")
    return EXIT_SUCCEEDED if succeeded == options.repeat else EXIT_FAILED


def _show_progress(line: str) -> None:
    """Show the progress of MJX where it does not mix with the results."""
    print(f"  {line}", file=sys.stderr, flush=True)


def _verdict(report: ExecutionReport) -> str:
    """Return whether the goal holds, in words."""
    if not report.is_stable:
        return report.failure
    return "the goal holds" if report.succeeded else "the goal does not hold"


def _animate(path: Path, plan: Plan, execution: Execution) -> None:
    """Write the executed motion as a GIF."""
    from dvr_jax.drawing.animation import save_animation
    from dvr_jax.motion.motion import make_motion

    assert plan.motion is not None
    save_animation(
        path, plan.scene, make_motion(execution.time, execution.qpos, plan.motion.switch)
    )


if __name__ == "__main__":
    run_command(main)
