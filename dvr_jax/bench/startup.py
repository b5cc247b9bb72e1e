"""What a machine's first plan compiles, program by program, and how long the same plan takes from process start.

The first plan runs in this process with an empty cache, the others in processes of their own that load the programs.
Elapsed times depend on what else the machine does, so the time of the processor is given beside them.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.planning.planner import plan
from dvr_jax.runtime.compile_times import CompileTimes, compile_times
from dvr_jax.runtime.program_files import SWITCH
from dvr_jax.scene.files import load_scene


@dataclass(frozen=True)
class StartupOptions:
    """Plan a scene with an empty cache of programs, and once more with the programs that the first plan has kept."""

    scene: Path = Path("data/scenes/figure1.json")
    """Scene file."""
    out: Path | None = None
    """JSON file to write the times to."""


@dataclass(frozen=True, slots=True)
class Duration:
    """How long something took."""

    elapsed: float
    """Elapsed time [s]."""

    processor: float
    """Time of the processor, of all threads together [s]."""

    def __str__(self) -> str:
        """Return both times."""
        return f"{self.elapsed:.1f} s ({self.processor:.1f} s of the processor)"


def run(arguments: list[str]) -> int:
    """Print the programs of the first plan, and the times of both plans."""
    options = tyro.cli(StartupOptions, prog="python -m dvr_jax.bench startup", args=arguments)
    scene = load_scene(options.scene)
    with tempfile.TemporaryDirectory() as cache:
        os.environ[SWITCH] = cache
        begin = time.monotonic()
        first = _duration_of(lambda: plan(scene), resource.RUSAGE_SELF)
        print(*table(compile_times(), begin), sep="\n")

        def plan_by_command() -> None:
            command = [sys.executable, "-m", "dvr_jax.plan", str(options.scene)]
            subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        # The command loads ahead what its last run needed, and so far it has not run.
        plan_by_command()
        again = _duration_of(plan_by_command, resource.RUSAGE_CHILDREN)
    print(f"first plan: {first}")
    print(f"again, from process start: {again}")
    if options.out is not None:
        metrics = [
            Metric("first plan", first.processor, "s", Direction.LOWER),
            Metric("again, from process start", again.processor, "s", Direction.LOWER),
        ]
        save_metrics(options.out, "startup", metrics)
    return 0


def _duration_of(work: Callable[[], object], who: int) -> Duration:
    """Return how long some work takes, of this process or of its children."""
    usage = resource.getrusage(who)
    begin = time.monotonic()
    work()
    elapsed = time.monotonic() - begin
    after = resource.getrusage(who)
    processor = after.ru_utime + after.ru_stime - usage.ru_utime - usage.ru_stime
    return Duration(elapsed, processor)


def table(programs: list[CompileTimes], begin: float) -> list[str]:
    """Return the lines of a table of programs in the order in which their compilation began, and one with the sums.

    Args:
        programs: The programs.
        begin: When the plan began, by `time.monotonic` [s].
    """
    lines = ["    at  tracing  lowering  compiling [s]  program, shape of its last argument"]
    for each in sorted(programs, key=lambda each: each.begin):
        shape = " x ".join(map(str, each.shapes[-1])) if each.shapes else ""
        lines.append(
            f"{each.begin - begin:6.1f} {each.tracing:8.2f} {each.lowering:9.2f} "
            f"{each.compiling:10.2f}      {each.name}, {shape}"
        )
    sums = [
        sum(values)
        for values in zip(
            *((each.tracing, each.lowering, each.compiling) for each in programs), strict=True
        )
    ] or [0.0, 0.0, 0.0]
    lines.append(
        f"   all {sums[0]:8.2f} {sums[1]:9.2f} {sums[2]:10.2f}      {len(programs)} programs"
    )
    return lines
