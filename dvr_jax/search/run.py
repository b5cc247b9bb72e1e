"""One search: its clock, its way to take bounds and to try paths, and how it ended."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from dvr_jax.nlp.problem import Variables
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import PATH_STARTS
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps
from dvr_jax.solver.engine import NlpSolution

Accept = Callable[[Node, NlpSolution], bool]
"""Takes a feasible path and says whether the independent check accepts it."""

Progress = Callable[[str], None]
"""Takes a line that says what is going on."""


@dataclass(slots=True)
class Outcome:
    """How a search ended."""

    status: PlanStatus
    node: Node | None
    path: NlpSolution | None
    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent on each bound [s]."""


class Run:
    """Clock and bookkeeping of one search."""

    def __init__(self, tree: SequenceTree, accept: Accept, progress: Progress) -> None:
        self.tree, self.accept, self.progress = tree, accept, progress
        self.seconds = {"image": 0.0, "network": 0.0, "pose": 0.0, "sequence": 0.0, "path": 0.0}

    @contextmanager
    def timed(self, bound: str) -> Iterator[None]:
        """Add the time spent inside to that of a bound."""
        begin = time.monotonic()
        try:
            yield
        finally:
            self.seconds[bound] += time.monotonic() - begin

    def arrange(self, leaves: list[Node]) -> list[Node]:
        """Leaves of one length in the order in which they shall be judged."""
        return leaves

    def judge_sequences(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Those that pass."""
        with self.timed("sequence"):
            yield from self.tree.judge_sequences(nodes)
        return [node for node in nodes if node.feasible]

    def judge_poses(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Those that pass."""
        with self.timed("pose"):
            verdicts = yield from self.tree.judge_poses(nodes)
        return [node for node, verdict in zip(nodes, verdicts, strict=True) if verdict]

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Sequence bound of leaves, along their prefixes, with a second look at what it refutes: those that pass."""
        for depth in range(1, max((leaf.depth for leaf in leaves), default=0) + 1):
            prefixes = dict.fromkeys(leaf.ancestor(depth) for leaf in leaves)
            for node in prefixes:
                assert node.parent is not None
                if node.feasible is None and node.parent.feasible is False:
                    node.feasible = False
            unjudged = [node for node in prefixes if node.feasible is None]
            yield from self.judge_sequences(unjudged)
            with self.timed("sequence"):
                yield from self.tree.retry_refuted(unjudged)
        return [leaf for leaf in leaves if leaf.feasible]

    def judge_leaves(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Pose and sequence bounds of leaves, along their prefixes: those that pass."""
        for depth in range(1, max((leaf.depth for leaf in leaves), default=0) + 1):
            prefixes = dict.fromkeys(leaf.ancestor(depth) for leaf in leaves)
            passed = set((yield from self.judge_poses(list(prefixes))))
            leaves = [leaf for leaf in leaves if leaf.ancestor(depth) in passed]
        return (yield from self.judge_prefix_chains(leaves))

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        """Paths of feasible leaves, best keyframes first."""
        for node in sorted(leaves, key=lambda leaf: float(leaf.beam.violation.min())):  # type: ignore[union-attr]
            self.tree.counts.verdicts["path"] += 1
            outcome = yield from self.try_path(node)
            if outcome is not None:
                return outcome
        return None

    def try_path(self, node: Node) -> Steps[Outcome | None]:
        """Path from each of the leaf's keyframes in turn, and then from further ones, until one is accepted."""
        node.solved, node.refuted_by, node.violation = False, "path", math.nan
        starts = self.tree.solver.path_keyframes(node)
        outcome = yield from self._try_path_from(node, starts)
        if outcome is None and len(starts) < PATH_STARTS:
            with self.timed("sequence"):
                further = yield from self.tree.solver.more_keyframes(node, PATH_STARTS - len(starts))
            outcome = yield from self._try_path_from(node, further)
        return outcome

    def _try_path_from(self, node: Node, starts: Sequence[Variables]) -> Steps[Outcome | None]:
        for keyframes in starts:
            with self.timed("path"):
                solved = yield from self.tree.solver.solve_path(node, keyframes)
            words = "feasible" if solved.feasible else f"violation {solved.ratio:.1f} times the tolerance"
            self.progress(f"path of {' '.join(str(action) for action in node.actions)}: {words}")
            if not solved.feasible:
                node.violation = min(solved.ratio, node.violation)  # NaN is no smaller than anything
                continue
            node.refuted_by, node.violation = "check", solved.ratio
            if self.accept(node, solved):
                node.solved, node.refuted_by = True, ""
                self.tree.counts.feasible["path"] += 1
                return Outcome(PlanStatus.SOLVED, node, solved, self.seconds)
        return None
