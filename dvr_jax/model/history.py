"""The course of a training: records in `history.jsonl`, TensorBoard events, and curves as a picture."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from tensorboardX import SummaryWriter

from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import append_line, read_whole, write_whole
from dvr_jax.runtime.json_text import parse_json

Record = dict[str, float]
"""Figures of one step by name, such as "train/loss", and the step itself as "step"."""

TITLES = {
    "loss": "loss",
    "average_precision": "average precision of the steps",
    "top1": "greedy sequence is feasible",
}
"""Title of the curves of each figure."""

CHECKSUM = "checksum"
"""Name of the checksum in a line."""

PARTS = ("train", "validation")
"""Parts of the data of which figures are recorded."""


class History:
    """Records of the figures of a run; a run that continues from a checkpoint drops the records behind it."""

    def __init__(self, folder: Path, step: int) -> None:
        """Open the history of a run.

        Args:
            folder: Folder of the run; it is made if it is missing.
            step: Step from which the run continues; later records are dropped.
        """
        self.path = folder / "history.jsonl"
        self.records = [record for record in read_history(self.path) if record["step"] <= step]
        folder.mkdir(parents=True, exist_ok=True)
        self._checksum = 0
        lines = [self._to_line(record) for record in self.records]
        write_whole(self.path, "".join(lines).encode())

        # TensorBoard drops the same records; a new run has none to drop.
        first_dropped = step + 1 if step else None
        self._events = SummaryWriter(str(folder / "events"), purge_step=first_dropped)

    def add(self, step: int, part: str, figures: Mapping[str, float]) -> None:
        """Record figures.

        Args:
            step: Step of the training.
            part: One of `PARTS`.
            figures: The figures by name.
        """
        record: Record = {"step": step}
        for name, value in figures.items():
            record[f"{part}/{name}"] = value
            self._events.add_scalar(f"{part}/{name}", value, step)

        self.records.append(record)
        append_line(self.path, self._to_line(record))

    def _to_line(self, record: Record) -> str:
        """Return the next line: the record as JSON, with a checksum of it and of all lines before it."""
        self._checksum = _checksum_after(self._checksum, record)
        return json.dumps({**record, CHECKSUM: self._checksum}) + "\n"

    def __enter__(self) -> History:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._events.close()


def read_history(path: Path) -> list[Record]:
    """Return all records of a run, and none if there is no file.

    A last line that was cut short by a kill is left out.

    Raises:
        DvrError: A line is no record, or not the one that was written.
        OSError: The file cannot be read.
    """
    if not path.exists():
        return []

    content = read_whole(path)
    *lines, _ = content.split(b"\n")
    records: list[Record] = []
    # Histories before version 0.10 have no checksums.
    checksum = 0 if CHECKSUM.encode() in content else None
    for number, line in enumerate(lines, start=1):
        place = f"{path}, line {number}"
        record = _record_of(line, place)
        found = record.pop(CHECKSUM, None)
        if checksum is not None:
            checksum = _checksum_after(checksum, record)
        if found != checksum:
            raise _refusal(place, "its checksum is another one")
        records.append(record)

    # What follows the last line break was cut short by a kill.
    return records


def _checksum_after(before: int, record: Record) -> int:
    """Return the checksum of a record and of all before it, given that of all before it."""
    return zlib.crc32(json.dumps(record).encode(), before)


def _record_of(line: bytes, place: str) -> Record:
    """Return the record of a line, with its checksum."""
    try:
        record = parse_json(line)
    except ValueError as error:
        raise _refusal(place, str(error)) from None

    if not _is_record(record):
        raise _refusal(place, "a record has a step, and figures with names such as train/loss")
    return dict(record)


def _refusal(place: str, reason: str) -> DvrError:
    return DvrError(
        f"{place}: this is no record of a training ({reason}); move the file away, and the training goes on "
        "without these records."
    )


def _is_record(value: object) -> bool:
    """Return whether a JSON value is a record, with or without a checksum."""
    if not isinstance(value, dict) or "step" not in value:
        return False

    names = [name for name in value if name not in ("step", CHECKSUM)]
    is_named = all(name.partition("/")[0] in PARTS for name in names)
    return is_named and all(type(figure) in (int, float) for figure in value.values())


def save_curves(path: Path, records: Sequence[Record]) -> bool:
    """Draw the curves of all figures over the steps.

    Args:
        path: File of the picture.
        records: Records of the run.

    Returns:
        False if matplotlib is not installed and nothing was drawn.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return False

    recorded = {name for record in records for name in record}
    names = [name for name in TITLES if name == "loss" or f"validation/{name}" in recorded]
    figure = Figure(figsize=(4 * len(names), 3.2), layout="constrained")
    all_axes = figure.subplots(1, len(names), squeeze=False)[0]
    for axes, name in zip(all_axes, names, strict=True):
        for part in PARTS:
            curve = f"{part}/{name}"
            steps = [record["step"] for record in records if curve in record]
            values = [record[curve] for record in records if curve in record]
            if steps:
                axes.plot(steps, values, label=part, marker="." if len(steps) < 30 else None)
                axes.legend(frameon=False)

        axes.set(title=TITLES[name], xlabel="steps")
        axes.set_ylim(bottom=0, top=None if name == "loss" else 1.02)
        axes.locator_params(axis="x", nbins=5)
        axes.grid(alpha=0.3)

    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=120)
    write_whole(path, content.getvalue())
    return True
