"""The numerical work behind the bounds of one scene's tree: samples of keyframes, keyframe NLPs, path NLPs. What
asks for work (`dvr_jax.search.work`) is a generator."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from dvr_jax.nlp.problem import ABSENT, Variables
from dvr_jax.nlp.transcription import transcribe, transcribe_switch
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.work import Extend, Solve, Steps
from dvr_jax.seeds.initial_paths import keyframe_start, path_problem, path_start
from dvr_jax.seeds.keyframe_beam import BEAM_WIDTH, UNREACHABLE, KeyframeBeam, held_prefix
from dvr_jax.solver.augmented_lagrangian import Settings
from dvr_jax.solver.engine import NlpSolution, adopt

CERTIFIED_PENETRATION = 5e-4
"""A particle whose penetrations sum up to less proves its prefix' keyframes feasible: it meets all else exactly [m]."""

FURTHER_STARTS = (5, 10)
"""Ranks of the beam that the keyframe NLP is started from where the best one fails: neighbours in rank often are
siblings, and these two find all but one of what the fifteen others find in 1,100 prefixes."""

PATH_STARTS = 4
"""Keyframes that the path NLP is started from, one after the other."""

GOOD = 0.01
"""KeyframeBeam whose penetrations sum up to less are good enough to start a path from [m]."""

BATCH = 64
"""Prefixes judged between two looks at the clock."""

_Item = TypeVar("_Item")


class OutOfTime(Exception):
    """The tree's deadline has passed."""


@dataclass(slots=True)
class Counts:
    """How many NLPs were solved and verdicts taken, by bound."""

    nlps: Counter[str] = field(default_factory=Counter)
    """NLP solves (starts count singly): "pose", "sequence", "path"."""
    verdicts: Counter[str] = field(default_factory=Counter)
    """Prefixes judged, by bound, those that a particle proved feasible or the scene refuted included; "leaf": sequences
    that reach the goal and were considered."""
    feasible: Counter[str] = field(default_factory=Counter)
    """Of these, feasible."""


