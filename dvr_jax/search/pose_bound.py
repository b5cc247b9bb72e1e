"""The pose bound: keyframes of the actions on one object alone, whose verdicts many sequences share.

A *chain* is the sequence of all actions on one object so far; all other objects that have moved meanwhile are left out
of the world. A chain whose keyframes are infeasible refutes every sequence that contains it. Before the chain, its
last switch is judged alone where the object is held: how it was grasped is free, so that one verdict, of two slices,
is shared by all chains that end with the same two actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import object_of, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.work import Steps

SWITCH_SAMPLES = 2
"""Samples that have to fail before a last switch alone refutes what ends with it: that is a lot, and one sample misses
1 to 5 of 1,139 switches known to be feasible."""

Actions = tuple[Action, ...]
Ignored = frozenset[str]
ChainKey = tuple[Actions, Ignored]
"""Actions on one object, and the names of the other objects that have moved meanwhile."""

_Known = dict[Actions, dict[Ignored, Node]]
"""Verdicts on actions on one object, by the other objects that have moved."""


class PoseBound:
    """Verdicts on chains of one scene, computed once and kept."""

    def __init__(self, solver: NodeSolver, root: Node, seed: int) -> None:
        """Begin without any verdict.

        Args:
            solver: Work on the scene.
            root: The tree's root.
            seed: Of all sampling.
        """
        self._solver = solver
        self._root = root
        self._seed = seed
        self._chains: _Known = {}
        self._switches: _Known = {}

    def judge(self, nodes: list[Node]) -> Steps[list[bool]]:
        """Judge nodes by the keyframes of their last object, and refute those that fail.

        Args:
            nodes: The nodes.

        Returns:
            Whether each of them passes.
        """
        # Keyframes that are known prove more than samples that miss.
        unproved = [node for node in nodes if node.feasible is not True]
        chains = dict.fromkeys(map(self._chain, unproved))
        longest = max((len(chain) for chain, _ in chains), default=0)
        for length in range(1, longest + 1):
            keys = [(chain[:length], ignored) for chain, ignored in chains if len(chain) >= length]
            yield from self._judge_chains(list(dict.fromkeys(keys)))

        for node in unproved:
            chain, ignored = self._chain(node)
            judged = self._chains[chain][ignored]
            if not judged.feasible:
                node.refute("pose", judged.violation)
            elif not ignored:
                # Nothing is left out of the world: these are the keyframes that the sequence bound asks for.
                node.feasible = True
                node.problem = judged.problem
                node.beam = judged.beam
        return [node.feasible is not False for node in nodes]

    def check_cached(self, node: Node) -> bool:
        """Whether a node may go on, by verdicts that are known already; it is refuted if it may not."""
        chain, ignored = self._chain(node)
        lengths = range(1, len(chain) + 1 if node.feasible is not True else 0)
        for length in lengths:
            part = chain[:length]
            known = self._chains.get(part, {}).get(ignored)
            for judged in (known, self._refuting_switch(part, ignored)):
                if judged is not None and judged.feasible is False:
                    node.refute("pose", judged.violation)
                    return False
        return node.feasible is not False

    def _chain(self, node: Node) -> ChainKey:
        """Actions on the object of the node's last action, and the objects that others have moved meanwhile."""
        operators = self._solver.operators
        name = object_of(node.actions[-1], operators)
        chain = tuple(action for action in node.actions if object_of(action, operators) == name)
        return chain, frozenset(object_of(action, operators) for action in node.actions) - {name}

    def _judge_chains(self, keys: list[ChainKey]) -> Steps[None]:
        """Verdicts of chains of one length, whose prefixes have theirs."""
        sampled: list[Node] = []
        unproved: list[Node] = []

        # What is feasible with few objects left out is so with more: few first, and the others inherit.
        ordered = sorted(keys, key=lambda key: len(key[1]))
        for _, group in groupby(ordered, key=lambda key: len(key[1])):
            fresh = yield from self._pass_switches(self._fresh_chains(list(group)))
            nodes = [node for node, _ in fresh]
            names = [tuple(sorted(ignored)) for _, ignored in fresh]
            sampled += nodes
            unproved += yield from self._solver.sample(nodes, names, self._seed)
        yield from self._solver.solve(unproved, "pose")
        self._count(sampled)

    def _fresh_chains(self, keys: list[ChainKey]) -> list[tuple[Node, Ignored]]:
        """Nodes of chains without a verdict that follows from another one."""
        fresh: list[tuple[Node, Ignored]] = []
        for chain, ignored in keys:
            known = self._chains.setdefault(chain, {})
            if ignored in known:
                continue
            parent = self._chains[chain[:-1]][ignored] if len(chain) > 1 else self._root
            node = Node(chain, 0, parent, reaches_goal=False)
            known[ignored] = node
            if not parent.feasible:
                node.feasible = False
                node.violation = parent.violation
            elif not self._inherit(node, known, ignored):
                fresh.append((node, ignored))
        return fresh

    def _pass_switches(
        self, nodes: list[tuple[Node, Ignored]]
    ) -> Steps[list[tuple[Node, Ignored]]]:
        """Those chains that are not refuted by their last switch alone."""
        fresh = self._fresh_switches(nodes)
        for seed in range(self._seed, self._seed + SWITCH_SAMPLES):
            refuted = [
                (switch, tuple(sorted(ignored)))
                for (_, ignored), switch in fresh.items()
                if not switch.feasible
            ]
            for switch, left_out in refuted:
                self._solver.isolate_switch(switch, self._root, left_out, seed)
            switches = [switch for switch, _ in refuted]
            unproved = yield from self._solver.sample(
                switches, [left_out for _, left_out in refuted], seed
            )
            yield from self._solver.solve(unproved, "pose")
        self._count(list(fresh.values()))

        passed = []
        for node, ignored in nodes:
            judged = self._refuting_switch(node.actions, ignored)
            if judged is None:
                passed.append((node, ignored))
            else:
                node.feasible = False
                node.violation = judged.violation
        return passed

    def _fresh_switches(self, nodes: list[tuple[Node, Ignored]]) -> dict[ChainKey, Node]:
        """Nodes of last switches without a verdict."""
        fresh: dict[ChainKey, Node] = {}
        for node, ignored in nodes:
            pair = node.actions[-2:]
            # A chain of two is as cheap as its last switch, and where it is feasible, so is the switch.
            if (
                node.depth < 3
                or operator_of(pair[0], self._solver.operators).mode_after != ModeKind.HELD
            ):
                continue
            known = self._switches.setdefault(pair, {})
            if ignored in known or self._is_proved(pair, ignored):
                continue
            switch = Node(pair, 0, self._root, reaches_goal=False)
            known[ignored] = switch
            if not self._inherit(switch, known, ignored):
                fresh[pair, ignored] = switch
        return fresh

    def _refuting_switch(self, chain: Actions, ignored: Ignored) -> Node | None:
        """The last switch of a chain, where alone it has been refuted and nothing known is proof to the contrary."""
        if len(chain) <= 2:
            return None
        judged = self._switches.get(chain[-2:], {}).get(ignored)
        if judged is None or judged.feasible is not False:
            return None
        # Samples may miss what a chain that ends with the switch, judged since, has found.
        is_proved = self._is_proved(chain[-2:], ignored) or self._is_proved(chain, ignored)
        return None if is_proved else judged

    def _is_proved(self, chain: Actions, ignored: Ignored) -> bool:
        """Whether a chain is known to be feasible with these objects left out, or fewer."""
        return any(
            others <= ignored and other.feasible
            for others, other in self._chains.get(chain, {}).items()
        )

    def _inherit(self, node: Node, known: dict[Ignored, Node], ignored: Ignored) -> bool:
        """Whether the same is known to be feasible with fewer objects left out; the node then takes that over."""
        for others, other in known.items():
            if others < ignored and other.feasible:
                node.feasible = True
                node.problem = other.problem
                node.beam = self._solver.leave_out(other.beam, ignored)
                return True
        return False

    def _count(self, judged: Sequence[Node]) -> None:
        self._solver.counts.verdicts["pose"] += len(judged)
        self._solver.counts.feasible["pose"] += sum(bool(node.feasible) for node in judged)
