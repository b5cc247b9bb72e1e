"""The paper's Table I: number of action sequences that reach the symbolic goal, by number of objects and length."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.bench.paper import LENGTHS, TABLE_ONE, table_one_cell
from dvr_jax.logic import count_sequences, ground_actions
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL


@dataclass(frozen=True)
class TableOneOptions:
    """Count the sequences of the paper's Table I."""

    out: Path | None = None
    """JSON file to write the counts to."""


def run(arguments: list[str]) -> int:
    """Count all 25 cells and print them beside the paper's; the exit code is 0 when all agree."""
    options = tyro.cli(TableOneOptions, prog="python -m dvr_jax.bench table1", args=arguments)
    begin = time.monotonic()
    metrics: list[Metric] = []
    right = 0

    print("objects   length 2        3        4         5          6")
    for objects, published in TABLE_ONE.items():
        counts = count_row(objects)
        cells = []
        for length, count, paper in zip(LENGTHS, counts, published, strict=True):
            mark = "" if count == paper else f" (paper {paper:,})"
            cells.append(f"{count:>10,}{mark}")
            right += count == paper
            metrics.append(
                Metric(table_one_cell(objects, length), count, "sequences", Direction.EQUAL)
            )
        print(f"{objects:>7} " + " ".join(cells))
    print(f"{right} of 25 cells as in the paper, {time.monotonic() - begin:.2f} s")

    if options.out is not None:
        save_metrics(options.out, "table1", metrics)
    return 0 if right == len(metrics) else 1


def count_row(objects: int) -> list[int]:
    """Count the sequences of 2 to 6 actions that reach the goal with their last action, for a number of objects."""
    names = [f"object{number}" for number in range(objects)]
    counts = count_sequences(
        ground_actions(names, names[0], DEFAULT_WORKCELL.arm_names), max(LENGTHS)
    )
    return [counts[length] for length in LENGTHS]
