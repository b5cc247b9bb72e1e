"""Cells and words that the figures of searches share."""

from __future__ import annotations

import statistics
from collections.abc import Callable

from dvr_jax.bench.committed import RowsFile
from dvr_jax.bench.markdown import EMPTY, seconds
from dvr_jax.bench.paper import LENGTHS
from dvr_jax.bench.scene_result import SceneResult, group_by_length

SEARCH_NAMES = {
    "dvr": "network",
    "classifier": "classifier",
    "mbts": "multi-bound tree search",
    "bfs": "breadth-first search",
}
"""What each search is called in the tables."""

SHAPE_NAMES = {
    "box": ("box", "boxes"),
    "cylinder": ("cylinder", "cylinders"),
    "mixed": ("box or cylinder", "boxes and cylinders"),
}
"""One and several objects of each shape."""


def cells_by_length(
    groups: dict[int, list[SceneResult]],
    value: Callable[[list[SceneResult]], str],
) -> list[str]:
    """Write one cell for each of the paper's lengths of a plan.

    Args:
        groups: results by the number of actions of the plan.
        value: writes the cell of the results of one length.

    Returns:
        The cells; where a length has no results, its cell says so.
    """
    return [value(groups[length]) if groups[length] else EMPTY for length in LENGTHS]


def groups_of(file: RowsFile) -> dict[int, list[SceneResult]]:
    """Group the results of a file by the number of actions of the plan."""
    return group_by_length(list(file.scene_results.values()), max(LENGTHS))


def count_cell(results: list[SceneResult]) -> str:
    """Write the number of results."""
    return f"{len(results):,}"


def median_seconds_cell(results: list[SceneResult]) -> str:
    """Write the median of the total times [s]."""
    return seconds(statistics.median(result.total_seconds for result in results))


def objects_in_words(number: int, shape: str) -> str:
    """Write number and shape of the objects of a scene.

    Args:
        number: number of objects.
        shape: shape as in the options of `bench scenes`.

    Returns:
        Such as "2 boxes".
    """
    one, several = SHAPE_NAMES[shape]
    return f"{number} {one if number == 1 else several}"
