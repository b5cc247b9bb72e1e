"""One search under way: its clock, its way to take bounds and to try paths, and how it ended."""

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
from dvr_jax.solver.lane_pool import NlpSolution

Accept = Callable[[Node, NlpSolution], bool]
"""Takes a feasible path and says whether the independent check accepts it."""

Progress = Callable[[str], None]
"""Takes a line that says what is going on."""


@dataclass(slots=True)
class Outcome:
    """How a search ended."""

    status: PlanStatus
    """Whether it found a solution, and if not, why it ended."""

    node: Node | None = None
    """The sequence that was found."""

    path: NlpSolution | None = None
    """Its path."""

    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent on each bound [s]."""


class SearchSession:
    """Clock and bookkeeping of one search."""

    def __init__(self, tree: SequenceTree, accept: Accept, progress: Progress) -> None:
        """Begin a search.

        Args:
            tree: Sequences of the scene.
            accept: Says of a feasible path whether the independent check accepts it.
            progress: Takes lines that say what is going on.
        """
        self.tree = tree
        self.accept = accept
        self.progress = progress
        self.seconds = dict.fromkeys(("image", "network", "pose", "sequence", "path"), 0.0)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to that of a stage."""
        begin = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] += time.monotonic() - begin

    def arrange(self, leaves: list[Node]) -> list[Node]:
        """Leaves of one length in the order in which they are judged."""
        return leaves

    def judge_sequences(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Take the sequence bound of nodes; those that pass."""
        with self.timed("sequence"):
            yield from self.tree.judge_sequences(nodes)
        return [node for node in nodes if node.feasible]

    def judge_poses(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Take the pose bound of nodes; those that pass."""
        with self.timed("pose"):
            verdicts = yield from self.tree.judge_poses(nodes)
        return [node for node, verdict in zip(nodes, verdicts, strict=True) if verdict]

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Take the sequence bound of leaves, along their prefixes, with a second opinion on what it refutes.

        Returns:
            The leaves that pass.
        """
        longest = max((leaf.depth for leaf in leaves), default=0)
        for depth in range(1, longest + 1):
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
        """Take the pose and the sequence bound of leaves, along their prefixes.

        Returns:
            The leaves that pass.
        """
        longest = max((leaf.depth for leaf in leaves), default=0)
        for depth in range(1, longest + 1):
            prefixes = dict.fromkeys(leaf.ancestor(depth) for leaf in leaves)
            passed = set((yield from self.judge_poses(list(prefixes))))
            leaves = [leaf for leaf in leaves if leaf.ancestor(depth) in passed]
        return (yield from self.judge_prefix_chains(leaves))

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        """Try the paths of feasible leaves, best keyframes first, until one is accepted."""
        for node in sorted(leaves, key=_least_violation):
            self.tree.counts.verdicts["path"] += 1
            outcome = yield from self.try_path(node)
            if outcome is not None:
                return outcome
        return None

    def try_path(self, node: Node) -> Steps[Outcome | None]:
        """Try the path from each of the leaf's keyframes in turn, and then from further ones, until one is accepted."""
        node.solved = False
        node.refuted_by = "path"
        node.violation = math.nan
        starts = self.tree.solver.path_keyframes(node)
        outcome = yield from self._try_path_from(node, starts)
        if outcome is None and len(starts) < PATH_STARTS:
            with self.timed("sequence"):
                further = yield from self.tree.solver.more_keyframes(
                    node, PATH_STARTS - len(starts)
                )
            outcome = yield from self._try_path_from(node, further)
        return outcome

    def _try_path_from(self, node: Node, starts: Sequence[Variables]) -> Steps[Outcome | None]:
        for keyframes in starts:
            with self.timed("path"):
                solution = yield from self.tree.solver.solve_path(node, keyframes)
            self._report_path(node, solution)
            if not solution.feasible:
                # NaN is no smaller than anything.
                node.violation = min(solution.relative_violation, node.violation)
                continue
            node.refuted_by = "check"
            node.violation = solution.relative_violation
            if self.accept(node, solution):
                node.solved = True
                node.refuted_by = ""
                self.tree.counts.feasible["path"] += 1
                return Outcome(PlanStatus.SOLVED, node, solution, self.seconds)
        return None

    def _report_path(self, node: Node, solution: NlpSolution) -> None:
        """Say what became of a path."""
        actions = " ".join(map(str, node.actions))
        verdict = "feasible"
        if not solution.feasible:
            verdict = f"violation {solution.relative_violation:.1f} times the tolerance"
        self.progress(f"path of {actions}: {verdict}")


def _least_violation(leaf: Node) -> float:
    """Least sum of penetrations of a leaf's keyframe candidates [m]."""
    assert leaf.beam is not None
    return float(leaf.beam.violation.min())
