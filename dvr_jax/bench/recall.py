"""Recall of the solver against an oracle of many random starts, on a frozen set of problems.

`python -m dvr_jax.bench oracle` has drawn the problems and found out which of them are feasible; this benchmark solves
them as a search does.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import tyro

from dvr_jax.bench.metrics import save_metrics
from dvr_jax.bench.oracle import random_keyframes
from dvr_jax.bench.problems import PROBLEMS, read_problems
from dvr_jax.bench.recall_metrics import (
    ALL_LENGTHS,
    KINDS,
    Counts,
    count_pairs,
    to_metrics,
)
from dvr_jax.checker import CheckReport, describe
from dvr_jax.checker.replay import check_motion
from dvr_jax.logic import Action
from dvr_jax.planning.feasibility import motion_of
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_together
from dvr_jax.solver.lane_pool import NlpSolution

__all__ = ["PROBLEMS", "judge_prefix", "random_keyframes", "read_problems", "run"]


@dataclass(frozen=True)
class RecallOptions:
    """Solve the oracle's problems as a search does, and compare the verdicts."""

    problems: Path | None = None
    """What `python -m dvr_jax.bench oracle` wrote; by default the problems of the package."""
    out: Path | None = None
    """JSON file to write the counts to."""


def run(arguments: list[str]) -> int:
    """Print recall by kind and length."""
    options = tyro.cli(RecallOptions, prog="python -m dvr_jax.bench recall", args=arguments)
    problems = list(read_problems(options.problems))

    with jax.enable_x64(True):
        judged = run_together(
            [_judge(scene, actions, row["kind"] == "path") for scene, actions, row in problems]
        )
        verdicts = dict(judged)

    pairs: dict[tuple[str, int], list[tuple[bool, bool]]] = {}
    checked: list[bool] = []
    for number, (_, actions, row) in enumerate(problems):
        feasible, report = verdicts[number]
        title = f"{row['kind']} {number}: {' '.join(map(str, actions))}"

        if report is not None:
            checked.append(report.passed)
            if not report.passed:
                print(f"  {title}: {describe(report)}", file=sys.stderr)
        if feasible != row["feasible"]:
            print(f"  {title}: oracle {row['feasible']}, ours {feasible}", file=sys.stderr)

        key = (str(row["kind"]), int(row["length"]))
        pairs.setdefault(key, []).append((bool(row["feasible"]), feasible))

    table = tabulate(pairs)
    _print_table(table, checked)
    if options.out is not None:
        save_metrics(options.out, "recall", to_metrics(table, checked))
    return 0


def judge_prefix(
    tree: SequenceTree, actions: Sequence[Action], second_look: bool = False
) -> Steps[Node]:
    """Judge a sequence by the sequence bound of each of its prefixes.

    Args:
        tree: the tree of the scene's sequences.
        actions: the sequence.
        second_look: also take the second look that searches take at a refuted sequence that reaches the goal.

    Returns:
        The node of the sequence. A node below an infeasible one is infeasible and is not judged.
    """
    node = tree.root
    for length in range(1, len(actions) + 1):
        child = Node(tuple(actions[:length]), 0, node, reaches_goal=False)
        if node.feasible:
            yield from tree.judge_sequences([child])
            if second_look:
                yield from tree.retry_refuted([child])
        else:
            child.feasible = False
        node = child
    return node


def _judge(
    scene: Scene, actions: Sequence[Action], is_path: bool
) -> Steps[tuple[bool, CheckReport | None]]:
    """Our verdict on a problem, and what the check says of its first feasible path (None: there is no path)."""
    tree = SequenceTree(scene, k_max=6)
    node = yield from judge_prefix(tree, actions, second_look=True)
    if not is_path:
        return bool(node.feasible), None
    if not node.feasible:
        return False, None

    reports: list[CheckReport] = []

    def accept(leaf: Node, path: NlpSolution) -> bool:
        reports.append(check_motion(scene, leaf.actions, motion_of(scene, leaf, path)))
        return True

    found = yield from SearchSession(tree, accept, lambda line: None).try_path(node)
    return found is not None, reports[0] if reports else None


def tabulate(
    pairs: dict[tuple[str, int], list[tuple[bool, bool]]],
) -> list[tuple[str, int | str, Counts]]:
    """Count the verdicts of each kind by length and over all lengths.

    Args:
        pairs: verdicts of the oracle and of ours, by kind and length of the problem.

    Returns:
        Kind, length (or "all") and counts of each line.
    """
    table: list[tuple[str, int | str, Counts]] = []
    for kind in KINDS:
        of_kind = {
            length: verdicts for (other, length), verdicts in sorted(pairs.items()) if other == kind
        }
        for length, verdicts in of_kind.items():
            table.append((kind, length, count_pairs(verdicts)))
        if of_kind:
            together = [pair for verdicts in of_kind.values() for pair in verdicts]
            table.append((kind, ALL_LENGTHS, count_pairs(together)))
    return table


def _print_table(table: Sequence[tuple[str, int | str, Counts]], checked: Sequence[bool]) -> None:
    print("            problems   feasible: oracle   ours   both   recall   found by ours alone")
    for kind, length, counts in table:
        recall = "      -" if counts.recall is None else f"{counts.recall:7.1%}"
        print(
            f"{f'{kind} {length}':<14} {counts.problems:>6} {counts.oracle:>18} {counts.ours:>6} {counts.both:>6}  "
            f"{recall} {counts.ours - counts.both:>21}"
        )
    if checked:
        print(f"feasible paths that pass the independent check: {sum(checked)} of {len(checked)}")
