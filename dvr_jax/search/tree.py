"""The tree of action sequences of one scene, and the verdicts of its bounds, each computed once and kept.

Bounds of a node, each a relaxation of the next, so that infeasible under one means infeasible under all that follow
and for all descendants:

- *symbolic*: the goal can be reached within K_max actions; no action is refuted by a constant of the scene;
- *pose*: the keyframes of the actions on one object alone, all other objects that have moved left out;
- *sequence*: the keyframes of the whole prefix;
- *path*: the whole motion of a sequence that reaches the goal.

Bounds are generators: they ask for work (`dvr_jax.search.work`) and go on when it is done, so that the trees of many
scenes can share batches.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TypeVar

from dvr_jax.komo.augmented import Settings
from dvr_jax.komo.engine import (
    Solved,
    adopt,
    keyframe_start,
    path_problem,
    path_start,
)
from dvr_jax.komo.particles import PARTICLES, UNREACHABLE, Particles, empty_prefix
from dvr_jax.komo.problem import ABSENT, Problem, Variables
from dvr_jax.komo.transcription import is_duplicate, refute, transcribe
from dvr_jax.logic import Action, Grounding, ground_actions, object_of
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.types import Scene
from dvr_jax.search.work import Extend, Solve, Steps

WITNESS = 5e-4
"""A particle whose penetrations sum up to less proves its prefix' keyframes feasible: it meets all else exactly [m]."""

FURTHER_STARTS = (5, 10)
"""Ranks of the particles that the keyframe NLP is started from where the best one fails: neighbours in rank often are
siblings, and these two find all but one of what the fifteen others find in 1,100 prefixes."""

PATH_STARTS = 4
"""Keyframes that the path NLP is started from, one after the other."""

GOOD = 0.01
"""Particles whose penetrations sum up to less are good enough to start a path from [m]."""

BATCH = 64
"""Prefixes judged between two looks at the clock."""


_Item = TypeVar("_Item")

_PoseKey = tuple[tuple[Action, ...], frozenset[str]]
"""Actions on one object, and the other objects that have moved meanwhile."""


