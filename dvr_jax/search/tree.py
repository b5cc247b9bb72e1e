"""The tree of action sequences of one scene, and the verdicts of its bounds, each computed once and kept.

Bounds of a node, each a relaxation of the next, so that infeasible under one means infeasible under all that follow
and for all descendants:

- *symbolic*: the goal can be reached within K_max actions; no action is refuted by a constant of the scene;
- *pose*: the keyframes of the actions on one object alone, all other objects that have moved left out;
- *sequence*: the keyframes of the whole prefix;
- *path*: the whole motion of a sequence that reaches the goal.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

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


_PoseKey = tuple[tuple[Action, ...], tuple[str, ...]]
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

    def __init__(self, scene: Scene, k_max: int, seed: int = 0, settings: Settings | None = None) -> None:
        """A tree with only its root."""
        self.scene, self.k_max, self.seed = scene, k_max, seed
        self.settings = settings or Settings()
        self.grounding: Grounding = ground_actions([item.name for item in scene.objects], scene.goal.object)
        self.counts = Counts()
        self._refuted = {action: refute(scene, action) for action in self.grounding.actions}
        self._poses: dict[_PoseKey, Node] = {}
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
        keys = [self._chain(node) for node in nodes]
        chains = {key: self._chain(node) for key, node in zip(keys, nodes, strict=True)}
        longest = max((len(chain) for chain, _ in chains.values()), default=0)
        for level in range(1, longest + 1):
            fresh: dict[_PoseKey, Node] = {}
            for chain, ignored in chains.values():
                key = (chain[:level], ignored)
                if len(chain) < level or key in self._poses:
                    continue
                parent = self._poses.get((chain[: level - 1], ignored), self.root)
                if not parent.feasible:
                    self._poses[key] = Node(chain[:level], 0, parent, False, feasible=False)
                    continue
                fresh[key] = Node(chain[:level], 0, parent, False)
            self._judge(list(fresh.values()), "pose", [ignored for _, ignored in fresh])
            self._poses.update(fresh)
        return [bool(self._poses[key].feasible) for key in keys]

    def _chain(self, node: Node) -> _PoseKey:
        """Actions on the object of the node's last action, and the objects that others have moved meanwhile."""
        name = _object_of(node.actions[-1])
        chain = tuple(action for action in node.actions if _object_of(action) == name)
        moved = {_object_of(action) for action in node.actions} - {name}
        return chain, tuple(sorted(moved))

    def _judge(self, nodes: list[Node], bound: str, ignored: list[tuple[str, ...]]) -> None:
        """Verdicts on the keyframes of nodes, each with some objects left out; particles first, the NLP where they
        prove nothing."""
        if not nodes:
            return
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
        particles = node.parent.particles
        if node.parent is self.root and ignored:
            kind = particles.kind.copy()
            kind[[self.scene.object_index(name) for name in ignored]] = ABSENT
            particles = particles._replace(kind=kind)
        return particles

    def solve_path(self, node: Node, attempt: int) -> Solved | None:
        """Path of a node that passed the sequence bound, from its ``attempt``-th keyframes; None: there are no more."""
        assert node.problem is not None and node.particles is not None and node.feasible
        order = np.argsort(node.particles.violation, kind="stable")
        good = [rank for rank, index in enumerate(order) if node.particles.violation[index] <= 0.01]
        if attempt >= min(PATH_STARTS, len(good)):
            return None
        # Spread over the particles: neighbours in rank often are siblings.
        rank = good[(attempt * max(1, len(good) // PATH_STARTS)) % len(good)]
        keyframes = keyframe_start(node.particles, rank, node.depth)
        start = path_start(node.problem, keyframes)
        self.counts.nlps["path"] += 1
        return solve([path_problem(node.problem, start)], [start], self.settings)[0]

    def refine_path(self, node: Node, path: Solved) -> Solved:
        """The same path solved again with twice the slices, from a solution that is wrong between its slices."""
        assert node.problem is not None
        self.counts.nlps["refined path"] += 1
        start = refined_start(node.problem, path)
        return solve([path_problem(node.problem, start)], [start], self.settings)[0]


def _object_of(action: Action) -> str:
    return action.arguments[2] if action.operator == "grasp" else action.arguments[1]
