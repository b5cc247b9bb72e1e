"""The paper's Table I: number of action sequences that reach the symbolic goal, by number of objects and length."""

from __future__ import annotations

import time
from dataclasses import dataclass

import tyro

from dvr_jax.logic import count_sequences, ground_actions

TABLE_ONE = (
    (8, 32, 192, 1_024, 5_632),
    (8, 96, 704, 6_400, 51_200),
    (8, 160, 1_216, 15_872, 145_920),
    (8, 224, 1_728, 29_440, 289_792),
    (8, 288, 2_240, 47_104, 482_816),
)
"""ConstraintValues: 1 to 5 objects; columns: length 2 to 6 (Driess, Ha, Toussaint 2020, Table I)."""


@dataclass(frozen=True)
class TableOneOptions:
    """Count the sequences of the paper's Table I; there is nothing to choose."""


def run(arguments: list[str]) -> int:
    """Count all 25 cells, print them beside the paper's; exit code 0 when all agree."""
    tyro.cli(TableOneOptions, prog="python -m dvr_jax.bench table1", args=arguments)
    begin = time.monotonic()
    right = 0
    print("objects   length 2        3        4         5          6")
    for row, published in enumerate(TABLE_ONE, start=1):
        names = [f"object{i}" for i in range(row)]
        counts = count_sequences(ground_actions(names, names[0]), 6)
        cells = [counts[length] for length in range(2, 7)]
        marks = ["" if count == paper else f" (paper {paper:,})" for count, paper in zip(cells, published, strict=True)]
        right += marks.count("")
        print(f"{row:>7} " + " ".join(f"{count:>10,}{mark}" for count, mark in zip(cells, marks, strict=True)))
    print(f"{right} of 25 cells as in the paper, {time.monotonic() - begin:.2f} s")
    return 0 if right == 25 else 1
