"""The figures of measured motions: durations, limits, distances of the robot's meshes, and times of the check."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from dvr_jax.bench.committed import CommittedResults, RowsFile, describe_origins
from dvr_jax.bench.figure_cells import objects_in_words
from dvr_jax.bench.markdown import EMPTY, listing, table
from dvr_jax.bench.mesh_pairs import PairKind
from dvr_jax.bench.motion_table import COLUMNS, Column
from dvr_jax.bench.paper import LENGTHS

Rows = Sequence[Mapping[str, Any]]
"""Rows of solved scenes."""


def motions(results: CommittedResults) -> str:
    """Table of measured motions: one column for each file, and one line for each measure."""
    files = results.motions()
    head = ["measure", *(_name(file) for file in files)]
    solved = [[row for row in file.rows if row["length"]] for file in files]
    lines = [
        [
            "plans",
            *(f"{len(rows)} of {len(file.rows)}" for rows, file in zip(solved, files, strict=True)),
        ],
        ["plans of each number of actions", *(_counts(rows) for rows in solved)],
    ]
    for column in COLUMNS:
        cells = []
        for rows in solved:
            by_length = [[row for row in rows if row["length"] == length] for length in LENGTHS]
            each = listing([_cell(column, part) for part in by_length])
            cells.append(f"{_cell(column, rows)} ({each})")
        lines.append([column.meaning, *cells])
    clear = ["neither clear of the edges nor centered", *(_off_center(rows) for rows in solved)]
    return f"{table(head, [*lines, clear])}\n\n{describe_origins([file.origin for file in files])}"


def motion_distances(results: CommittedResults) -> str:
    """Table of the least signed distances of the robot's meshes, by kind of pair."""
    files = results.motions()
    head = ["pair", *(_name(file) for file in files)]
    lines = []
    for kind in PairKind:
        cells = []
        for file in files:
            values = [
                row["distances"][kind]["mm"]
                for row in file.rows
                if kind in row.get("distances", {})
            ]
            cells.append(
                f"{min(values):.2f} (median {statistics.median(values):.2f})" if values else EMPTY
            )
        lines.append([str(kind), *cells])
    return table(head, lines)


def _name(file: RowsFile) -> str:
    """Return the title of a column."""
    options = file.options
    objects = objects_in_words(options["objects"], options["shape"])
    return f"{objects}, seed {options['seed']}, {options['termination']} paths"


def _counts(rows: Rows) -> str:
    """Return how many plans have each number of actions."""
    return listing([str(sum(row["length"] == length for row in rows)) for length in LENGTHS])


def _off_center(rows: Rows) -> str:
    """Return at how many plans the object is neither clear of the region's edges nor centered."""
    return str(sum(not row["is_clear_of_edges"] for row in rows))


def _cell(column: Column, rows: Rows) -> str:
    """Return the combined value of a measure.

    Args:
        column: A measure.
        rows: Rows of solved scenes.
    """
    value = column.combined(rows)
    return EMPTY if value is None else f"{value:.{column.decimals}f}"
