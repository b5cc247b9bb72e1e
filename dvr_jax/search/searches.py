"""Breadth-first search and multi-bound tree search over the sequences of one scene.

Both visit sequences in order of length and stop at the first whose path is accepted; both are complete up to K_max:
they end without a solution only when every sequence has been refuted by some bound (or at the time limit). They
differ in what they compute on the way:

- *breadth-first* takes the sequence bound of every prefix;
- *multi-bound* (Toussaint and Lopes 2017) prunes with the pose bound, whose verdicts many prefixes share, and takes
the sequence bound along the
  sequences that reach the goal only.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from dvr_jax.komo.engine import Solved
from dvr_jax.search.tree import Node, SequenceTree

Accept = Callable[[Node, Solved], bool]
"""Takes a feasible path and says whether the independent check accepts it."""

Progress = Callable[[str], None]
"""Takes a line that says what is going on."""

SOLVED, EXHAUSTED, TIME_LIMIT = "solved", "tree exhausted", "time limit"

REFINEMENTS = 1
"""How often the slices of a path are doubled when the check finds something between them."""

BATCH = 64
"""Prefixes judged between two looks at the clock."""


@dataclass(slots=True)
class Outcome:
    """How a search ended."""

    status: str
    """`SOLVED`, `EXHAUSTED` or `TIME_LIMIT`."""
    node: Node | None
    path: Solved | None
    seconds: dict[str, float] = field(default_factory=dict)
    """Time spent on each bound [s]."""


class _Run:
    """Clock and bookkeeping of one search."""

    def __init__(self, tree: SequenceTree, time_limit: float, accept: Accept, progress: Progress) -> None:
        self.tree, self.accept, self.progress = tree, accept, progress
        self.end = time.monotonic() + time_limit
        self.seconds = {"pose": 0.0, "sequence": 0.0, "path": 0.0}

    def out_of_time(self) -> bool:
        return time.monotonic() > self.end

    def timed(self, bound: str, work: Callable[[], object]) -> object:
        begin = time.monotonic()
        try:
            return work()
        finally:
            self.seconds[bound] += time.monotonic() - begin

    def judge_sequences(self, nodes: list[Node]) -> None:
        self.timed("sequence", lambda: self.tree.judge_sequences(nodes))

    def judge_poses(self, nodes: list[Node]) -> list[bool]:
        return self.timed("pose", lambda: self.tree.judge_poses(nodes))  # type: ignore[return-value]

    def try_path(self, node: Node) -> Outcome | None:
        attempt = 0
        while not self.out_of_time():
            solved = self.timed("path", lambda: self.tree.solve_path(node, attempt))  # noqa: B023
            if solved is None:
                return None
            assert isinstance(solved, Solved)
            words = "feasible" if solved.feasible else f"violation {solved.ratio:.1f} times the tolerance"
            self.progress(f"path of {_words(node)}: {words}")
            for _ in range(REFINEMENTS + 1):
                if not solved.feasible:
                    break
                if self.accept(node, solved):
                    self.tree.counts.feasible["path"] += 1
                    return Outcome(SOLVED, node, solved, self.seconds)
                coarse = solved
                solved = self.timed("path", lambda: self.tree.refine_path(node, coarse))  # noqa: B023
                assert isinstance(solved, Solved)
            attempt += 1
        return None

    def try_leaves(self, leaves: list[Node]) -> Outcome | None:
        """Paths of feasible leaves, best keyframes first."""
        for node in sorted(leaves, key=lambda leaf: float(leaf.particles.violation.min())):  # type: ignore[union-attr]
            self.tree.counts.verdicts["path"] += 1
            outcome = self.try_path(node)
            if outcome is not None:
                return outcome
        return None

    def ended(self) -> Outcome:
        return Outcome(TIME_LIMIT if self.out_of_time() else EXHAUSTED, None, None, self.seconds)


def _words(node: Node) -> str:
    return " ".join(str(action) for action in node.actions)


def _batches(nodes: list[Node]) -> list[list[Node]]:
    return [nodes[i : i + BATCH] for i in range(0, len(nodes), BATCH)]


def breadth_first(tree: SequenceTree, time_limit: float, accept: Accept, progress: Progress) -> Outcome:
    """Plain breadth-first search: the sequence bound of every prefix, level by level."""
    run = _Run(tree, time_limit, accept, progress)
    level = [tree.root]
    for depth in range(1, tree.k_max + 1):
        children = [child for node in level for child in tree.expand(node)]
        progress(f"length {depth}: {len(children)} prefixes")
        for batch in _batches(children):
            if run.out_of_time():
                return run.ended()
            run.judge_sequences(batch)
            outcome = run.try_leaves([node for node in batch if node.reaches_goal and node.feasible])
            if outcome is not None:
                return outcome
        level = [node for node in children if node.feasible and not node.reaches_goal]
    return run.ended()


def multi_bound(tree: SequenceTree, time_limit: float, accept: Accept, progress: Progress) -> Outcome:
    """Multi-bound tree search: the pose bound prunes, the sequence bound is taken along goal-reaching sequences."""
    run = _Run(tree, time_limit, accept, progress)
    level = [tree.root]
    for depth in range(1, tree.k_max + 1):
        children = [child for node in level if node.feasible is not False for child in tree.expand(node)]
        kept: list[Node] = []
        for batch in _batches(children):
            if run.out_of_time():
                return run.ended()
            verdicts = run.judge_poses(batch)
            kept += [node for node, verdict in zip(batch, verdicts, strict=True) if verdict]
        progress(f"length {depth}: {len(children)} prefixes, {len(kept)} pass the pose bound")
        for batch in _batches([node for node in kept if node.reaches_goal]):
            if run.out_of_time():
                return run.ended()
            outcome = run.try_leaves(_judge_lines(run, batch))
            if outcome is not None:
                return outcome
        level = [node for node in kept if not node.reaches_goal]
    return run.ended()


def _judge_lines(run: _Run, leaves: list[Node]) -> list[Node]:
    """Sequence bound of leaves, along their prefixes: the feasible ones."""
    for depth in range(1, max(leaf.depth for leaf in leaves) + 1):
        prefixes: dict[int, Node] = {}
        for leaf in leaves:
            node: Node | None = leaf
            while node is not None and node.depth > depth:
                node = node.parent
            assert node is not None and node.parent is not None
            if node.feasible is None and node.parent.feasible is False:
                node.feasible = False
            if node.feasible is None:
                prefixes[id(node)] = node
        run.judge_sequences(list(prefixes.values()))
    return [leaf for leaf in leaves if leaf.feasible]


SEARCHES: dict[str, Callable[[SequenceTree, float, Accept, Progress], Outcome]] = {
    "mbts": multi_bound,
    "bfs": breadth_first,
}
"""Searches by the name that the command line gives them."""