@dataclass(slots=True, eq=False)
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
    """Verdict of the sequence bound, or False by the pose bound; None: not computed."""
    refuted_by: str = ""
    """The bound that refuted it: "symbolic", "pose", "sequence", "path", or "check" for a path that only the check
    refused."""
    violation: float = math.nan
    """Least violation that an NLP under the refuting bound ended with, as a multiple of its tolerance."""
    solved: bool | None = None
    """Whether there is an accepted path; None: not tried."""
    children: list[Node] | None = None

    def refute(self, bound: str, violation: float) -> None:
        """Note that a bound of keyframes refutes this prefix, and so all its continuations."""
        self.feasible, self.refuted_by, self.violation = False, bound, violation

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
    """NLP solves (starts count singly): "pose", "sequence", "path"."""
    verdicts: Counter[str] = field(default_factory=Counter)
    """Prefixes judged, by bound, those that a particle proved feasible or the scene refuted included; "leaf": sequences
    that reach the goal and were considered."""
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
        """A tree with only its root; past the deadline (of `time.monotonic`) its bounds raise `OutOfTime`.

        Raises DvrError for a scene whose initial state is in collision."""
        require_free_home(scene)
        self.scene, self.k_max, self.seed, self.deadline = scene, k_max, seed, deadline
        self.settings = settings or Settings()
        self.grounding: Grounding = ground_actions([item.name for item in scene.objects], scene.goal.object)
        self.counts = Counts()
        self._refuted = {action: refute(scene, action) for action in self.grounding.actions}
        self._poses: dict[tuple[Action, ...], dict[frozenset[str], Node]] = {}
        self.root = Node((), self.grounding.initial_state, None, reaches_goal=False, feasible=True)
        self.root.particles = empty_prefix(len(scene.objects), k_max)

    def too_large(self, node: Node) -> list[Action]:
        """Actions that the logic allows after a prefix and a constant of the scene refutes."""
        actions = self.grounding.actions
        return [actions[i] for i in self.grounding.applicable(node.state) if self._refuted[actions[i]] is not None]

    def refute_by_constants(self, node: Node) -> bool:
        """Whether a constant of the scene refutes an action on the way to a node; the first such prefix is noted."""
        for depth in range(1, node.depth + 1):
            prefix = node.ancestor(depth)
            if self._refuted[prefix.actions[-1]] is not None:
                prefix.refute("symbolic", math.nan)
                return True
        return False

    def expand(self, node: Node) -> list[Node]:
        """Children of a node that pass the symbolic bound, each once."""
        if node.children is None:
            node.children = []
            for index in self.grounding.applicable(node.state):
                action = self.grounding.actions[index]
                if is_duplicate(self.scene, action):
                    continue
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

    def judge_sequences(self, nodes: list[Node]) -> Steps[None]:
        """Sequence bound of nodes whose parents have passed it."""
        unjudged = [node for node in nodes if node.feasible is None]
        unproved = yield from self._sample(unjudged, [()] * len(unjudged))
        yield from self._solve(unproved, "sequence")
        self._count("sequence", unjudged)

    def look_again(self, nodes: list[Node]) -> Steps[None]:
        """Second opinion on nodes that the sequence bound has refuted: their last actions are sampled anew, and the
        keyframe NLP is started from every particle."""
        refuted = [node for node in nodes if node.feasible is False and node.refuted_by == "sequence"]
        unproved = yield from self._sample(refuted, [()] * len(refuted), self.seed + 1)
        for group in _by_depth(unproved):
            yield from self._solve_from([node for node in group if _is_reached(node)], range(PARTICLES), "sequence")
        for node in refuted:
            if node.feasible:
                node.refuted_by, node.violation = "", math.nan
                self.counts.feasible["sequence"] += 1

    def judge_poses(self, nodes: list[Node]) -> Steps[list[bool]]:
        """Pose bound of nodes: verdicts of their last object's own keyframes."""
        # Keyframes that are known prove more than samples that miss.
        unproved = [node for node in nodes if node.feasible is not True]
        chains = dict.fromkeys(map(self._chain, unproved))
        for length in range(1, max((len(chain) for chain, _ in chains), default=0) + 1):
            keys = [(chain[:length], ignored) for chain, ignored in chains if len(chain) >= length]
            yield from self._judge_chains(list(dict.fromkeys(keys)))
        for node in unproved:
            chain, ignored = self._chain(node)
            judged = self._poses[chain][ignored]
            if not judged.feasible:
                node.refute("pose", judged.violation)
        return [node.feasible is not False for node in nodes]

    def recall_pose(self, node: Node) -> bool:
        """Whether a node may go on: False, and the node refuted, if some other node's pose bound refutes it too."""
        chain, ignored = self._chain(node)
        for length in range(1, len(chain) + 1 if node.feasible is not True else 0):
            known = self._poses.get(chain[:length], {}).get(ignored)
            if known is None:
                break
            if known.feasible is False:
                node.refute("pose", known.violation)
                break
        return node.feasible is not False

    def _judge_chains(self, keys: list[_PoseKey]) -> Steps[None]:
        """Verdicts of chains of one length, whose prefixes have theirs."""
        # What is feasible with few objects left out is so with more: few first, and the others inherit.
        sampled: list[Node] = []
        unproved: list[Node] = []
        for _, group in groupby(sorted(keys, key=lambda key: len(key[1])), key=lambda key: len(key[1])):
            fresh: list[tuple[Node, frozenset[str]]] = []
            for chain, ignored in group:
                known = self._poses.setdefault(chain, {})
                if ignored in known:
                    continue
                parent = self._poses[chain[:-1]][ignored] if len(chain) > 1 else self.root
                node = known[ignored] = Node(chain, 0, parent, False)
                if not parent.feasible:
                    node.feasible, node.violation = False, parent.violation
                elif not self._inherit(node, ignored):
                    fresh.append((node, ignored))
            ignored_names = [tuple(sorted(names)) for _, names in fresh]
            sampled += [node for node, _ in fresh]
            unproved += yield from self._sample([node for node, _ in fresh], ignored_names)
        yield from self._solve(unproved, "pose")
        self._count("pose", sampled)

    def _inherit(self, node: Node, ignored: frozenset[str]) -> bool:
        """Whether the same chain is known to be feasible with fewer objects left out."""
        for others, other in self._poses[node.actions].items():
            if others < ignored and other.feasible:
                node.feasible, node.problem = True, other.problem
                node.particles = self._without(other.particles, ignored)
                return True
        return False

    def _without(self, particles: Particles | None, ignored: frozenset[str]) -> Particles:
        """Particles with some objects left out of the world."""
        assert particles is not None
        kind = particles.kind.copy()
        kind[[self.scene.object_index(name) for name in ignored]] = ABSENT
        return particles._replace(kind=kind)

    def _chain(self, node: Node) -> _PoseKey:
        """Actions on the object of the node's last action, and the objects that others have moved meanwhile."""
        name = object_of(node.actions[-1])
        chain = tuple(action for action in node.actions if object_of(action) == name)
        return chain, frozenset(object_of(action) for action in node.actions) - {name}

    def look_at_the_clock(self) -> None:
        """Raise OutOfTime past the deadline."""
        if time.monotonic() > self.deadline:
            raise OutOfTime

    def _sample(self, nodes: list[Node], ignored: list[tuple[str, ...]], seed: int | None = None) -> Steps[list[Node]]:
        """Particles of nodes, each with some objects left out; those nodes that no particle proves feasible."""
        for first in range(0, len(nodes), BATCH):
            self.look_at_the_clock()
            part, names = nodes[first : first + BATCH], ignored[first : first + BATCH]
            problems = [transcribe(self.scene, *args) for args in zip((n.actions for n in part), names, strict=True)]
            parents = [self._parent_particles(*args) for args in zip(part, names, strict=True)]
            extended = yield Extend(parents, problems, self.seed if seed is None else seed)
            for node, problem, particles in zip(part, problems, extended, strict=True):
                node.problem, node.particles = problem, particles
                node.feasible = bool(particles.violation.min() <= WITNESS)
        return [node for node in nodes if not node.feasible]

    def _count(self, bound: str, judged: Sequence[Node]) -> None:
        self.counts.verdicts[bound] += len(judged)
        self.counts.feasible[bound] += sum(bool(node.feasible) for node in judged)

    def _solve(self, nodes: list[Node], bound: str) -> Steps[None]:
        """Keyframe NLPs of nodes that no particle proved feasible: all from their best particle, then those that failed
        from the others."""
        for group in _by_depth(nodes):
            failed = yield from self._solve_from(group, [0], bound)
            # Where inverse kinematics found nothing at all, more starts are no better than one.
            reached = [node for node in failed if _is_reached(node)]
            yield from self._solve_from(reached, FURTHER_STARTS, bound)
            for node in group:
                if not node.feasible:
                    node.refute(bound, node.violation)

    def _solve_from(self, nodes: list[Node], ranks: Sequence[int], bound: str) -> Steps[list[Node]]:
        """Keyframe NLPs of nodes of one depth from their particles of these ranks; those nodes that failed."""
        for first in range(0, len(nodes), BATCH):
            self.look_at_the_clock()
            lanes = [(node, rank) for node in nodes[first : first + BATCH] for rank in ranks]
            starts = [keyframe_start(node.particles, rank, node.depth) for node, rank in lanes]  # type: ignore[arg-type]
            solutions = yield Solve([node.problem for node, _ in lanes], starts, self.settings)  # type: ignore[misc]
            self.counts.nlps[bound] += len(lanes)
            for (node, _), solution in zip(lanes, solutions, strict=True):
                if not solution.feasible:
                    # NaN is no smaller than anything.
                    node.violation = min(solution.ratio, node.violation)
                else:
                    node.feasible = True
                    node.particles = adopt(node.particles, node.problem, solution)  # type: ignore[arg-type]
        return [node for node in nodes if not node.feasible]

    def _parent_particles(self, node: Node, ignored: tuple[str, ...]) -> Particles:
        assert node.parent is not None and node.parent.particles is not None
        if node.parent is self.root and ignored:
            return self._without(node.parent.particles, frozenset(ignored))
        return node.parent.particles

    def path_keyframes(self, node: Node) -> list[Variables]:
        """Keyframes that the path of a node that passed the sequence bound may start from: good particles, at least one
        and at most so many as `PATH_STARTS`."""
        assert node.particles is not None and node.feasible
        # Spread over the particles: neighbours in rank often are siblings.
        good = int((node.particles.violation <= GOOD).sum())
        ranks = _spread(range(good), PATH_STARTS)
        return [keyframe_start(node.particles, rank, node.depth) for rank in ranks]

    def more_keyframes(self, node: Node, most: int) -> Steps[list[Variables]]:
        """At most so many further keyframes: solutions of the keyframe NLP from particles that are not good."""
        assert node.problem is not None and node.particles is not None
        self.look_at_the_clock()
        violation = node.particles.violation
        ranks = range(int((violation <= GOOD).sum()), int((violation < UNREACHABLE).sum()))
        starts = [keyframe_start(node.particles, rank, node.depth) for rank in ranks]
        if not starts:
            return []
        solutions = yield Solve([node.problem] * len(starts), starts, self.settings)
        self.counts.nlps["sequence"] += len(starts)
        return _spread([Variables(found.q, found.m) for found in solutions if found.feasible], most)

    def solve_path(self, node: Node, keyframes: Variables | None = None) -> Steps[Solved]:
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
    return node.particles is not None and bool(node.particles.violation.min() < UNREACHABLE)
