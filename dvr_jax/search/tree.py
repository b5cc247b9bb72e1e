"""The tree of action sequences of one scene; the verdicts of its bounds are computed once and stored in its nodes.

A bound is a test whose verdict on a node is feasible or infeasible. An infeasible node is *refuted*. There are four
bounds. Each is a relaxation of the next one, so a node that is infeasible under one bound is infeasible under all later
bounds, and so are its descendants:

- *symbolic*: the goal can be reached within K_max actions, and no action is refuted by a constant of the scene (for
  example, by an object that is too wide for the gripper);
- *pose*: keyframes exist for the actions on one object alone (`dvr_jax.search.pose_bound`), and for each two or three
  consecutive ones of them (`dvr_jax.search.windows`);
- *sequence*: keyframes exist for all actions of the prefix;
- *path*: a motion exists for the whole sequence, which reaches the goal.

From the windows follows a lower bound on the number of actions of a scene and on those that a prefix still needs
(`dvr_jax.search.relaxation`). Prefixes that cannot lead to a solution of at most K_max actions are not expanded.

Bounds are generators: they yield requests for numerical work (`dvr_jax.search.work`) and continue when it is done, so
that the searches of many scenes can share batches. Only `SequenceTree.retry_refuted` ever revises a verdict.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from dvr_jax.goals import OnRegion
from dvr_jax.logic import Action, Grounding
from dvr_jax.operators import OPERATORS, Operator, ground_scene, is_duplicate, refute
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.start import end_conditions
from dvr_jax.scene.types import Scene
from dvr_jax.search.conjunction_bound import relaxation_type
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.pose_bound import PoseBound
from dvr_jax.search.work import Steps
from dvr_jax.seeds.keyframe_beam import beam_capacity, empty_beam
from dvr_jax.solver.state import Settings

ACTIONS_OF_LONG_GOALS = 24
"""Number of actions that beams have room for if a goal of several facts may need many."""

MANY_OBJECTS = 3
"""Largest number of objects of such a goal for which the usual room suffices."""


def _least_capacity(scene: Scene) -> int:
    """Return the number of actions that beams need at least room for, so that a search may raise its limit."""
    named = {c.item for c in end_conditions(scene) if c.holds}
    is_long = not isinstance(scene.goal, OnRegion) and len(named) > MANY_OBJECTS
    return ACTIONS_OF_LONG_GOALS if is_long else 0


class SequenceTree:
    """Tree of one scene's sequences with their bounds; the searches decide which bounds are computed, and when."""

    def __init__(
        self,
        scene: Scene,
        k_max: int,
        seed: int = 0,
        settings: Settings | None = None,
        deadline: float = math.inf,
        operators: Sequence[Operator] = OPERATORS,
        is_relaxed: bool = True,
    ) -> None:
        """Create a tree that consists of its root, the empty sequence.

        Args:
            scene: A valid scene.
            k_max: Largest number of actions.
            seed: Seed of all sampling.
            settings: Settings of the solver; None for the default ones.
            deadline: Time of `time.monotonic` past which bounds raise `OutOfTime` [s].
            operators: The operators that span the tree.
            is_relaxed: Whether the relaxation prunes the tree. Without it every prefix has a verdict of its own, which
                labels for training need.

        Raises:
            DvrError: Something collides in the scene's initial state.
        """
        require_free_home(scene)
        self.scene = scene
        self.k_max = k_max
        self.seed = seed
        self.operators = operators
        self.is_relaxed = is_relaxed
        self.solver = NodeSolver(scene, settings or Settings(), deadline, operators)
        self.counts = self.solver.counts
        self.grounding: Grounding = ground_scene(scene, operators)
        self._refuted = {
            action: refute(scene, action, operators) for action in self.grounding.actions
        }
        self.root = Node((), self.grounding.initial_state, None, reaches_goal=False, feasible=True)
        self.capacity = beam_capacity(max(k_max, _least_capacity(scene)))
        """Number of actions that the beams have room for; `k_max` may be raised up to this number."""
        self.root.beam = empty_beam(
            len(scene.objects), self.capacity, scene.workcell.number_of_joints
        )
        self._pose_bound = PoseBound(self.solver, self.root, seed)
        self.relaxation = relaxation_type(scene)(
            self.solver, self.root, seed, lambda action: self._refuted[action] is None
        )
        """Lower bounds on the number of actions."""

    def statically_infeasible_actions(self, node: Node) -> list[Action]:
        """Return the actions that the logic allows after a prefix but a constant of the scene refutes."""
        allowed = [self.grounding.actions[index] for index in self.grounding.applicable(node.state)]
        return [action for action in allowed if self._refuted[action] is not None]

    def refute_by_constants(self, node: Node) -> bool:
        """Return whether a constant of the scene refutes a prefix of a node, and refute the shortest such prefix."""
        for depth in range(1, node.depth + 1):
            prefix = node.ancestor(depth)
            if self._refuted[prefix.actions[-1]] is not None:
                prefix.refute("symbolic", math.nan)
                return True
        return False

    def expand(self, node: Node) -> list[Node]:
        """Return the children of a node that pass the symbolic bound and the relaxation, as far as it is known."""
        if node.children is None or node.children_limit < self.k_max:
            self.solver.look_at_the_clock()
            known = {child.actions[-1]: child for child in node.children or ()}
            allowed = self.grounding.applicable(node.state)
            children = [self._child(node, index, known) for index in allowed]
            node.children = [child for child in children if child is not None]
            node.children_limit = self.k_max
        return [child for child in node.children if self._may_be_solved(child)]

    def descend(self, actions: Sequence[Action]) -> Node | None:
        """Return the node of a sequence that the logic allows; None if a bound is known to refute a prefix of it.

        Args:
            actions: The sequence. Of its prefixes, no other children are examined.
        """
        node = self.root
        for action in actions:
            known = {child.actions[-1]: child for child in node.children or ()}
            child = self._child(node, self.grounding.index(action), known)
            if child is None or not self._may_be_solved(child):
                return None
            if action not in known:
                node.children = [*(node.children or ()), child]
            node = child
        return node

    def _child(self, node: Node, index: int, known: dict[Action, Node]) -> Node | None:
        """Return the child of a node by one action; None if the symbolic bound refutes it or it is a duplicate."""
        action = self.grounding.actions[index]
        if action in known:
            return known[action]
        if is_duplicate(self.scene, action, self.operators):
            return None
        after = self.grounding.successor(node.state, index)
        if not self.grounding.can_reach_goal(after, self.k_max - node.depth - 1):
            return None

        self.counts.verdicts["symbolic"] += 1
        if self._refuted[action] is not None:
            return None
        self.counts.feasible["symbolic"] += 1
        return Node((*node.actions, action), after, node, self.grounding.is_goal(after))

    def _may_be_solved(self, node: Node) -> bool:
        """Return whether the windows that are known allow a solution of at most `k_max` actions that begins so."""
        if not self.is_relaxed:
            return True
        if not self.relaxation.check_cached(node):
            return False
        left = self.k_max - node.depth
        if not self.grounding.can_reach_goal(node.state, left):
            return False
        return node.reaches_goal or self.relaxation.remaining(node.actions) <= left

    def is_refuted_at_once(self) -> bool:
        """Return whether what is known without any numerical work excludes a solution of at most `k_max` actions."""
        return self.is_relaxed and self.relaxation.least_without_limit() > self.k_max

    def judge_scene(self) -> Steps[bool]:
        """Compute the relaxation of the scene, and return whether it allows a solution of at most `k_max` actions."""
        if not self.is_relaxed:
            return True
        return (yield from self.relaxation.compute(self.k_max)) <= self.k_max

    def judge_windows(self, nodes: list[Node], least: int = 1) -> Steps[list[bool]]:
        """Judge the last two actions on one object of nodes, and return for each of them whether it passes.

        Args:
            nodes: The nodes.
            least: Number of actions on the object from which on windows are judged.
        """
        if not self.is_relaxed:
            return [True] * len(nodes)
        return (yield from self.relaxation.judge_windows(nodes, least))

    def judge_motions(self, leaf: Node) -> Steps[None]:
        """Judge the motions of the windows of a leaf whose path has failed."""
        if self.is_relaxed:
            yield from self.relaxation.judge_motions(leaf)

    def is_motion_refuted(self, leaf: Node) -> bool:
        """Return whether a window of a leaf is known to have no motion, which refutes the leaf."""
        return self.is_relaxed and self.relaxation.is_motion_refuted(leaf)

    def judge_sequences(self, nodes: list[Node]) -> Steps[None]:
        """Compute the sequence bound of nodes whose parents have passed it."""
        unjudged = [node for node in nodes if node.feasible is None]
        unproved = yield from self.solver.sample(unjudged, [()] * len(unjudged), self.seed)
        yield from self.solver.solve(unproved, "sequence")
        self.counts.verdicts["sequence"] += len(unjudged)
        self.counts.feasible["sequence"] += sum(bool(node.feasible) for node in unjudged)

    def retry_refuted(self, nodes: list[Node]) -> Steps[None]:
        """Compute the sequence bound once more, with more effort, for nodes that it has refuted.

        The beams of the nodes are sampled again with another seed, and the keyframe NLP is started from every
        candidate.
        """
        refuted = [
            node for node in nodes if node.feasible is False and node.refuted_by == "sequence"
        ]
        unproved = yield from self.solver.sample(refuted, [()] * len(refuted), self.seed + 1)
        yield from self.solver.solve_from_all(unproved, "sequence")
        for node in refuted:
            node.is_retried = True
            if node.feasible:
                node.refuted_by = ""
                node.violation = math.nan
                self.counts.feasible["sequence"] += 1

    def judge_poses(self, nodes: list[Node]) -> Steps[list[bool]]:
        """Compute the pose bound of nodes, and return for each of them whether it passes."""
        return (yield from self._pose_bound.judge(nodes))

    def check_cached_pose_bound(self, node: Node) -> bool:
        """Return False and refute the node if a pose bound that is known already shows that it is infeasible."""
        return self._pose_bound.check_cached(node)
