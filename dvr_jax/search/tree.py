"""The tree of action sequences of one scene, and the verdicts of its bounds, computed once and kept.

Bounds of a node, each a relaxation of the next, so that infeasible under one means infeasible under all that follow
and for all descendants:

- *symbolic*: the goal can be reached within K_max actions; no action is refuted by a constant of the scene;
- *pose*: the keyframes of the actions on one object alone (`dvr_jax.search.pose_bound`);
- *sequence*: the keyframes of the whole prefix;
- *path*: the whole motion of a sequence that reaches the goal.

Bounds are generators: they ask for work (`dvr_jax.search.work`) and go on when it is done, so that the trees of many
scenes can share batches. Only `SequenceTree.retry_refuted` takes a verdict back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from dvr_jax.logic import Action, Grounding
from dvr_jax.operators import OPERATORS, Operator, ground_scene, is_duplicate, refute
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.pose_bound import PoseBound
from dvr_jax.search.work import Steps
from dvr_jax.seeds.keyframe_beam import empty_beam
from dvr_jax.solver.augmented_lagrangian import Settings


class SequenceTree:
    """Tree of one scene with its bounds; the searches decide what is computed and in which order."""

    def __init__(
        self,
        scene: Scene,
        k_max: int,
        seed: int = 0,
        settings: Settings | None = None,
        deadline: float = math.inf,
        operators: Sequence[Operator] = OPERATORS,
    ) -> None:
        """Begin with only the root.

        Args:
            scene: A valid scene.
            k_max: Largest number of actions.
            seed: Of all sampling.
            settings: Of the solver.
            deadline: Time of `time.monotonic` past which bounds raise `OutOfTime` [s].
            operators: The operators that span the tree.

        Raises:
            DvrError: Something collides in the scene's initial state.
        """
        require_free_home(scene)
        self.scene = scene
        self.k_max = k_max
        self.seed = seed
        self.operators = operators
        self.solver = NodeSolver(scene, settings or Settings(), deadline, operators)
        self.counts = self.solver.counts
        self.grounding: Grounding = ground_scene(scene, operators)
        self._refuted = {
            action: refute(scene, action, operators) for action in self.grounding.actions
        }
        self.root = Node((), self.grounding.initial_state, None, reaches_goal=False, feasible=True)
        self.root.beam = empty_beam(len(scene.objects), k_max, scene.workcell.number_of_joints)
        self._pose_bound = PoseBound(self.solver, self.root, seed)

    def statically_infeasible_actions(self, node: Node) -> list[Action]:
        """Actions that the logic allows after a prefix and a constant of the scene refutes."""
        allowed = [self.grounding.actions[index] for index in self.grounding.applicable(node.state)]
        return [action for action in allowed if self._refuted[action] is not None]

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
            self.solver.look_at_the_clock()
            allowed = self.grounding.applicable(node.state)
            children = [self._child(node, index) for index in allowed]
            node.children = [child for child in children if child is not None]
        return node.children

    def _child(self, node: Node, index: int) -> Node | None:
        """The child of a node by one action; None where the symbolic bound refutes it."""
        action = self.grounding.actions[index]
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

    def judge_sequences(self, nodes: list[Node]) -> Steps[None]:
        """Take the sequence bound of nodes whose parents have passed it."""
        unjudged = [node for node in nodes if node.feasible is None]
        unproved = yield from self.solver.sample(unjudged, [()] * len(unjudged), self.seed)
        yield from self.solver.solve(unproved, "sequence")
        self.counts.verdicts["sequence"] += len(unjudged)
        self.counts.feasible["sequence"] += sum(bool(node.feasible) for node in unjudged)

    def retry_refuted(self, nodes: list[Node]) -> Steps[None]:
        """Take a second opinion on nodes that the sequence bound has refuted.

        Their last actions are sampled anew, and the keyframe NLP is started from every candidate.
        """
        refuted = [
            node for node in nodes if node.feasible is False and node.refuted_by == "sequence"
        ]
        unproved = yield from self.solver.sample(refuted, [()] * len(refuted), self.seed + 1)
        yield from self.solver.solve_from_all(unproved, "sequence")
        for node in refuted:
            if node.feasible:
                node.refuted_by = ""
                node.violation = math.nan
                self.counts.feasible["sequence"] += 1

    def judge_poses(self, nodes: list[Node]) -> Steps[list[bool]]:
        """Take the pose bound of nodes; whether each of them passes."""
        return (yield from self._pose_bound.judge(nodes))

    def check_cached_pose_bound(self, node: Node) -> bool:
        """Whether a node may go on, by pose bounds that are known; it is refuted if it may not."""
        return self._pose_bound.check_cached(node)
