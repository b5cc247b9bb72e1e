"""What the paper reports (Driess, Ha, Toussaint, RSS 2020): the one place that the benchmarks compare with.

The paper's machine was an Intel Xeon W-2145 at 3.7 GHz.
"""

from __future__ import annotations

from collections.abc import Mapping

LENGTHS = (2, 3, 4, 5, 6)
"""Numbers of actions of the solutions that the paper's figures and tables are over."""

TABLE_ONE: Mapping[int, tuple[int, ...]] = {
    1: (8, 32, 192, 1_024, 5_632),
    2: (8, 96, 704, 6_400, 51_200),
    3: (8, 160, 1_216, 15_872, 145_920),
    4: (8, 224, 1_728, 29_440, 289_792),
    5: (8, 288, 2_240, 47_104, 482_816),
}
"""Table I: number of sequences that reach the goal, by number of objects, for each of `LENGTHS`."""

FEASIBLE_SCENES = 2_705
"""Feasible ones of the 3,000 test scenes."""

UNSOLVED: Mapping[str, int] = {"dvr": 3, "classifier": 22, "mbts": 132}
"""Feasible scenes that each search left unsolved: the network, the recurrent classifier, LGP tree search."""

MEDIAN_SECONDS: Mapping[int, str] = {6: "about 2.3"}
"""Median total time with the network [s], as far as the paper gives it in words (the rest is in figure 5)."""

MEDIAN_PATH_NLPS: Mapping[int, str] = {2: "1", 3: "1", 4: "1", 5: "below 2", 6: "below 2"}
"""Median number of NLPs solved with the network."""

SPEED_UP: Mapping[int, int] = {4: 46, 5: 100, 6: 705}
"""Median speed-up of the network over LGP tree search, over scenes where both found the same length."""

DATASET: Mapping[str, int] = {
    "scenes": 30_000,
    "scenes with a solution": 25_736,
    "feasible sequences": 102_566,
    "infeasible sequences": 2_741_573,
    "targets 1": 1_803_684,
    "targets 0": 7_926_696,
}
"""The training data."""


def table_one_cell(objects: int, length: int) -> str:
    """Name the metric of one cell of Table I.

    Args:
        objects: number of objects of the scene.
        length: number of actions of the sequences.

    Returns:
        The name.
    """
    return f"sequences of {length} actions, objects: {objects}"
