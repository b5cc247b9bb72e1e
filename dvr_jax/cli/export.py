"""Command line `python -m dvr_jax.export PLAN_FOLDER`: write a plan's motion for robot controllers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dvr_jax.cli.options import parse_options
from dvr_jax.errors import DataError, run_command

CSV = "trajectory.csv"
ROS = "trajectory.ros.json"


@dataclass(frozen=True)
class ExportOptions:
    """Write the motion of a plan as set points at a fixed rate (CSV) and as ROS 2 trajectories (JSON)."""

    plan: Annotated[Path, tyro.conf.Positional]
    """Folder that a plan was saved to."""
    out: Path | None = None
    """Folder for `trajectory.csv` and `trajectory.ros.json`; by default that of the plan."""
    rate: float = 1000.0
    """Number of lines of the CSV file for each second."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Read a plan and write both files.

    Args:
        arguments: Options as text; None for those of the process.

    Returns:
        The exit code.
    """
    options = parse_options(ExportOptions, "export", arguments)

    from dvr_jax.planning.export import export_csv, export_ros
    from dvr_jax.planning.result import Plan
    from dvr_jax.runtime.files import require_folder
    from dvr_jax.runtime.progress import Progress

    plan = Plan.load(options.plan)
    if plan.motion is None:
        raise DataError(f"the plan in {options.plan} is not solved, so that it has no motion.")

    folder = options.out or options.plan
    require_folder(folder)
    with Progress("writing the motion"):
        export_csv(folder / CSV, plan.scene, plan.motion, options.rate)
        export_ros(folder / ROS, plan.scene, plan.motion)
    print(f"written: {folder / CSV} and {folder / ROS}")
    return 0


if __name__ == "__main__":
    run_command(main)