class NodeSolver:
    """Samples and NLPs of the nodes of one scene, and how many there were."""

    def __init__(self, scene: Scene, settings: Settings, deadline: float) -> None:
        self.scene, self.settings, self.deadline = scene, settings, deadline
        self.counts = Counts()

    def look_at_the_clock(self) -> None:
        """Raise OutOfTime past the deadline."""
        if time.monotonic() > self.deadline:
            raise OutOfTime

    def sample(self, nodes: list[Node], ignored: list[tuple[str, ...]], seed: int) -> Steps[list[Node]]:
        """KeyframeBeam of nodes, each with some objects left out; those nodes that no particle proves feasible."""
        for first in range(0, len(nodes), BATCH):
            self.look_at_the_clock()
            part, names = nodes[first : first + BATCH], ignored[first : first + BATCH]
            problems = [
                node.problem or transcribe(self.scene, node.actions, left_out)
                for node, left_out in zip(part, names, strict=True)
            ]
            parents = [self._parent_beam(*args) for args in zip(part, names, strict=True)]
            extended = yield Extend(parents, problems, seed)
            for node, problem, beam in zip(part, problems, extended, strict=True):
                node.problem, node.beam = problem, beam
                node.feasible = bool(beam.violation.min() <= CERTIFIED_PENETRATION)
        return [node for node in nodes if not node.feasible]

    def solve(self, nodes: list[Node], bound: str) -> Steps[None]:
        """Keyframe NLPs of nodes that no particle proved feasible: all from their best particle, then those that failed
        from the beam of `FURTHER_STARTS`."""
        for group in _by_depth(nodes):
            failed = yield from self._solve_from(group, [0], bound)
            # Where inverse kinematics found nothing at all, more starts are no better than one.
            reached = [node for node in failed if _is_reached(node)]
            yield from self._solve_from(reached, FURTHER_STARTS, bound)
            for node in group:
                if not node.feasible:
                    node.refute(bound, node.violation)

    def _solve_from(self, nodes: list[Node], ranks: Sequence[int], bound: str) -> Steps[list[Node]]:
        """Keyframe NLPs of nodes of one depth from their beam of these ranks; those nodes that failed."""
        for first in range(0, len(nodes), BATCH):
            self.look_at_the_clock()
            lanes = [(node, rank) for node in nodes[first : first + BATCH] for rank in ranks]
            starts = [keyframe_start(node.beam, rank, node.depth) for node, rank in lanes]  # type: ignore[arg-type]
            solutions = yield Solve([node.problem for node, _ in lanes], starts, self.settings)  # type: ignore[misc]
            self.counts.nlps[bound] += len(lanes)
            for (node, _), solution in zip(lanes, solutions, strict=True):
                if not solution.feasible:
                    # NaN is no smaller than anything.
                    node.violation = min(solution.ratio, node.violation)
                else:
                    node.feasible = True
                    node.beam = adopt(node.beam, node.problem, solution)  # type: ignore[arg-type]
        return [node for node in nodes if not node.feasible]

    def solve_from_all(self, nodes: list[Node], bound: str) -> Steps[None]:
        """Keyframe NLPs of nodes from every particle."""
        for group in _by_depth(nodes):
            yield from self._solve_from([node for node in group if _is_reached(node)], range(BEAM_WIDTH), bound)

    def free_grasp(self, node: Node, root: Node, ignored: Sequence[str], seed: int) -> None:
        """Give a node of a grasp and the next action on the same object the problem of the latter alone, and a parent
        whose beam hold the object anyhow."""
        assert root.beam is not None
        grasp, action = node.actions
        node.problem = transcribe_switch(self.scene, grasp, action, ignored)
        node.parent = Node((grasp,), 0, root, reaches_goal=False, feasible=True)
        node.parent.beam = held_prefix(node.problem, root.beam.q.shape[1], seed)

    def _parent_beam(self, node: Node, ignored: tuple[str, ...]) -> KeyframeBeam:
        assert node.parent is not None and node.parent.beam is not None
        if node.parent.depth == 0 and ignored:
            return self.leave_out(node.parent.beam, frozenset(ignored))
        return node.parent.beam

    def leave_out(self, beam: KeyframeBeam | None, ignored: frozenset[str]) -> KeyframeBeam:
        """KeyframeBeam with some objects left out of the world."""
        assert beam is not None
        kind = beam.kind.copy()
        kind[[self.scene.object_index(name) for name in ignored]] = ABSENT
        return beam._replace(kind=kind)

    def path_keyframes(self, node: Node) -> list[Variables]:
        """Keyframes that the path of a node that passed the sequence bound may start from: good beam, at least one
        and at most so many as `PATH_STARTS`."""
        assert node.beam is not None and node.feasible
        # Spread over the beam: neighbours in rank often are siblings.
        good = int((node.beam.violation <= GOOD).sum())
        ranks = _spread(range(good), PATH_STARTS)
        return [keyframe_start(node.beam, rank, node.depth) for rank in ranks]

    def more_keyframes(self, node: Node, most: int) -> Steps[list[Variables]]:
        """At most so many further keyframes: solutions of the keyframe NLP from beam that are not good."""
        assert node.problem is not None and node.beam is not None
        self.look_at_the_clock()
        violation = node.beam.violation
        ranks = range(int((violation <= GOOD).sum()), int((violation < UNREACHABLE).sum()))
        starts = [keyframe_start(node.beam, rank, node.depth) for rank in ranks]
        if not starts:
            return []
        solutions = yield Solve([node.problem] * len(starts), starts, self.settings)
        self.counts.nlps["sequence"] += len(starts)
        return _spread([Variables(found.q, found.m) for found in solutions if found.feasible], most)

    def solve_path(self, node: Node, keyframes: Variables | None = None) -> Steps[NlpSolution]:
        """Path of a node that passed the sequence bound, from keyframes of its own, if not from its best."""
        assert node.problem is not None
        self.look_at_the_clock()
        start = path_start(node.problem, keyframes or self.path_keyframes(node)[0])
        self.counts.nlps["path"] += 1
        solved = yield Solve([path_problem(node.problem, start)], [start], self.settings)
        return solved[0]


def _spread(items: Sequence[_Item], most: int) -> list[_Item]:
    """At most so many of the items, the first and others at equal distances."""
    count = min(most, len(items))
    return [items[i * (len(items) // count)] for i in range(count)]


def _by_depth(nodes: Sequence[Node]) -> list[list[Node]]:
    """Nodes in groups of one depth: what can share a batch of NLPs."""
    groups: dict[int, list[Node]] = {}
    for node in nodes:
        groups.setdefault(node.depth, []).append(node)
    return list(groups.values())


def _is_reached(node: Node) -> bool:
    """Whether inverse kinematics found all postures of some particle."""
    return node.beam is not None and bool(node.beam.violation.min() < UNREACHABLE)
