"""The frozen problems of the benchmarks: a scene, a sequence, and an oracle's verdict on it.

The package holds one set of problems, `PROBLEMS`, so it is found from any working directory and in an installed wheel.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.runtime.json_text import parse_json
from dvr_jax.scene.files import scene_from_json
from dvr_jax.scene.types import Scene

PROBLEMS: Traversable = files("dvr_jax.bench") / "problems.jsonl"
"""The problems of the package, drawn by `python -m dvr_jax.bench oracle`."""


def read_rows(path: Path | Traversable) -> list[dict[str, Any]]:
    """Read the rows of a problem file by kind and index; a last line that was cut short is dropped.

    Raises:
        DvrError: The file holds no problems.
    """
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    try:
        rows = [parse_json(line, constants=True) for line in whole.splitlines()]
        return sorted(rows, key=lambda row: (row["kind"], row["index"]))
    except (ValueError, LookupError, TypeError) as error:
        raise DvrError(
            f"{path} holds no problems ({error}); valid is what bench oracle writes."
        ) from None


def read_problems(
    path: Path | Traversable | None = None,
) -> Iterator[tuple[Scene, list[Action], dict[str, Any]]]:
    """Read scene, actions and row of each problem, in a fixed order.

    Args:
        path: problem file; by default the one of the package.

    Yields:
        Scene, actions and the row of the file: "kind" ("keyframes" or "path"), "index", "length" and "feasible".

    Raises:
        DvrError: There is no such file, or it holds no problems.
    """
    source = PROBLEMS if path is None else path
    if not source.is_file():
        raise DvrError(f"there is no file {source}; valid is what bench oracle writes.")

    for row in read_rows(source):
        actions = [Action(operator, tuple(arguments)) for operator, *arguments in row["actions"]]
        yield scene_from_json(json.dumps(row["scene"])), actions, row
