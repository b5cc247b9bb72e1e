"""Times of this checkout and of another one, measured in turn: A B A B A B.

Both run `bench speed` in processes of their own. The times are read from the lines that it prints, since version 0.8.1
writes no file. These lines have few digits, so the clock of the processes runs a thousand times as fast: a median of
13.4 ms is printed as 13412 ms.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dvr_jax.errors import DvrError

CLOCK_RATE = 1000.0
"""Seconds of the processes' clock in a second."""

PROGRAM = f"""
import time
clock = time.perf_counter
time.perf_counter = lambda: {CLOCK_RATE} * clock()
from dvr_jax.bench.speed import run
run([])
"""
"""What each process runs."""

LINE = re.compile(
    r"(?P<metric>Gauss-Newton system, \d+ objects|keyframes of length \d+|path NLPs of length \d+)"
    r"(?: \(\d+ rows\):|,|: median) (?P<value>[\d.]+) (?P<unit>us|ms)"
)
"""A line of `bench speed`, in version 0.8.1 and since."""


@dataclass(frozen=True)
class CompareOptions:
    """Run `bench speed` of this checkout and of another one in turn, and print the ratio of each time."""

    baseline: Annotated[Path, tyro.conf.Positional]
    """Folder of the other checkout."""
    python: Path | None = None
    """Interpreter of the other checkout; by default its .venv/bin/python, or else this interpreter."""
    rounds: int = 5
    """Runs of each."""
    cache: Path | None = None
    """Folder that keeps the compiled programs of both, so that a later comparison need not compile; by default a
    temporary one."""


@dataclass(frozen=True)
class Checkout:
    """A copy of the repository with an interpreter that has what it needs."""

    folder: Path
    """Folder that holds the package."""
    python: Path
    """Interpreter."""


def run(arguments: list[str]) -> int:
    """Print the least times of both checkouts and their ratio."""
    options = tyro.cli(CompareOptions, prog="python -m dvr_jax.bench compare", args=arguments)
    if options.rounds < 1:
        raise DvrError(f"--rounds is {options.rounds}; valid is 1 or more.")

    this = Checkout(Path(__file__).parents[2], Path(sys.executable))
    baseline = find_checkout(options.baseline, options.python)

    # In turn, so that a machine that slows down does so for both.
    before: list[Mapping[str, float]] = []
    after: list[Mapping[str, float]] = []
    with tempfile.TemporaryDirectory() as temporary:
        caches = (options.cache or Path(temporary)).resolve()
        for number in range(1, options.rounds + 1):
            before.append(measure(baseline, caches / "baseline"))
            after.append(measure(this, caches / "this"))
            print(
                f"  round {number} of {options.rounds} is done",
                file=sys.stderr,
                flush=True,
            )

    title = f"least of {options.rounds} runs [us/slice or ms]"
    print(f"{title:<40} {'baseline':>10} {'this':>10} {'ratio':>7}")
    for metric, old, new in compare_least(before, after):
        print(f"{metric:<40} {old:>10.3f} {new:>10.3f} {new / old:>7.3f}")
    return 0


def find_checkout(folder: Path, python: Path | None) -> Checkout:
    """Find the package and the interpreter of another checkout.

    Args:
        folder: the checkout.
        python: its interpreter; by default that of its virtual environment, or else the one of this process.

    Returns:
        The checkout.

    Raises:
        DvrError: The folder holds no package with this benchmark.
    """
    if not (folder / "dvr_jax/bench/speed.py").is_file():
        raise DvrError(
            f"{folder} has no dvr_jax/bench/speed.py; valid is a checkout of this repository."
        )
    own = folder / ".venv/bin/python"
    if python is None:
        python = own if own.exists() else Path(sys.executable)
    return Checkout(folder.resolve(), python.absolute())


def measure(checkout: Checkout, cache: Path) -> dict[str, float]:
    """Run `bench speed` of a checkout in a process of its own.

    Args:
        checkout: what is measured.
        cache: folder of compiled programs; each checkout needs its own.

    Returns:
        Times by metric, in the unit that is printed (us/slice or ms).

    Raises:
        DvrError: The process failed, or printed no times.
    """
    environment = {
        **os.environ,
        "PYTHONPATH": str(checkout.folder),
        "DVR_JAX_CACHE": str(cache),
    }
    process = subprocess.run(
        [str(checkout.python), "-c", PROGRAM],
        cwd=checkout.folder,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    times = parse_times(process.stdout)
    if process.returncode != 0 or not times:
        raise DvrError(
            f"bench speed in {checkout.folder} ended with exit code {process.returncode}."
        )
    return times


def parse_times(printed: str) -> dict[str, float]:
    """Read the times from what `bench speed` printed under the fast clock, by metric."""
    return {match["metric"]: float(match["value"]) / CLOCK_RATE for match in LINE.finditer(printed)}


def compare_least(
    before: Sequence[Mapping[str, float]],
    after: Sequence[Mapping[str, float]],
) -> list[tuple[str, float, float]]:
    """Take the least times over the runs of both checkouts.

    Other work on the machine makes a run slower and never faster, so that the least time is the most repeatable one.

    Args:
        before: times of each run of the baseline, by metric.
        after: times of each run of this checkout.

    Returns:
        Metric, least time before and least time after, for each metric that all runs have.
    """
    runs = [*before, *after]
    common = [metric for metric in before[0] if all(metric in times for times in runs)]
    return [
        (
            metric,
            min(times[metric] for times in before),
            min(times[metric] for times in after),
        )
        for metric in common
    ]
