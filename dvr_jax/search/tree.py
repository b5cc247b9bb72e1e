"""The tree of action sequences of one scene, and the verdicts of its bounds, each computed once and kept.

Bounds of a node, each a relaxation of the next, so that infeasible under one means infeasible under all that follow
and for all descendants:

- *symbolic*: the goal can be reached within K_max actions; no action is refuted by a constant of the scene;
- *pose*: the keyframes of the actions on one object alone, all other objects that have moved left out;
- *sequence*: the keyframes of the whole prefix;
- *path*: the whole motion of a sequence that reaches the goal.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field

from dvr_jax.komo.engine import (
    Solved,
    adopt,
    extend_prefixes,
    keyframe_start,
    path_problem,
    path_start,
    refined_start,
    solve,
)
from dvr_jax.komo.particles import UNREACHABLE, Particles, empty_prefix
from dvr_jax.komo.problem import ABSENT, Problem
from dvr_jax.komo.solver import Settings
from dvr_jax.komo.transcription import refute, transcribe
from dvr_jax.logic import Action, Grounding, ground_actions
from dvr_jax.scene.types import Scene

WITNESS = 5e-4
"""A particle whose penetrations sum up to less proves its prefix' keyframes feasible: it meets all else exactly [m]."""

STARTS = 4
"""Particles that the keyframe NLP is started from where none is a witness."""

PATH_STARTS = 4
"""Keyframe solutions that the path NLP is started from, one after the other."""

GOOD = 0.01
"""Particles whose penetrations sum up to less are keyframes to start a path from [m]."""

BATCH = 64
"""Prefixes judged between two looks at the clock."""


_PoseKey = tuple[tuple[Action, ...], frozenset[str]]
"""Actions on one object, and the other objects that have moved meanwhile."""


@dataclass(slots=True)
class Node:
    """A prefix: a sequence of applicable actions."""

    actions: tuple[Action, ...]
    state: int
    """Symbolic state after the actions."""
    parent: Node | None
    reaches_goal: bool
    problem: Problem | None = None
    particles: Particles | None = None
    feasible: bool | None = None
    """Verdict of the sequence bound; None: not computed."""
    children: list[Node] | None = None

    @property
    def depth(self) -> int:
        """Number of actions."""
        return len(self.actions)

    def ancestor(self, depth: int) -> Node:
        """The prefix of this length, or the node itself where it is shorter."""
        node = self
        while node.depth > depth and node.parent is not None:
            node = node.parent
        return node


class OutOfTime(Exception):
    """The tree's deadline has passed."""


@dataclass(slots=True)
class Counts:
    """How many NLPs were solved and verdicts taken, by bound."""

    nlps: Counter[str] = field(default_factory=Counter)
    """NLP solves (starts count singly): "pose", "sequence", "path", "refined path"."""
    verdicts: Counter[str] = field(default_factory=Counter)
    """Prefixes judged, by bound, those that a particle proved feasible or the scene refuted included."""
    feasible: Counter[str] = field(default_factory=Counter)
    """Of these, feasible."""


