"""The committed results of the benchmarks, read for the figures of README and docs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dvr_jax.bench.metrics import MetricsFile, load_metrics
from dvr_jax.bench.scene_result import SceneResult
from dvr_jax.errors import DvrError

RESULTS = Path("bench/results")
"""Folder of the results in the repository."""

EXECUTIONS = "execution"
"""Folder of the results of `bench execute`, below `RESULTS`."""

MOTIONS = "motions"
"""Folder of the results of `bench motions`, below `RESULTS`."""


class MissingResultsError(DvrError):
    """A figure needs a file of results that the repository does not have."""

    def __init__(self, file: Path) -> None:
        """Say which file, relative to the repository."""
        super().__init__(f"there are no results {file.as_posix()} yet.")
        self.file = file


@dataclass(frozen=True)
class Origin:
    """Which version measured results, and on which machine."""

    version: str
    """Version of this package."""
    machine: str
    """Processor."""
    cores: int
    """Number of cores of the machine."""


def describe_origins(origins: Sequence[Origin]) -> str:
    """Write the sentence that says which version measured some results, and where."""
    parts = []
    for origin in dict.fromkeys(origins):
        parts.append(f"version {origin.version} ({origin.machine}, {origin.cores} cores)")
    *others, last = parts
    if not others:
        return f"Measured with {last}."
    return f"Measured with {', '.join(others)} and {last}."


@dataclass(frozen=True)
class RowsFile:
    """A JSON Lines file of results."""

    path: Path
    """The file, relative to the repository."""
    header: Mapping[str, Any]
    """Its first line."""
    rows: tuple[Mapping[str, Any], ...]
    """The other lines."""

    @property
    def options(self) -> Mapping[str, Any]:
        """Options of the benchmark."""
        options: Mapping[str, Any] = self.header["options"]
        return options

    @property
    def origin(self) -> Origin:
        """Version and machine."""
        return Origin(
            self.header["versions"]["dvr_jax"],
            self.header["machine"],
            self.header["cores"],
        )

    @cached_property
    def scene_results(self) -> dict[int, SceneResult]:
        """The rows of planned scenes by the number of the scene, in its order."""
        results = [SceneResult.from_row(row) for row in self.rows]
        return {result.scene: result for result in sorted(results, key=lambda result: result.scene)}


@dataclass(frozen=True)
class CommittedResults:
    """The results in a repository."""

    repository: Path
    """Folder that holds `bench/results`."""

    def rows(self, name: str) -> RowsFile:
        """Read a JSON Lines file of `bench/results`.

        Raises:
            MissingResultsError: There is no such file.
            DvrError: It holds no results.
        """
        relative = RESULTS / name
        path = self._find(relative)
        try:
            header, *rows = [
                json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()
            ]
            file = RowsFile(relative, header, tuple(rows))
            _ = (file.options, file.origin)
        except (ValueError, LookupError, TypeError) as error:
            raise DvrError(f"{path} holds no results of a benchmark ({error}).") from None
        return file

    def scenes(self) -> list[RowsFile]:
        """Read all results of `bench scenes`, which lie in `bench/results` itself.

        Raises:
            MissingResultsError: There are none.
        """
        folder = self.repository / RESULTS
        files = [self.rows(path.name) for path in sorted(folder.glob("*.jsonl"))]
        of_scenes = [file for file in files if "shape" in file.options]
        if not of_scenes:
            raise MissingResultsError(RESULTS / "*_seed1.jsonl")
        return of_scenes

    def executions(self) -> list[RowsFile]:
        """Read all results of `bench execute`, which lie in the folder `EXECUTIONS`.

        Raises:
            MissingResultsError: There are none.
        """
        return self._folder(EXECUTIONS)

    def motions(self) -> list[RowsFile]:
        """Read all results of `bench motions`, which lie in the folder `MOTIONS`.

        Raises:
            MissingResultsError: There are none.
        """
        return self._folder(MOTIONS)

    def metrics(self, benchmark: str) -> MetricsFile:
        """Read the metrics that a benchmark wrote.

        Raises:
            MissingResultsError: There is no such file.
            DvrError: It holds no metrics.
        """
        return load_metrics(self._find(RESULTS / f"{benchmark}.json"))

    def manifest(self, relative: str) -> Mapping[str, Any]:
        """Read the manifest of a network, given its path relative to the repository.

        Raises:
            MissingResultsError: There is no such file.
        """
        path = self._find(Path(relative))
        manifest: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return manifest

    def _folder(self, name: str) -> list[RowsFile]:
        """Read all JSON Lines files of a folder below `RESULTS`, in the order of their names."""
        paths = sorted((self.repository / RESULTS / name).glob("*.jsonl"))
        if not paths:
            raise MissingResultsError(RESULTS / name)
        return [self.rows(f"{name}/{path.name}") for path in paths]

    def _find(self, relative: Path) -> Path:
        path = self.repository / relative
        if not path.is_file():
            raise MissingResultsError(relative)
        return path


def metrics_origin(file: MetricsFile) -> Origin:
    """Give version and machine of a metrics file."""
    return Origin(file.version, file.machine, file.cores)
