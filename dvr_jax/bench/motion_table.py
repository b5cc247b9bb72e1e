"""The tables of measured motions: which measures there are, how they are combined, and how they are printed."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dvr_jax.bench.mesh_pairs import PairKind

LIMITS = ("velocity", "acceleration", "jerk", "torque", "finger speed")
"""Quantities whose limits are looked at."""


@dataclass(frozen=True, slots=True)
class Column:
    """A measure of all plans: a column of the printed table, and a line of the table in the documentation."""

    title: str
    """Title of the column, with its unit."""

    meaning: str
    """What it measures, as the documentation says it."""

    decimals: int
    """Digits after the point."""

    value: Callable[[Mapping[str, Any]], float | None]
    """Reads the value of a row; None where the row has none."""

    combine: Callable[[Sequence[float]], float]
    """Combines the values of several rows."""

    def combined(self, rows: Sequence[Mapping[str, Any]]) -> float | None:
        """Return the combined value of some rows; None where none of them has a value."""
        values = [value for row in rows if (value := self.value(row)) is not None]
        return self.combine(values) if values else None


def ratio_to(fastest: str) -> Callable[[Mapping[str, Any]], float | None]:
    """Return the function that reads how many times as long the arms of a row move as by TOPP-RA.

    Args:
        fastest: Key of the duration by TOPP-RA in a row.
    """
    return lambda row: float(row["moving"] / row[fastest]) if row.get(fastest) else None


def _limit(name: str) -> Callable[[Mapping[str, Any]], float]:
    """Return the function that reads the use of a limit from a row."""
    return lambda row: float(row["limits"][name]["ratio"])


def _entry(key: str) -> Callable[[Mapping[str, Any]], float | None]:
    """Return the function that reads an entry of a row, which need not be there."""
    return lambda row: row.get(key)


_median = statistics.median

COLUMNS = (
    Column("duration [s]", "duration, median [s]", 2, _entry("duration"), _median),
    Column(
        "/ TOPP-RA", "moving time over that of TOPP-RA, median", 3, ratio_to("fastest"), _median
    ),
    Column(
        "/ with torque",
        "… with limits of torque, median",
        3,
        ratio_to("fastest_with_torque"),
        _median,
    ),
    Column(
        "/ slow hands",
        "… with slow hands near switches, median",
        3,
        ratio_to("fastest_with_slow_hands"),
        _median,
    ),
    *(
        Column(name, f"largest use of the limits of {name}", 3, _limit(name), max)
        for name in LIMITS
    ),
    Column(
        "edge [mm]", "least distance from an edge of the region [mm]", 2, _entry("edge_mm"), min
    ),
    Column("height [mm]", "least height of a carried object [mm]", 1, _entry("height_mm"), min),
    Column(
        "depth [mm]", "deepest penetration of the meshes [mm]", 2, _entry("penetration_mm"), max
    ),
    Column(
        "check [ms]", "time of the independent check, median [ms]", 0, _entry("check_ms"), _median
    ),
)
"""Medians of durations, of their ratios and of the times of the check; the worst of all other values."""


def print_by_length(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print one line for each number of actions, and one for all plans."""
    titles = "  ".join(column.title for column in COLUMNS)
    print(f"  actions  plans  {titles}")
    for length in sorted({row["length"] for row in rows}):
        _print_line(str(length), [row for row in rows if row["length"] == length])
    _print_line("all", rows)

    off = [row["scene"] for row in rows if not row["is_clear_of_edges"]]
    print(f"  neither clear of the edges of the region nor centered: {len(off)} {off or ''}")
    print(
        "  durations, ratios to TOPP-RA and times of the check are medians, all others the worst of the plans\n"
        "  / TOPP-RA: moving time over that of TOPP-RA under limits of velocity and acceleration;\n"
        "  the next two columns add to these either the limits of torque, or slow hands near switches"
    )


def _print_line(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a line of the table.

    Args:
        name: Title of the line.
        rows: Rows of the results file.
    """
    cells = []
    for column in COLUMNS:
        value = column.combined(rows)
        text = "-" if value is None else f"{value:.{column.decimals}f}"
        cells.append(text.rjust(len(column.title)))
    print(f"  {name:<7}  {len(rows):>5}  {'  '.join(cells)}")


def print_distances(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the least distance of the meshes for each kind of pair, and where it occurs."""
    print("  least signed distances of the meshes")
    for kind in PairKind:
        found: list[tuple[Mapping[str, Any], dict[str, Any]]] = [
            (row, row["distances"][kind]) for row in rows if kind in row["distances"]
        ]
        if not found:
            continue
        row, least = min(found, key=lambda entry: float(entry[1]["mm"]))
        median = statistics.median(entry["mm"] for _, entry in found)
        where = f"{' and '.join(least['bodies'])} in scene {row['scene']} at {least['time']:.2f} s"
        print(f"    {kind:<26} {least['mm']:>8.2f} mm, median {median:>7.2f} mm; {where}")
