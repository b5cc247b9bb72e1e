"""A folder of many plans: one folder for each scene, and a table with one row for each scene that is done.

    run.json            how the scenes are planned, and by which versions
    results.jsonl       one row for each scene, as they are done; at the end in the order of the file
    scene-000000/ ...   the files of each plan (`dvr_jax.planning.plan_files`)

A row is appended once the files of its plan are complete, and it reaches the disk whole or not at all. A run that was
stopped therefore goes on with the scenes that have no row.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dvr_jax import __version__
from dvr_jax.errors import DataError
from dvr_jax.planning.result import Plan
from dvr_jax.planning.scene_tasks import PlanSettings, ScenePlan
from dvr_jax.runtime.files import require_folder, write_whole

RUN = "run.json"
"""Name of the file that says how the scenes are planned."""

RESULTS = "results.jsonl"
"""Name of the table."""

REFUSED = "refused"
"""Status of a scene that was refused as bad input."""

FAILED = "failed"
"""Status of a scene whose planning ended with a defect or with the death of its worker; a later run tries it again."""

Row = dict[str, Any]
"""One row of the table."""


class PlanTable:
    """The table of a folder of plans."""

    def __init__(self, folder: Path, settings: PlanSettings, checksums: Sequence[str]) -> None:
        """Make the folder, or read what an earlier run left in it.

        Args:
            folder: Folder of the plans.
            settings: How the scenes are planned.
            checksums: Checksum of each scene (`checksum_of`).

        Raises:
            DataError: The folder holds plans of other scenes, settings or versions.
            OSError: A file cannot be read or written.
        """
        require_folder(folder)
        self.folder = folder
        self.path = folder / RESULTS
        self.checksums = checksums
        self._write_run(settings)
        self.rows: dict[int, Row] = {row["scene"]: row for row in self._read_rows()}
        """Rows by the number of the scene."""

    def missing(self) -> list[int]:
        """Return the numbers of the scenes that have no row."""
        return [index for index in range(len(self.checksums)) if index not in self.rows]

    def scene_folder(self, index: int) -> Path:
        """Return the folder for the plan of a scene."""
        return self.folder / f"scene-{index:06d}"

    def add(self, result: ScenePlan) -> Row:
        """Append the row of a result whose files are written, and return it."""
        row = {
            "scene": result.index,
            **_describe(result),
            "folder": "" if result.plan is None else self.scene_folder(result.index).name,
            "checksum": self.checksums[result.index],
        }
        self.rows[result.index] = row
        with self.path.open("ab") as file:
            file.write(_to_line(row))
            file.flush()
            os.fsync(file.fileno())
        return row

    def sort(self) -> None:
        """Write the rows in the order of the scenes."""
        rows = [self.rows[index] for index in sorted(self.rows)]
        write_whole(self.path, b"".join(map(_to_line, rows)))

    def _write_run(self, settings: PlanSettings) -> None:
        """Write how the scenes are planned, or compare it with what an earlier run wrote."""
        path = self.folder / RUN
        names = ("jax", "mujoco", "numpy")
        record = {
            "settings": {**asdict(settings), "network": _network_of(settings)},
            "versions": {
                "python": platform.python_version(),
                "dvr_jax": __version__,
                **{name: version(name) for name in names},
            },
        }
        if not path.exists():
            write_whole(path, json.dumps(record, indent=1).encode() + b"\n")
            return

        try:
            earlier = json.loads(path.read_bytes())
            found = earlier["settings"], earlier["versions"]["dvr_jax"]
        except (ValueError, LookupError, TypeError) as error:
            raise DataError(
                f"{path} does not describe a run ({error}); choose another --out."
            ) from None
        if found != (record["settings"], __version__):
            raise DataError(
                f"{self.folder} holds plans of other settings or of another version ({found[0]}, dvr_jax "
                f"{found[1]}); choose another --out."
            )

    def _read_rows(self) -> list[Row]:
        """Read the rows that count, and remove all others: a last one that was cut short, and failures."""
        if not self.path.exists():
            return []

        content = self.path.read_bytes()
        try:
            lines = [line for line in content.splitlines(keepends=True) if line.endswith(b"\n")]
            rows = [row for row in map(json.loads, lines) if row["status"] != FAILED]
            strangers = [row["scene"] for row in rows if not self._is_own(row)]
        except (ValueError, LookupError, TypeError) as error:
            raise DataError(
                f"{self.path} is no table of plans ({error}); choose another --out."
            ) from None
        if strangers:
            raise DataError(
                f"row {strangers[0]} of {self.path} is of another scene; choose another --out."
            )

        kept = b"".join(map(_to_line, rows))
        if kept != content:
            write_whole(self.path, kept)
        return rows

    def _is_own(self, row: Row) -> bool:
        """Return whether a row is of one of the scenes."""
        index = row["scene"]
        return index < len(self.checksums) and row["checksum"] == self.checksums[index]


def checksum_of(text: str | bytes) -> str:
    """Return the checksum of a scene's text, by which a row is known to be of the scene."""
    content = text.encode() if isinstance(text, str) else text
    return hashlib.sha256(content.strip()).hexdigest()[:16]


def _network_of(settings: PlanSettings) -> str:
    """Return what tells the network of the settings from others; empty for the shipped one."""
    if settings.network is None:
        return ""

    # Imported here, because most runs take the shipped network.
    from dvr_jax.model.predictor import load_network

    return load_network(settings.search, settings.network).checksum


def _describe(result: ScenePlan) -> Row:
    """Return the part of a row that depends on the outcome."""
    if result.plan is None:
        return {
            "status": REFUSED if result.is_refused else FAILED,
            "reason": " ".join(result.failure.split()),
            "actions": [],
        }
    return _describe_plan(result.plan)


def _describe_plan(plan: Plan) -> Row:
    """Return the part of a row that describes a plan."""
    seconds: Mapping[str, float] = plan.seconds
    return {
        "status": plan.status.value,
        "reason": "" if plan.reason is None else plan.reason.sentence,
        "actions": list(plan.action_descriptions),
        "duration": None if plan.motion is None else round(float(plan.motion.time[-1]), 6),
        "cost": None if plan.path is None else plan.path.cost,
        "deepest_penetration": None if plan.report is None else plan.report.deepest_penetration,
        "nlps": plan.nlps,
        "verdicts": plan.verdicts,
        "rejected_by_check": plan.rejected,
        "seconds": {stage: round(float(value), 3) for stage, value in seconds.items()},
    }


def _to_line(row: Row) -> bytes:
    """Return a row as one line of JSON."""
    return json.dumps(row).encode() + b"\n"
