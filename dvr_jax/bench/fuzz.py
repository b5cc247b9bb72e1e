"""Damaged input of every kind: nothing may end in a traceback, hang, or be accepted although it differs."""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.bench.fuzz_commands import fuzz_commands
from dvr_jax.bench.fuzz_files import fuzz_files
from dvr_jax.bench.fuzz_judge import Problem, Tally
from dvr_jax.bench.fuzz_scenes import fuzz_scenes
from dvr_jax.errors import OptionError

BLOCK = 1_000
"""Cases between two lines about the progress."""


@dataclass(frozen=True)
class FuzzOptions:
    """Read damaged scenes and files, and run random command lines. Exit code 1 if one ends as none may."""

    number: int = 20_000
    """Number of damaged scenes."""
    files: int = 2_000
    """Number of damaged files: scenes, trajectories, plans, networks, checkpoints, histories, shards, programs."""
    commands: int = 50
    """Number of random command lines, about a second each."""
    seed: int = 0
    """Seed of the damage; another one damages otherwise."""


def run(arguments: list[str]) -> int:
    """Fuzz, print how the cases ended, and return 0 if all ended as they may."""
    options = tyro.cli(FuzzOptions, prog="python -m dvr_jax.bench fuzz", args=arguments)
    for name in ("number", "files", "commands", "seed"):
        value = getattr(options, name)
        if value < 0:
            raise OptionError(f"--{name} is {value}; valid is 0 or more.")

    begin = time.monotonic()
    tallies: dict[str, Tally] = {}
    with tempfile.TemporaryDirectory() as folder:
        problems = _fuzz(options, Path(folder), tallies)

    for problem in problems:
        print(problem)
    for kind, tally in tallies.items():
        print(f"{kind}: {tally.refused} refused in one sentence, {tally.accepted} accepted")
    total = options.number + options.files + options.commands
    print(f"{len(problems)} of {total} cases ended as none may, {time.monotonic() - begin:.0f} s")
    return 1 if problems else 0


def _fuzz(options: FuzzOptions, folder: Path, tallies: dict[str, Tally]) -> list[Problem]:
    """Fuzz scenes, files and command lines, and report the progress."""
    scenes = tallies["scene"] = Tally()
    problems = []
    for first in range(0, options.number, BLOCK):
        number = min(BLOCK, options.number - first)
        problems += fuzz_scenes(range(first, first + number), options.seed, scenes)
        _say(f"{first + number} of {options.number} scenes, {len(problems)} problems")

    (folder / "files").mkdir()
    problems += fuzz_files(options.files, options.seed, folder / "files", tallies)
    _say(f"{options.files} files, {len(problems)} problems")

    (folder / "commands").mkdir()
    commands = tallies["command line"] = Tally()
    return problems + fuzz_commands(options.commands, options.seed, folder / "commands", commands)


def _say(line: str) -> None:
    """Print a line about the progress."""
    print(f"  {line}", file=sys.stderr, flush=True)
