"""Results of a benchmark in a JSON Lines file: a header with options and machine, then one row each, written as they
come, so that a benchmark that was stopped goes on where it was."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dvr_jax import __version__
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole


def describe_machine() -> dict[str, Any]:
    """Processor, number of cores and versions."""
    names = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next((line.partition(":")[2].strip() for line in names if line.startswith("model name")), "")
    versions = {name: version(name) for name in ("jax", "mujoco", "numpy")}
    return {
        "machine": model or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "versions": {"dvr_jax": __version__, "python": platform.python_version(), **versions},
    }


class ResultsFile:
    """The rows of one file, by number; without a file they are kept in memory alone."""

    def __init__(self, path: Path | None, options: Mapping[str, Any], of: str = "scene") -> None:
        """Read what the file has; a last line that was cut short is dropped. `of` is what a row is of, and the key of
        its number.

        Raises DvrError where the file holds results of other options.
        """
        self.path, self.rows, self.version, self.of = path, dict[int, dict[str, Any]](), __version__, of
        if path is None:
            return
        plain = json.loads(json.dumps(options))
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        whole = [line for line in text.splitlines(keepends=True) if line.endswith("\n")]
        if not whole:
            path.parent.mkdir(parents=True, exist_ok=True)
            whole = [json.dumps({"options": plain, **describe_machine()}) + "\n"]
        if "".join(whole) != text:
            write_whole(path, "".join(whole).encode())
        try:
            header, *rows = map(json.loads, whole)
            self.rows = {int(row[of]): row for row in rows}
            known, self.version = header["options"], header["versions"].get("dvr_jax", "unknown")
        except (ValueError, LookupError, TypeError) as error:
            raise DvrError(f"{path} holds no results of a benchmark ({error}); choose another --out.") from None
        if known != plain:
            raise DvrError(f"{path} holds results of other options: {known}; choose another --out.")

    def missing(self, number: int) -> list[int]:
        """Those of the numbers 0 to number - 1 that have no row; says how many have one.

        Raises DvrError where some are missing and those that are there come of another version.
        """
        todo = [index for index in range(number) if index not in self.rows]
        if self.rows and todo and self.version != __version__:
            raise DvrError(
                f"{self.path} holds results of dvr_jax {self.version}, this is {__version__}; choose another --out."
            )
        if self.rows:
            kept = f"{number - len(todo)} of {number} {self.of}s are in {self.path} already (dvr_jax {self.version})"
            print(f"{kept}; another --out measures them anew", file=sys.stderr, flush=True)
        return todo

    def add(self, row: dict[str, Any]) -> None:
        """Keep a row."""
        self.rows[int(row[self.of])] = row
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
