"""The command `plan` for a file of many scenes: folders of plans, a table of results, and a summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from dvr_jax.errors import DvrError, OptionError, SceneError

if TYPE_CHECKING:
    from dvr_jax.cli.plan import PlanOptions
    from dvr_jax.planning.plan_table import PlanTable, Row
    from dvr_jax.planning.scene_tasks import PlanSettings, SceneTask

SUFFIX = ".jsonl"
"""End of the name of a file of many scenes."""

SHOWN_REASONS = 5
"""Largest number of failures whose reasons are printed."""


def plan_many(options: PlanOptions) -> int:
    """Plan all scenes of a file that have no row in the table yet, and print a summary of all of them.

    Args:
        options: Options of the command.

    Returns:
        0 if all scenes are solved, else 1.

    Raises:
        OptionError: An option is missing or has a wrong value.
        DvrError: The file has no scene, or the folder holds other plans.
        OSError: A file cannot be read or written.
    """
    from dvr_jax.planning.many_scenes import run_scene_tasks
    from dvr_jax.planning.plan_table import PlanTable, checksum_of
    from dvr_jax.runtime.progress import Progress

    if options.out is None:
        raise OptionError("--out is missing; a file of many scenes needs a folder for the plans.")
    if options.workers is not None and options.workers < 1:
        raise OptionError(f"--workers is {options.workers}; valid is 1 or more.")

    lines = _read_lines(options.scene)
    table = PlanTable(options.out, _settings(options), [checksum_of(text) for text in lines])
    tasks = _tasks(options, lines, table)

    with Progress("planning", len(lines), "scenes", len(table.rows)) as progress:
        for result in run_scene_tasks(tasks, options.workers, options.ray):
            table.add(result)
            progress.advance()

    table.sort()
    print(_summarize(table.rows))
    print(f"written to {options.out}/")
    return 0 if all(row["status"] == "solved" for row in table.rows.values()) else 1


def _settings(options: PlanOptions) -> PlanSettings:
    """Return how the scenes are planned; refuse wrong values."""
    from dvr_jax.planning.many_scenes import require_settings
    from dvr_jax.planning.scene_tasks import PlanSettings

    return require_settings(
        PlanSettings(
            options.search,
            options.k_max,
            options.seed,
            options.time_limit,
            options.network,
            options.clearance,
            options.termination,
            options.shortest,
        )
    )


def _tasks(options: PlanOptions, lines: Sequence[bytes], table: PlanTable) -> list[SceneTask]:
    """Return a task for each scene without a row, and give a row to each line that holds no valid scene."""
    from dvr_jax.planning.scene_tasks import PlanFiles, ScenePlan, SceneTask
    from dvr_jax.scene.files import scene_from_json

    settings = _settings(options)
    tasks = []
    for index in table.missing():
        try:
            scene = scene_from_json(lines[index], f"{options.scene}, scene {index}")
        except DvrError as error:
            table.add(ScenePlan(index, None, str(error), is_refused=True))
            continue

        files = PlanFiles(table.scene_folder(index), animation=options.animation)
        tasks.append(SceneTask(index, scene, settings, files))
    return tasks


def _read_lines(path: Path) -> list[bytes]:
    """Return the lines of a file that are not blank."""
    lines = [line for line in path.read_bytes().split(b"\n") if line.strip()]
    if not lines:
        raise SceneError(f"{path} holds no scene; valid is one JSON object a line.")
    return lines


def _summarize(rows: Mapping[int, Row]) -> str:
    """Return how many scenes ended how, the lengths of the plans, the median time, and the first reasons."""
    statuses = Counter(row["status"] for row in rows.values())
    lengths = Counter(len(row["actions"]) for row in rows.values() if row["actions"])
    seconds = [row["seconds"]["total"] for row in rows.values() if row["status"] == "solved"]
    reasons = [(index, row["reason"]) for index, row in sorted(rows.items()) if row["reason"]]

    counts = ", ".join(f"{count} {status}" for status, count in statuses.most_common())
    lines = [f"{len(rows)} scenes: {counts}"]
    if lengths:
        parts = ", ".join(f"{lengths[length]} with {length}" for length in sorted(lengths))
        lines.append(f"actions: {parts}; median time of a solved scene {median(seconds):.2f} s")

    lines += [f"scene {index}: {reason}" for index, reason in reasons[:SHOWN_REASONS]]
    if len(reasons) > SHOWN_REASONS:
        lines.append(f"and {len(reasons) - SHOWN_REASONS} more; the table has the reasons")
    return "\n".join(lines)
