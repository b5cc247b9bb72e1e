"""The labels of scenes whose shard is not complete yet, in a file that is written as the scenes are done.

Each line holds one scene and its labels. Scenes that are in a shard are removed from the file, and the file goes with
the last of them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

from dvr_jax import __version__
from dvr_jax.dataset.labels import Label
from dvr_jax.errors import DataError, DvrError
from dvr_jax.runtime.files import append_line, read_whole, write_whole
from dvr_jax.runtime.json_lines import checked_line, parse_checked_line
from dvr_jax.scene.files import are_equal_but_for_rounding, scene_from_json, scene_to_json
from dvr_jax.scene.types import Scene

NAME = "_unfinished.jsonl"
"""Name of the file. Readers of Parquet folders take no file for data whose name begins so."""


class LabelJournal:
    """The file of one sweep, and what it holds."""

    def __init__(
        self, folder: Path, options: Mapping[str, object], scenes: Sequence[Scene]
    ) -> None:
        """Read what an earlier run left.

        Args:
            folder: Folder of the sweep.
            options: Options of the sweep that its labels depend on.
            scenes: All scenes of the sweep.

        Raises:
            DataError: The file comes of another sweep, of another version or of other scenes.
        """
        self.path = folder / NAME
        self.scenes = scenes
        self._header = {"options": json.loads(json.dumps(options)), "dvr_jax": __version__}
        self.labels: dict[int, list[Label]] = self._read()
        """Labels of the finished scenes, by index."""

    def add(self, index: int, labels: Sequence[Label]) -> None:
        """Keep the labels of a scene.

        Args:
            index: Index of the scene.
            labels: Its labels.
        """
        self.labels[index] = list(labels)
        lines = [] if self.path.exists() else [_to_line(self._header)]
        append_line(self.path, b"".join([*lines, self._line(index)]).decode())

    def remove(self, indices: Iterable[int]) -> None:
        """Remove scenes whose shard is written.

        Args:
            indices: Indices of the scenes.
        """
        for index in indices:
            self.labels.pop(index, None)

        if self.labels:
            write_whole(self.path, self._content())
        else:
            self.path.unlink(missing_ok=True)

    def _content(self) -> bytes:
        """Return the whole file."""
        return b"".join([_to_line(self._header), *map(self._line, self.labels)])

    def _line(self, index: int) -> bytes:
        """Return the line of a scene."""
        labels = [astuple(label) for label in self.labels[index]]
        text = scene_to_json(self.scenes[index])
        return _to_line({"scene": index, "text": text, "labels": labels})

    def _read(self) -> dict[int, list[Label]]:
        """Read the file; a last line that was cut short is removed."""
        if not self.path.exists():
            return {}

        content = read_whole(self.path)
        whole = [line for line in content.splitlines(keepends=True) if line.endswith(b"\n")]
        if len(b"".join(whole)) != len(content):
            write_whole(self.path, b"".join(whole))
        if not whole:
            self.path.unlink()
            return {}

        try:
            header, *rows = map(parse_checked_line, whole)
            labels = {row["scene"]: [_label(*values) for values in row["labels"]] for row in rows}
            is_own = header == self._header and all(map(self._is_own, rows))
        except (ValueError, LookupError, TypeError, DvrError) as error:
            raise DataError(
                f"{self.path} is not as a sweep wrote it ({error}); move it away, and its scenes are labeled again."
            ) from None
        if not is_own:
            raise DataError(
                f"{self.path} comes of another sweep ({header}) or holds other scenes; choose another --out."
            )
        return labels

    def _is_own(self, row: Mapping[str, Any]) -> bool:
        """Return whether a line is of one of the scenes."""
        index = row["scene"]
        if index >= len(self.scenes):
            return False
        return are_equal_but_for_rounding(scene_from_json(row["text"]), self.scenes[index])


def _label(scene: int, actions: Sequence[str], *verdict: Any) -> Label:
    """Return the label that a line holds."""
    return Label(scene, tuple(actions), *verdict)


def _to_line(record: Mapping[str, Any]) -> bytes:
    """Return a record as one line of JSON with its checksum."""
    return checked_line(record)
