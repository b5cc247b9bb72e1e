"""The course of a training: a line per figure in `history.jsonl`, TensorBoard events, and curves as a picture."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType

from tensorboardX import SummaryWriter

from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole

TITLES = {
    "loss": "loss",
    "average_precision": "average precision of the steps",
    "top1": "greedy sequence is feasible",
}
"""Figure to the title of its curves."""


class History:
    """Records figures of a run; one that goes on from a checkpoint forgets what came after it."""

    def __init__(self, folder: Path, step: int) -> None:
        """Open the history in `folder`, cut off behind `step`."""
        self.path = folder / "history.jsonl"
        self.records = [record for record in read_history(self.path) if record["step"] <= step]
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.path, "".join(json.dumps(record) + "\n" for record in self.records).encode())
        self._events = SummaryWriter(str(folder / "events"), purge_step=step + 1 if step else None)

    def add(self, step: int, part: str, figures: dict[str, float]) -> None:
        """Record figures of a part ("train" or "validation")."""
        record = {"step": step, **{f"{part}/{name}": value for name, value in figures.items()}}
        self.records.append(record)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        for name, value in figures.items():
            self._events.add_scalar(f"{part}/{name}", value, step)

    def __enter__(self) -> History:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._events.close()


def read_history(path: Path) -> list[dict[str, float]]:
    """All records of a run, none if there is no file; a last line cut short by a kill is left out."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    records = []
    for number, line in enumerate(lines, start=1):
        try:
            record = json.loads(line)
        except ValueError:
            if number == len(lines):
                break
            record = None
        if not isinstance(record, dict) or not all(isinstance(value, int | float) for value in record.values()):
            record = {}
        if "step" not in record:
            raise DvrError(f"{path}, line {number}: this is no record of a training; remove the file.")
        records.append(record)
    return records


def save_curves(path: Path, records: list[dict[str, float]]) -> bool:
    """Draw loss, average precision and top-1 accuracy over the steps; False where matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return False
    recorded = {name for record in records for name in record}
    titles = {name: title for name, title in TITLES.items() if f"validation/{name}" in recorded or name == "loss"}
    figure = Figure(figsize=(4 * len(titles), 3.2), layout="constrained")
    for axes, (name, title) in zip(figure.subplots(1, len(titles), squeeze=False)[0], titles.items(), strict=True):
        for part in ("train", "validation"):
            points = [(record["step"], record[f"{part}/{name}"]) for record in records if f"{part}/{name}" in record]
            if points:
                axes.plot(*zip(*points, strict=True), label=part, marker="." if len(points) < 30 else None)
                axes.legend(frameon=False)
        axes.set(title=title, xlabel="steps")
        axes.set_ylim(bottom=0, top=None if name == "loss" else 1.02)
        axes.locator_params(axis="x", nbins=5)
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    return True
