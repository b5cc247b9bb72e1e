"""Random command lines: each ends by itself with an exit code that the help explains, and without a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import dvr_jax
from dvr_jax.bench.fuzz_judge import Problem, Tally

LONGEST_COMMAND = 120.0
"""Longest time that a command may take [s]; none of them has work to do."""

COMMANDS: dict[str, tuple[str, ...]] = {
    "plan": ("--search", "--network", "--k-max", "--seed", "--time-limit", "--clearance", "--out"),
    "check": ("--dynamics",),
    "execute": ("--out", "--repeat", "--object-noise", "--friction", "--workers", "--seed"),
    "export": ("--out", "--rate"),
    "sample": ("--number", "--objects", "--cubes", "--shape", "--workcell", "--out", "--seed"),
    "sweep": ("--scenes", "--out", "--shard", "--workers", "--k-max", "--width"),
    "dataset": ("--k-max", "--completions", "--seed"),
    "train": ("--data", "--out", "--steps", "--batch", "--kind", "--seed"),
    "bench": ("table1", "nix", "--help"),
    "nix": (),
}
"""Commands with some of their options."""

VALUES = (
    "",
    "-1",
    "0",
    "nan",
    "inf",
    "1e999",
    "1000000000000",
    "x",
    "\x1b[31m",
    "\u202e\u0645",
    "'; rm -rf /",
    "x" * 2000,
    "/dev/zero",
    "/dev/null",
    "/nowhere/at/all",
    ".",
    "--",
)
"""Values of options, none of which gives a command work to do."""


def fuzz_commands(number: int, seed: int, folder: Path, tally: Tally) -> list[Problem]:
    """Run random command lines.

    Args:
        number: Number of command lines.
        seed: Seed of the draw.
        folder: Folder that the commands run in.
        tally: Takes the cases.

    Returns:
        The cases that ended as none may.
    """
    problems = []
    for index in range(number):
        arguments = _draw(np.random.default_rng([seed, 3, index]))
        wrong = _run(arguments, folder, tally)
        if wrong is not None:
            problems.append(Problem("command line", index, f"{arguments}: {wrong}"))

    return problems


def _draw(generator: np.random.Generator) -> list[str]:
    """Return a command with some options and values."""
    command = str(generator.choice(list(COMMANDS)))
    arguments = [command]
    for _ in range(int(generator.integers(0, 5))):
        options = (*COMMANDS[command], "--nix")
        arguments.append(options[generator.integers(len(options))])
        arguments.append(VALUES[generator.integers(len(VALUES))])
    return arguments


def _run(arguments: list[str], folder: Path, tally: Tally) -> str | None:
    """Run a command line and say what is wrong with how it ended."""
    command = [sys.executable, "-m", "dvr_jax.cli.console", *arguments]
    # The commands of this package, also where another one is installed.
    package = Path(dvr_jax.__file__).parents[1]
    try:
        ended = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(package)},
            capture_output=True,
            timeout=LONGEST_COMMAND,
        )
    except subprocess.TimeoutExpired:
        return f"it takes more than {LONGEST_COMMAND:g} s"

    output = (ended.stdout + ended.stderr).decode("utf-8", errors="replace")
    if ended.returncode not in (0, 1, 2) or "Traceback" in output:
        return f"exit code {ended.returncode}: {output[-500:]!r}"
    if not output.replace("\n", "").replace("\t", "").isprintable():
        return f"the output commands the terminal: {output!r}"

    if ended.returncode == 2:
        tally.refused += 1
    else:
        tally.accepted += 1
    return None
