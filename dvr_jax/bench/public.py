"""Plan the scenes of public benchmarks, execute the plans in physics, and say how many succeed and how long it takes.

Every scene is planned twice with the same result. The first call compiles what the scene needs, and gets more time for
it; the time is that of the second one.
"""

from __future__ import annotations

import hashlib
import statistics
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from dvr_jax.bench.public_problems import FAMILIES, PUBLIC_SCENES, draw_all, read_public_scenes
from dvr_jax.bench.results_file import ResultsFile, Row
from dvr_jax.errors import DvrError
from dvr_jax.execution import execute
from dvr_jax.planning.planner import plan
from dvr_jax.runtime.files import write_whole
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.types import Scene
from dvr_jax.search.searches import SEARCHES

ALL_FAMILIES = tuple(family.name for family in FAMILIES)
"""Names of all families."""


COMPILING_FACTOR = 5
"""The time limit of the first call, as a multiple of that of the second one."""


@dataclass(frozen=True)
class PublicOptions:
    """Plan the scenes of public benchmarks by several searches, and execute the plans in physics."""

    families: tuple[str, ...] = ALL_FAMILIES
    """Families of scenes."""
    searches: tuple[str, ...] = ("dvr", "mbts")
    """dvr, classifier, mbts or bfs."""
    time_limit: float = 60.0
    """For each call [s]."""
    workers: int = 1
    """Processes, one scene each at a time. More than one makes the times longer."""
    out: Path | None = None
    """JSON Lines file of results; problems that it already has are not planned again."""
    draw: Path | None = None
    """Draw the scenes anew and write them to this file; nothing is planned."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option is out of its range, or there is no search or family of a name.
        """
        if self.workers < 1:
            raise DvrError(f"--workers is {self.workers}; valid is 1 or more.")
        if not self.time_limit > 0:
            raise DvrError(f"--time-limit is {self.time_limit}; valid is a positive number.")
        for name in self.searches:
            if name not in SEARCHES:
                raise DvrError(f"there is no search {name!r}; valid: {', '.join(SEARCHES)}.")
        if not self.searches:
            raise DvrError("--searches is empty; valid is one search or more.")


@dataclass(frozen=True)
class _Problem:
    """One scene and the search that plans it."""

    number: int
    """Number of the problem among all, which is that of its row."""

    family: str
    """Name of the family."""

    search: str
    """Name of the search."""

    scene: Scene = field(repr=False)
    """The scene."""


def run(arguments: list[str]) -> int:
    """Plan and execute the scenes, and print the tables."""
    options = tyro.cli(PublicOptions, prog="python -m dvr_jax.bench public", args=arguments)
    if options.draw is not None:
        write_whole(options.draw, draw_all().encode())
        print(f"wrote {options.draw}")
        return 0

    rows = list(solve_problems(options))
    for line in describe(rows):
        print(line)
    return 0


def problems_of(options: PublicOptions) -> list[_Problem]:
    """Return the problems in a fixed order: all scenes for the first search, then for the next one."""
    scenes = list(read_public_scenes(options.families))
    return [
        _Problem(place * len(scenes) + number, family, search, scene)
        for place, search in enumerate(options.searches)
        for number, (family, scene) in enumerate(scenes)
    ]


def solve_problems(options: PublicOptions) -> Iterator[Row]:
    """Give the rows of all problems, first those that the file has.

    Raises:
        DvrError: An option makes no sense, or the file holds results of other options.
    """
    options.check()
    problems = problems_of(options)
    header = {
        "families": list(options.families),
        "searches": list(options.searches),
        "time_limit": options.time_limit,
        "scenes": hashlib.sha256(PUBLIC_SCENES.read_bytes()).hexdigest()[:16],
    }
    results_file = ResultsFile(options.out, header, of="problem")
    todo = results_file.missing(len(problems))
    yield from results_file.rows.values()
    if not todo:
        return

    with worker_processes(options.workers) as pool:
        tasks = [pool.submit(_solve_one, options, problems[number]) for number in todo]
        for task in as_completed(tasks):
            row = task.result()
            results_file.add(row)
            print(
                f"  {row['family']} {row['problem']}, {row['search']}: {_outcome(row)}",
                file=sys.stderr,
                flush=True,
            )
            yield row


def _solve_one(options: PublicOptions, problem: _Problem) -> Row:
    """Plan a scene twice and execute the plan; the row of the results file."""
    for factor in (COMPILING_FACTOR, 1):
        found = plan(problem.scene, problem.search, time_limit=factor * options.time_limit)
    row: Row = {
        "problem": problem.number,
        "family": problem.family,
        "search": problem.search,
        "status": str(found.status),
        "length": len(found.actions),
        "seconds": round(found.seconds["total"], 3),
        "passed": found.report is not None and found.report.passed,
    }
    if found.motion is None:
        return row

    report = execute(found.scene, found.actions, found.motion).report
    row["succeeded"] = report.succeeded
    if not report.succeeded:
        row["cause"] = report.failure
    return row


def describe(rows: Sequence[Row]) -> list[str]:
    """Return a table of the results by family and search, and the causes of failures in physics.

    Args:
        rows: Rows of the results file.
    """
    lines = []
    for family in FAMILIES:
        of_family = [row for row in rows if row["family"] == family.name]
        if of_family:
            lines.append(f"{family.name}: {family.title} ({family.source})")
        for search in dict.fromkeys(row["search"] for row in of_family):
            lines.append(
                f"  {search:<10} {_figures([row for row in of_family if row['search'] == search])}"
            )

    failed = [row for row in rows if not row.get("succeeded", True)]
    executed = sum("succeeded" in row for row in rows)
    if executed:
        lines.append(
            f"physics: {executed - len(failed)} of {executed} plans succeed ({1 - len(failed) / executed:.0%})"
        )
    for cause, count in Counter(row["cause"] for row in failed).most_common():
        lines.append(f"  {count} failed: {cause}")
    return lines


def _figures(rows: Sequence[Row]) -> str:
    """Return the figures of one family and search in words."""
    solved = [row for row in rows if row["passed"]]
    seconds = [row["seconds"] for row in rows]
    succeeded = sum(row.get("succeeded", False) for row in solved)
    lengths = Counter(row["length"] for row in solved)
    actions = ", ".join(f"{count} x {length}" for length, count in sorted(lengths.items()))
    return (
        f"solved {len(solved)} of {len(rows)}, physics {succeeded} of {len(solved)}, "
        f"median {statistics.median(seconds):.2f} s, at most {max(seconds):.2f} s, actions: {actions or 'none'}"
    )


def _outcome(row: Row) -> str:
    """Return in words what became of a problem."""
    if "succeeded" not in row:
        return f"{row['status']}, {row['seconds']} s"
    physics = "succeeds in physics" if row["succeeded"] else f"fails in physics: {row['cause']}"
    return f"{row['length']} actions, {row['seconds']} s, {physics}"
