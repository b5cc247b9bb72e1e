"""The tree of action sequences of one scene, and the verdicts of its bounds, computed once and kept; only
`SequenceTree.retry_refuted` takes one back.

Bounds of a node, each a relaxation of the next, so that infeasible under one means infeasible under all that follow
and for all descendants:

- *symbolic*: the goal can be reached within K_max actions; no action is refuted by a constant of the scene;
- *pose*: the keyframes of the actions on one object alone, all other objects that have moved left out; before them
  the last switch alone, where the object is held: how it was grasped is free, so that one verdict, of two slices, is
  shared by all sequences that end with the same grasp and the same action on the object;
- *sequence*: the keyframes of the whole prefix;
- *path*: the whole motion of a sequence that reaches the goal.

Bounds are generators: they ask for work (`dvr_jax.search.work`) and go on when it is done, so that the trees of many
scenes can share batches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

from dvr_jax.logic import Action, Grounding, ground_actions, object_of
from dvr_jax.nlp.transcription import is_duplicate, refute
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.work import Steps
from dvr_jax.seeds.keyframe_beam import empty_prefix
from dvr_jax.solver.augmented_lagrangian import Settings

_PoseKey = tuple[tuple[Action, ...], frozenset[str]]
"""Actions on one object, and the other objects that have moved meanwhile."""

SWITCH_LOOKS = 2
"""Samples that have to fail before a last switch alone refutes what ends with it: that is a lot, and one sample misses
1 to 5 of 1,139 switches known to be feasible."""

_Known = dict[tuple[Action, ...], dict[frozenset[str], Node]]
"""Verdicts on actions on one object, by the other objects that have moved."""


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
        self.scene, self.k_max, self.seed = scene, k_max, seed
        self.solver = NodeSolver(scene, settings or Settings(), deadline)
        self.counts = self.solver.counts
        self.grounding: Grounding = ground_actions([item.name for item in scene.objects], scene.goal.object)
        self._refuted = {action: refute(scene, action) for action in self.grounding.actions}
        self._poses: _Known = {}
        self._switches: _Known = {}
        """Of the last switch alone, by the grasp that holds the object and the action."""
        self.root = Node((), self.grounding.initial_state, None, reaches_goal=False, feasible=True)
        self.root.beam = empty_prefix(len(scene.objects), k_max)

    def statically_infeasible_actions(self, node: Node) -> list[Action]:
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
            self.solver.look_at_the_clock()
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
        unproved = yield from self.solver.sample(unjudged, [()] * len(unjudged), self.seed)
        yield from self.solver.solve(unproved, "sequence")
        self._count("sequence", unjudged)

    def retry_refuted(self, nodes: list[Node]) -> Steps[None]:
        """Second opinion on nodes that the sequence bound has refuted: their last actions are sampled anew, and the
        keyframe NLP is started from every particle."""
        refuted = [node for node in nodes if node.feasible is False and node.refuted_by == "sequence"]
        unproved = yield from self.solver.sample(refuted, [()] * len(refuted), self.seed + 1)
        yield from self.solver.solve_from_all(unproved, "sequence")
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
            elif not ignored:
                # Nothing is left out: this is the sequence bound.
                node.feasible, node.problem, node.beam = True, judged.problem, judged.beam
        return [node.feasible is not False for node in nodes]

    def check_cached_pose_bound(self, node: Node) -> bool:
        """Whether a node may go on: False, and the node refuted, if some other node's pose bound refutes it too."""
        chain, ignored = self._chain(node)
        for length in range(1, len(chain) + 1 if node.feasible is not True else 0):
            part = chain[:length]
            for judged in (self._poses.get(part, {}).get(ignored), self._refuting_switch(part, ignored)):
                if judged is not None and judged.feasible is False:
                    node.refute("pose", judged.violation)
                    return False
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
                elif not self._inherit(node, known, ignored):
                    fresh.append((node, ignored))
            fresh = yield from self._pass_switches(fresh)
            ignored_names = [tuple(sorted(names)) for _, names in fresh]
            sampled += [node for node, _ in fresh]
            unproved += yield from self.solver.sample([node for node, _ in fresh], ignored_names, self.seed)
        yield from self.solver.solve(unproved, "pose")
        self._count("pose", sampled)

    def _pass_switches(self, nodes: list[tuple[Node, frozenset[str]]]) -> Steps[list[tuple[Node, frozenset[str]]]]:
        """Those chains that are not refuted by their last switch alone."""
        fresh: dict[tuple[tuple[Action, ...], frozenset[str]], Node] = {}
        for node, ignored in nodes:
            pair = node.actions[-2:]
            # A chain of two is as cheap as its last switch, and where it is feasible, so is the switch.
            if node.depth < 3 or pair[0].operator != "grasp":
                continue
            known = self._switches.setdefault(pair, {})
            if ignored in known or self._is_proved(pair, ignored):
                continue
            switch = known[ignored] = Node(pair, 0, self.root, False)
            if not self._inherit(switch, known, ignored):
                fresh[pair, ignored] = switch
        for seed in range(self.seed, self.seed + SWITCH_LOOKS):
            refuted = [(switch, tuple(sorted(names))) for (_, names), switch in fresh.items() if not switch.feasible]
            for switch, left_out in refuted:
                self.solver.free_grasp(switch, self.root, left_out, seed)
            switches, ignored_names = [switch for switch, _ in refuted], [names for _, names in refuted]
            unproved = yield from self.solver.sample(switches, ignored_names, seed)
            yield from self.solver.solve(unproved, "pose")
        self._count("pose", list(fresh.values()))
        passed = []
        for node, ignored in nodes:
            judged = self._refuting_switch(node.actions, ignored)
            if judged is None:
                passed.append((node, ignored))
            else:
                node.feasible, node.violation = False, judged.violation
        return passed

    def _refuting_switch(self, chain: tuple[Action, ...], ignored: frozenset[str]) -> Node | None:
        """The last switch of a chain, where alone it has been refuted and nothing known is proof to the contrary."""
        judged = self._switches.get(chain[-2:], {}).get(ignored) if len(chain) > 2 else None
        if judged is None or judged.feasible is not False:
            return None
        # Samples may miss what a chain that ends with the switch, judged since, has found.
        proved = self._is_proved(chain[-2:], ignored) or self._is_proved(chain, ignored)
        return None if proved else judged

    def _is_proved(self, chain: tuple[Action, ...], ignored: frozenset[str]) -> bool:
        """Whether a chain is known to be feasible with these objects left out, or fewer."""
        return any(others <= ignored and other.feasible for others, other in self._poses.get(chain, {}).items())

    def _inherit(self, node: Node, known: dict[frozenset[str], Node], ignored: frozenset[str]) -> bool:
        """Whether the same is known to be feasible with fewer objects left out."""
        for others, other in known.items():
            if others < ignored and other.feasible:
                node.feasible, node.problem = True, other.problem
                node.beam = self.solver.leave_out(other.beam, ignored)
                return True
        return False

    def _chain(self, node: Node) -> _PoseKey:
        """Actions on the object of the node's last action, and the objects that others have moved meanwhile."""
        name = object_of(node.actions[-1])
        chain = tuple(action for action in node.actions if object_of(action) == name)
        return chain, frozenset(object_of(action) for action in node.actions) - {name}

    def _count(self, bound: str, judged: Sequence[Node]) -> None:
        self.counts.verdicts[bound] += len(judged)
        self.counts.feasible[bound] += sum(bool(node.feasible) for node in judged)
