"""A search in progress: it measures times, computes bounds of nodes, tries paths of leaves, and ends with an outcome.

A *leaf* is a node whose sequence reaches the goal. A `Steps[X]` is a generator that yields requests for numerical work
and returns an X at its end (`dvr_jax.search.work`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from dvr_jax.nlp.problem import Variables
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import PATH_STARTS
from dvr_jax.search.shortening import shorter_leaves
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.solver.state import Termination

Accept = Callable[[Node, NlpSolution], bool]
"""Function of a node and a feasible path of it that returns whether the independent check accepts the path."""

Progress = Callable[[str], None]
"""Function that is called with one line of text about the progress of a search."""


@dataclass(frozen=True, slots=True)
class LongerSearch:
    """A search of longer sequences that ended without a verdict on all of them."""

    k_max: int
    """Largest number of actions of these sequences."""

    seconds: float
    """How long they were searched [s]."""


@dataclass(slots=True)
class Outcome:
    """How a search ended."""

    status: PlanStatus
    """Whether the search found a solution, and if not, why it ended."""

    node: Node | None = None
    """Node of the sequence that solves the scene; None without a solution."""

    path: NlpSolution | None = None
    """Solution of the sequence's path NLP; None without a solution."""

    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent on each bound [s]."""

    is_complete: bool = True
    """False if the time was over before it was known whether a shorter solution exists, where this was asked."""

    longer: LongerSearch | None = None
    """The search of sequences of more than `k_max` actions, where one was made and not completed."""


class SearchSession:
    """One search over a tree: it computes bounds and tries paths, and measures the time of each stage."""

    def __init__(
        self,
        tree: SequenceTree,
        accept: Accept,
        progress: Progress,
        termination: Termination = Termination.FEASIBLE,
    ) -> None:
        """Begin a search.

        Args:
            tree: Tree of the scene's sequences.
            accept: Function that returns whether the independent check accepts a feasible path.
            progress: Function that is called with lines of text about the progress.
            termination: Whether paths are optimized further once they are feasible.
        """
        self.tree = tree
        self.accept = accept
        self.progress = progress
        self.termination = termination
        self.relaxes_first = False
        """Whether nothing is judged twice if the relaxation shows that the scene has no solution."""

        stages = ("image", "network", "relaxation", "pose", "sequence", "path", "optimum")
        self.seconds = dict.fromkeys(stages, 0.0)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Return a context manager that adds the time spent inside it to the time of a stage."""
        begin = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] += time.monotonic() - begin

    def arrange(self, leaves: list[Node]) -> list[Node]:
        """Return leaves of one length in the order in which they are judged; a subclass may override this order."""
        return leaves

    def judge_scene(self) -> Steps[bool]:
        """Compute the relaxation, and return whether it allows a solution of at most `k_max` actions."""
        with self.timed("relaxation"):
            return (yield from self.tree.judge_scene())

    def judge_sequences(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Compute the sequence bound of nodes and return the nodes that pass."""
        with self.timed("sequence"):
            yield from self.tree.judge_sequences(nodes)
        return [node for node in nodes if node.feasible]

    def judge_poses(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Judge the windows and then the pose bound of nodes, and return the nodes that pass."""
        # A chain of one or two actions costs no more than its window, so only longer chains have their windows judged.
        with self.timed("relaxation"):
            verdicts = yield from self.tree.judge_windows(nodes, least=3)
        left = [node for node, verdict in zip(nodes, verdicts, strict=True) if verdict]
        with self.timed("pose"):
            verdicts = yield from self.tree.judge_poses(left)
        return [node for node, verdict in zip(left, verdicts, strict=True) if verdict]

    def judge_children(self, nodes: list[Node]) -> Steps[list[Node]]:
        """Judge the windows and then the sequence bound of children of feasible nodes; return those that pass."""
        with self.timed("relaxation"):
            verdicts = yield from self.tree.judge_windows(nodes)
        left = [node for node, verdict in zip(nodes, verdicts, strict=True) if verdict]
        return (yield from self.judge_sequences(left))

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Compute the sequence bound of all prefixes of leaves, the short ones first, and retry the refuted ones once.

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
            yield from self.judge_sequences([node for node in prefixes if node.feasible is None])
            refuted = [node for node in prefixes if node.deserves_second_look]
            if self.relaxes_first and refuted and not (yield from self.judge_scene()):
                return []
            with self.timed("sequence"):
                yield from self.tree.retry_refuted(refuted)
        return [leaf for leaf in leaves if leaf.feasible]

    def judge_leaves(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Compute the pose bound and then the sequence bound of all prefixes of leaves, the short ones first.

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
        """Try the paths of feasible leaves until one is accepted, those with the least penetrating keyframes first.

        The sequences that leave out some of a leaf's actions are tried before it.
        """
        for node in sorted(leaves, key=_least_violation):
            if node.solved is not None:
                continue
            shorter = yield from self.judge_shorter(node)
            for leaf in [*shorter, node]:
                outcome = yield from self._try_leaf(leaf)
                if outcome is not None:
                    return outcome
        return None

    def _try_leaf(self, leaf: Node) -> Steps[Outcome | None]:
        """Try the path of a leaf, and if it fails, judge the motions of the leaf's windows."""
        if self.tree.is_motion_refuted(leaf):
            return None
        self.tree.counts.verdicts["path"] += 1
        outcome = yield from self.try_path(leaf)
        if outcome is None:
            with self.timed("relaxation"):
                yield from self.tree.judge_motions(leaf)
        return outcome

    def judge_shorter(self, leaf: Node) -> Steps[list[Node]]:
        """Judge the sequences that leave out some actions of a leaf and still reach the goal, in one batch.

        Returns:
            Those that pass and whose paths have not been tried, the shortest first.
        """
        if leaf.depth <= self.tree.relaxation.lower_bound:
            return []
        shorter = [node for node in shorter_leaves(self.tree, leaf) if node.solved is None]
        passed = yield from self.judge_leaves(shorter)
        return sorted(passed, key=lambda node: node.depth)

    def try_path(self, node: Node) -> Steps[Outcome | None]:
        """Solve the path NLP from several keyframe solutions of a leaf, one after the other, until a path is accepted.

        The first starts are good candidates of the leaf's beam. If there are fewer than `PATH_STARTS` of them, the
        keyframe NLP is solved from further candidates.
        """
        node.solved = False
        node.refuted_by = "path"
        node.evidence = None
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
        """Solve the path NLP from each of these keyframes until a path is accepted."""
        for keyframes in starts:
            with self.timed("path"):
                solution = yield from self.tree.solver.solve_path(node, keyframes)
            self._report_path(node, solution)
            if not solution.feasible:
                # `min` returns its first argument if the second is NaN, the initial value of `node.violation`.
                node.violation = min(solution.relative_violation, node.violation)
                continue
            node.refuted_by = "check"
            node.violation = solution.relative_violation
            accepted = yield from self._accepted_path(node, solution)
            if accepted is not None:
                node.solved = True
                node.refuted_by = ""
                self.tree.counts.feasible["path"] += 1
                return Outcome(PlanStatus.SOLVED, node, accepted, self.seconds)
        return None

    def _accepted_path(self, node: Node, path: NlpSolution) -> Steps[NlpSolution | None]:
        """Optimize a feasible path if that is wanted, and return the path that the check accepts, or None.

        If the check refuses the optimal path, the feasible one takes its place.
        """
        if self.termination == Termination.OPTIMAL:
            with self.timed("optimum"):
                optimal = yield from self.tree.solver.optimize_path(node, path)
            if optimal is not path and self.accept(node, optimal):
                return optimal
        return path if self.accept(node, path) else None

    def _report_path(self, node: Node, solution: NlpSolution) -> None:
        """Report whether a path is feasible, or else its largest violation."""
        actions = " ".join(map(str, node.actions))
        verdict = "feasible"
        if not solution.feasible:
            verdict = f"violation {solution.relative_violation:.1f} times the tolerance"
        self.progress(f"path of {actions}: {verdict}")


def _least_violation(leaf: Node) -> float:
    """Return the least sum of penetration depths among a leaf's keyframe candidates [m]."""
    assert leaf.beam is not None
    return float(leaf.beam.violation.min())