class SequenceTree:
    """Tree of one scene with its bounds; the searches decide what is computed and in which order."""

    def __init__(
        self,
        scene: Scene,
        k_max: int,
        seed: int = 0,
        settings: Settings | None = None,
        deadline: float = math.inf,
    ) -> None:
        """A tree with only its root; past the deadline (of `time.monotonic`) its bounds raise `OutOfTime`."""
        self.scene, self.k_max, self.seed, self.deadline = scene, k_max, seed, deadline
        self.settings = settings or Settings()
        self.grounding: Grounding = ground_actions([item.name for item in scene.objects], scene.goal.object)
        self.counts = Counts()
        self._refuted = {action: refute(scene, action) for action in self.grounding.actions}
        self._poses: dict[tuple[Action, ...], dict[frozenset[str], Node]] = {}
        self.root = Node((), self.grounding.initial_state, None, reaches_goal=False, feasible=True)
        self.root.particles = empty_prefix(len(scene.objects), k_max)

    def expand(self, node: Node) -> list[Node]:
        """Children of a node that pass the symbolic bound."""
        if node.children is None:
            node.children = []
            for index in self.grounding.applicable(node.state):
                action = self.grounding.actions[index]
                after = self.grounding.successor(node.state, index)
                if not self.grounding.can_reach_goal(after, self.k_max - node.depth - 1):
                    continue
                self.counts.verdicts["symbolic"] += 1
                if self._refuted[action] is not None:
                    continue
                self.counts.feasible["symbolic"] += 1
                goal = self.grounding.is_goal(after)
                node.children.append(Node((*node.actions, action), after, node, goal))
        return node.children

    def judge_sequences(self, nodes: list[Node]) -> None:
        """Sequence bound of nodes whose parents have passed it."""
        unjudged = [node for node in nodes if node.feasible is None]
        self._judge(unjudged, "sequence", [()] * len(unjudged))

    def judge_poses(self, nodes: list[Node]) -> list[bool]:
        """Pose bound of nodes: verdicts of their last object's own keyframes."""
        chains = {key: None for node in nodes for key in [self._chain(node)]}
        # What is feasible with few objects left out is so with more: few first, and the others inherit.
        by_size: dict[tuple[int, int], list[_PoseKey]] = {}
        for chain, ignored in chains:
            for level in range(1, len(chain) + 1):
                by_size.setdefault((level, len(ignored)), []).append((chain[:level], ignored))
        for _, keys in sorted(by_size.items()):
            self._judge_chains(list(dict.fromkeys(keys)))
        return [bool(self._poses[chain][ignored].feasible) for chain, ignored in map(self._chain, nodes)]

    def _judge_chains(self, keys: list[_PoseKey]) -> None:
        """Verdicts of chains of one length, whose prefixes and subsets have theirs."""
        fresh: list[tuple[_PoseKey, Node]] = []
        for chain, ignored in keys:
            known = self._poses.setdefault(chain, {})
            if ignored in known:
                continue
            parent = self._poses[chain[:-1]][ignored] if len(chain) > 1 else self.root
            node = known[ignored] = Node(chain, 0, parent, False)
            stricter = [other for others, other in known.items() if others < ignored and other.feasible]
            if not parent.feasible:
                node.feasible = False
            elif stricter:
                node.feasible, node.problem = True, stricter[0].problem
                node.particles = self._without(stricter[0].particles, ignored)
            else:
                fresh.append(((chain, ignored), node))
        self._judge([node for _, node in fresh], "pose", [tuple(sorted(key[1])) for key, _ in fresh])

    def _without(self, particles: Particles | None, ignored: frozenset[str]) -> Particles:
        """Particles with some objects left out of the world."""
        assert particles is not None
        kind = particles.kind.copy()
        kind[[self.scene.object_index(name) for name in ignored]] = ABSENT
        return particles._replace(kind=kind)

    def _chain(self, node: Node) -> _PoseKey:
        """Actions on the object of the node's last action, and the objects that others have moved meanwhile."""
        name = _object_of(node.actions[-1])
        chain = tuple(action for action in node.actions if _object_of(action) == name)
        return chain, frozenset(_object_of(action) for action in node.actions) - {name}

    def _judge(self, nodes: list[Node], bound: str, ignored: list[tuple[str, ...]]) -> None:
        """Verdicts on the keyframes of nodes, each with some objects left out."""
        for first in range(0, len(nodes), BATCH):
            self._look_at_the_clock()
            part = slice(first, first + BATCH)
            self._judge_batch(nodes[part], bound, ignored[part])

    def _look_at_the_clock(self) -> None:
        if time.monotonic() > self.deadline:
            raise OutOfTime

    def _judge_batch(self, nodes: list[Node], bound: str, ignored: list[tuple[str, ...]]) -> None:
        """Particles first, the NLP where they prove nothing."""
        problems = [transcribe(self.scene, node.actions, names) for node, names in zip(nodes, ignored, strict=True)]
        parents = [self._parent_particles(node, names) for node, names in zip(nodes, ignored, strict=True)]
        extended = extend_prefixes(parents, problems, self.seed)
        unproved: dict[int, list[Node]] = {}
        for node, problem, particles in zip(nodes, problems, extended, strict=True):
            node.problem, node.particles = problem, particles
            node.feasible = bool(particles.violation.min() <= WITNESS)
            if not node.feasible:
                unproved.setdefault(node.depth, []).append(node)
        for depth, group in unproved.items():
            # Where inverse kinematics found nothing at all, more starts are no better than one.
            lanes = [
                (node, rank)
                for node in group
                for rank in range(STARTS if node.particles.violation.min() < UNREACHABLE else 1)  # type: ignore[union-attr]
            ]
            starts = [keyframe_start(node.particles, rank, depth) for node, rank in lanes]  # type: ignore[arg-type]
            solutions = solve([node.problem for node, _ in lanes], starts, self.settings)  # type: ignore[misc]
            self.counts.nlps[bound] += len(lanes)
            for (node, _), solution in zip(lanes, solutions, strict=True):
                if solution.feasible:
                    node.feasible = True
                    node.particles = adopt(node.particles, node.problem, solution)  # type: ignore[arg-type]
        self.counts.verdicts[bound] += len(nodes)
        self.counts.feasible[bound] += sum(bool(node.feasible) for node in nodes)

    def _parent_particles(self, node: Node, ignored: tuple[str, ...]) -> Particles:
        assert node.parent is not None and node.parent.particles is not None
        if node.parent is self.root and ignored:
            return self._without(node.parent.particles, frozenset(ignored))
        return node.parent.particles

    def path_attempts(self, node: Node) -> int:
        """Number of keyframe solutions that the path of a node may start from."""
        assert node.particles is not None
        return min(PATH_STARTS, int((node.particles.violation <= GOOD).sum()))

    def solve_path(self, node: Node, attempt: int) -> Solved:
        """Path of a node that passed the sequence bound, from its ``attempt``-th keyframes."""
        assert node.problem is not None and node.particles is not None and node.feasible
        self._look_at_the_clock()
        # Spread over the particles: neighbours in rank often are siblings.
        good = int((node.particles.violation <= GOOD).sum())
        keyframes = keyframe_start(node.particles, attempt * (good // self.path_attempts(node)), node.depth)
        start = path_start(node.problem, keyframes)
        self.counts.nlps["path"] += 1
        return solve([path_problem(node.problem, start)], [start], self.settings)[0]

    def refine_path(self, node: Node, path: Solved) -> Solved:
        """The same path solved again with twice the slices, from a solution that is wrong between its slices."""
        assert node.problem is not None
        self._look_at_the_clock()
        self.counts.nlps["refined path"] += 1
        start = refined_start(node.problem, path)
        return solve([path_problem(node.problem, start)], [start], self.settings)[0]


def _object_of(action: Action) -> str:
    return action.arguments[2] if action.operator == "grasp" else action.arguments[1]
