"""Breadth-first search and multi-bound tree search over the sequences of one scene.

Both visit sequences in order of length and stop at the first whose path is accepted; both are complete up to K_max:
they end without a solution only when every sequence has been refuted by some bound (or at the time limit). Within a
length, sequences that reach the goal come first. They differ in what they compute on the way:

- *breadth-first* takes the sequence bound of every prefix;
- *multi-bound* (Toussaint and Lopes 2017) prunes with the pose bound, whose verdicts many prefixes share, and takes
  the sequence bound along the sequences that reach the goal only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from dvr_jax.komo.engine import Solved
from dvr_jax.search.tree import Node, OutOfTime, SequenceTree
from dvr_jax.search.work import Steps, run_alone

Accept = Callable[[Node, Solved], bool]
"""Takes a feasible path and says whether the independent check accepts it."""

Progress = Callable[[str], None]
"""Takes a line that says what is going on."""

SOLVED, EXHAUSTED, TIME_LIMIT = "solved", "tree exhausted", "time limit"

REFINEMENTS = 1
"""How often the slices of a path are doubled when the check finds something between them."""

BATCH = 64
"""Leaves judged before paths of the feasible ones are tried."""

EAGER = 3
"""Length up to which multi-bound search takes the pose bound of all prefixes."""


_Judge = Callable[[list[Node]], Steps[list[Node]]]


@dataclass(slots=True)
class Outcome:
    """How a search ended."""

    status: str
    """`SOLVED`, `EXHAUSTED` or `TIME_LIMIT`."""
    node: Node | None
    path: Solved | None
    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent on each bound [s]."""


class Run:
    """Clock and bookkeeping of one search."""

    def __init__(self, tree: SequenceTree, accept: Accept, progress: Progress) -> None:
        self.tree, self.accept, self.progress = tree, accept, progress
        self.seconds = {"pose": 0.0, "sequence": 0.0, "path": 0.0}

    @contextmanager
    def timed(self, bound: str) -> Iterator[None]:
        """Add the time spent inside to that of a bound."""
        begin = time.monotonic()
        try:
            yield
        finally:
            self.seconds[bound] += time.monotonic() - begin

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

    def judge_lines(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Sequence bound of leaves, along their prefixes: those that pass."""
        for depth in range(1, max((leaf.depth for leaf in leaves), default=0) + 1):
            prefixes = dict.fromkeys(leaf.ancestor(depth) for leaf in leaves)
            for node in prefixes:
                assert node.parent is not None
                if node.feasible is None and node.parent.feasible is False:
                    node.feasible = False
            yield from self.judge_sequences([node for node in prefixes if node.feasible is None])
        return [leaf for leaf in leaves if leaf.feasible]

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        """Paths of feasible leaves, best keyframes first."""
        for node in sorted(leaves, key=lambda leaf: float(leaf.particles.violation.min())):  # type: ignore[union-attr]
            self.tree.counts.verdicts["path"] += 1
            outcome = yield from self.try_path(node)
            if outcome is not None:
                return outcome
        return None

    def try_path(self, node: Node) -> Steps[Outcome | None]:
        """Path from each of the leaf's keyframes in turn, until one is accepted."""
        node.solved, node.refuted_by, node.violation = False, "path", math.nan
        for attempt in range(self.tree.path_attempts(node)):
            with self.timed("path"):
                solved = yield from self.tree.solve_path(node, attempt)
            words = "feasible" if solved.feasible else f"violation {solved.ratio:.1f} times the tolerance"
            self.progress(f"path of {' '.join(str(action) for action in node.actions)}: {words}")
            for refinement in range(REFINEMENTS + 1):
                if not solved.feasible:
                    node.violation = min(solved.ratio, node.violation)  # NaN is no smaller than anything
                    break
                node.refuted_by = "check"
                if self.accept(node, solved):
                    node.solved, node.refuted_by, node.violation = True, "", solved.ratio
                    self.tree.counts.feasible["path"] += 1
                    return Outcome(SOLVED, node, solved, self.seconds)
                if refinement < REFINEMENTS:
                    with self.timed("path"):
                        solved = yield from self.tree.refine_path(node, solved)
        return None


def _batches(nodes: list[Node]) -> list[list[Node]]:
    return [nodes[i : i + BATCH] for i in range(0, len(nodes), BATCH)]


def _search(run: Run, judge_leaves: _Judge, judge: _Judge) -> Steps[Outcome]:
    """Level by level: ``judge_leaves`` gives the leaves whose paths are tried, ``judge`` the prefixes to go on from."""
    level = [run.tree.root]
    for depth in range(1, run.tree.k_max + 1):
        children = [child for node in level if node.feasible is not False for child in run.tree.expand(node)]
        leaves = [node for node in children if node.reaches_goal]
        run.progress(f"length {depth}: {len(children)} prefixes, {len(leaves)} reach the goal")
        for batch in _batches(leaves):
            feasible = yield from judge_leaves(batch)
            outcome = yield from run.try_leaves(feasible)
            if outcome is not None:
                return outcome
        if depth < run.tree.k_max:
            level = yield from judge([node for node in children if not node.reaches_goal])
    return Outcome(EXHAUSTED, None, None, run.seconds)


def breadth_first(run: Run) -> Steps[Outcome]:
    """Plain breadth-first search: the sequence bound of every prefix, level by level."""
    return (yield from _search(run, run.judge_sequences, run.judge_sequences))


def multi_bound(run: Run) -> Steps[Outcome]:
    """Multi-bound tree search: the pose bound prunes, the sequence bound is taken along goal-reaching sequences.

    Pose bounds of short prefixes are taken at once; those of longer ones, which are many, only along the sequences
    whose turn it is, or where a shorter one has refuted them already."""

    def judge(nodes: list[Node]) -> Steps[list[Node]]:
        if nodes and nodes[0].depth <= EAGER:
            return (yield from run.judge_poses(nodes))
        return [node for node in nodes if run.tree.recall_pose(node)]

    def judge_leaves(leaves: list[Node]) -> Steps[list[Node]]:
        for depth in range(1, max(leaf.depth for leaf in leaves) + 1):
            prefixes = dict.fromkeys(leaf.ancestor(depth) for leaf in leaves)
            passed = set((yield from run.judge_poses(list(prefixes))))
            leaves = [leaf for leaf in leaves if leaf.ancestor(depth) in passed]
        return (yield from run.judge_lines(leaves))

    return (yield from _search(run, judge_leaves, judge))


SEARCHES: dict[str, Callable[[Run], Steps[Outcome]]] = {"mbts": multi_bound, "bfs": breadth_first}
"""Searches by the name that the command line gives them."""


def search(name: str, tree: SequenceTree, accept: Accept, progress: Progress) -> Outcome:
    """Run a search until it finds something, has seen everything, or the tree's time is over."""
    run = Run(tree, accept, progress)
    try:
        return run_alone(SEARCHES[name](run))
    except OutOfTime:
        return Outcome(TIME_LIMIT, None, None, run.seconds)
