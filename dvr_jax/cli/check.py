"""Console command `dvr-jax check PLAN_FOLDER`: check the motion of a saved plan anew.

The command has no `python -m dvr_jax.check`, because `dvr_jax.check` is the function that it calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dvr_jax.cli.options import parse_options
from dvr_jax.errors import DataError

EXIT_PASSED = 0
"""Exit code for a motion that passed the check."""

EXIT_FAILED = 1
"""Exit code for a motion with findings."""


@dataclass(frozen=True)
class CheckOptions:
    """Replay the motion of a plan in MuJoCo, and say everything that is wrong with it.

    Exit code 0: the motion passed; 1: it did not; 2: bad input.
    """

    plan: Annotated[Path, tyro.conf.Positional]
    """Folder that a plan was saved to."""
    dynamics: bool = False
    """Whether jerks and torques of the joints are checked as well."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the motion of a plan and print the report.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.

    Raises:
        DataError: The plan is not solved.
    """
    options = parse_options(CheckOptions, "check", arguments)

    from dvr_jax.checker import describe
    from dvr_jax.planning.check import check
    from dvr_jax.planning.result import Plan
    from dvr_jax.runtime.progress import Progress

    plan = Plan.load(options.plan)
    if plan.motion is None:
        raise DataError(f"the plan in {options.plan} is not solved, so that it has no motion.")

    with Progress("checking the motion"):
        report = check(plan.scene, plan.actions, plan.motion, dynamics=options.dynamics)
    print(describe(report))
    return EXIT_PASSED if report.passed else EXIT_FAILED
