"""Results of a benchmark in a JSON Lines file that survives a stop: a header, then one row for each result.

The header holds the options of the benchmark and the machine that measured. Each row is written as soon as it is
there, so a benchmark that was stopped goes on where it was.
"""

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
from dvr_jax.runtime.files import append_line, read_whole, write_whole
from dvr_jax.runtime.json_text import parse_json

Row = dict[str, Any]
"""One result as JSON has it."""


def describe_machine() -> Row:
    """Name the processor, the number of cores and the versions of this package and of what it computes with."""
    processor_file = Path("/proc/cpuinfo")
    lines = processor_file.read_text().splitlines() if processor_file.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    model = models[0] if models else ""

    versions = {name: version(name) for name in ("jax", "mujoco", "numpy")}
    return {
        "machine": model or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "versions": {
            "dvr_jax": __version__,
            "python": platform.python_version(),
            **versions,
        },
    }


class ResultsFile:
    """The rows of one file, by number; without a file they are kept in memory alone."""

    path: Path | None
    """The file."""
    rows: dict[int, Row]
    """The results by their number."""
    version: str
    """Version of this package that measured the rows."""
    of: str
    """What a row is a result of, which is also the key of its number."""

    def __init__(
        self,
        path: Path | None,
        options: Mapping[str, Any],
        of: str = "scene",
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        """Read what the file has; a last line that was cut short is dropped.

        Args:
            path: JSON Lines file; None keeps the rows in memory alone.
            options: what results must agree in to stand in one file.
            of: what a row is a result of, which is also the key of its number.
            facts: further entries of the header; a header that lacks them gets them.

        Raises:
            DvrError: The file holds results of other options, or no results.
        """
        self.path = path
        self.rows = {}
        self.version = __version__
        self.of = of
        if path is not None:
            self._read(path, json.loads(json.dumps(options)), dict(facts or {}))

    def _read(self, path: Path, options: Row, facts: Row) -> None:
        content = read_whole(path) if path.exists() else b""
        # Bytes that are no text are no JSON either, and are refused as such.
        text = content.decode("utf-8", errors="replace")
        lines = [line for line in text.splitlines(keepends=True) if line.endswith("\n")]
        if not lines:
            path.parent.mkdir(parents=True, exist_ok=True)
            lines = [_to_line({"options": options, **facts, **describe_machine()})]

        try:
            header, *rows = (parse_json(line, constants=True) for line in lines)
            self.rows = {int(row[self.of]): row for row in rows}
            known_options = header["options"]
            self.version = header["versions"].get("dvr_jax", "unknown")
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise DvrError(
                f"{path} holds no results of a benchmark ({error}); choose another --out."
            ) from None
        if known_options != options:
            raise DvrError(
                f"{path} holds results of other options: {known_options}; choose another --out."
            )

        # The options agree, so what was found out about them holds for the rows as well.
        if any(name not in header for name in facts):
            lines[0] = _to_line({"options": options, **facts, **header})
        if "".join(lines).encode() != content:
            write_whole(path, "".join(lines).encode())

    def missing(self, number: int) -> list[int]:
        """List those of the numbers 0 to number - 1 that have no row, and say how many have one.

        Raises:
            DvrError: Some are missing, and those that are there were measured by another version.
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

    def add(self, row: Row) -> None:
        """Keep a row."""
        self.rows[int(row[self.of])] = row
        if self.path is not None:
            append_line(self.path, _to_line(row))


def read_results(path: Path, of: str = "scene") -> tuple[Row, dict[int, Row]]:
    """Read a file of results of any version.

    Args:
        path: JSON Lines file.
        of: what a row is a result of, which is also the key of its number.

    Returns:
        The options of its header, and its rows by their number.

    Raises:
        DvrError: The file is missing or holds no results.
    """
    try:
        lines = read_whole(path).decode("utf-8", errors="replace").splitlines(keepends=True)
        complete = [line for line in lines if line.endswith("\n")]
        header, *rows = (parse_json(line, constants=True) for line in complete)
        return dict(header["options"]), {int(row[of]): row for row in rows}
    except OSError as error:
        raise DvrError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise DvrError(f"{path} holds no results of a benchmark ({error}).") from None


def _to_line(row: Row) -> str:
    return json.dumps(row) + "\n"
