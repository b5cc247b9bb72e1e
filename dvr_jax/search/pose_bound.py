"""The pose bound asks whether keyframes exist for the actions on one object alone; many sequences share its verdicts.

A *chain* is the list of all actions on one object in a sequence. All other objects that the sequence has moved are left
out of the world: they are the *ignored* objects. If the keyframes of a chain are infeasible, every sequence that
contains the chain is refuted.

If the object is held before the chain's last action, the last mode switch is judged alone before the whole chain is.
In this relaxation the object may be held in any way that the action before allows. Its NLP has only two slices, and its
verdict is shared by all chains that end with the same two actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, takewhile

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import lower_object_of, object_of, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.work import Steps

SWITCH_SAMPLES = 2
"""Number of samples (seeds) that have to fail before a last switch alone refutes the chains that end with it. A single
sample misses 1 to 5 of 1,139 switches that are known to be feasible, and each of them would refute many sequences."""

Actions = tuple[Action, ...]
Ignored = frozenset[str]
ChainKey = tuple[Actions, Ignored]
"""The actions on one object (a chain), and the names of the ignored objects."""

_Known = dict[Actions, dict[Ignored, Node]]
"""Judged nodes, by their actions on one object and by the names of the ignored objects."""


class PoseBound:
    """Computes the verdicts on chains of one scene and stores them."""

    def __init__(self, solver: NodeSolver, root: Node, seed: int) -> None:
        """Create a bound that has no verdict yet.

        Args:
            solver: Numerical work on the scene.
            root: The tree's root.
            seed: Seed of all sampling.
        """
        self._solver = solver
        self._root = root
        self._seed = seed
        self._chains: _Known = {}
        self._switches: _Known = {}

    def judge(self, nodes: list[Node]) -> Steps[list[bool]]:
        """Judge nodes by the keyframes of the object that their last action switches, and refute those that fail.

        Args:
            nodes: The nodes.

        Returns:
            Whether each of them passes.
        """
        # A node whose keyframes are known is feasible: the pose bound, which may miss solutions, must not refute it.
        unproved = [node for node in nodes if node.feasible is not True]
        chains = dict.fromkeys(map(self._chain, unproved))
        longest = max((len(chain) for chain, _ in chains), default=0)

        # The prefixes of a chain are judged first, because the beam of a chain extends the beam of its prefix.
        for length in range(1, longest + 1):
            keys = [(chain[:length], ignored) for chain, ignored in chains if len(chain) >= length]
            yield from self._judge_chains(list(dict.fromkeys(keys)))

        for node in unproved:
            chain, ignored = self._chain(node)
            judged = self._chains[chain][ignored]
            if not judged.feasible:
                node.refute("pose", judged.violation, judged.source or judged)
            elif not ignored:
                # No object is ignored, so the chain is the whole sequence and the sequence bound is computed too.
                node.feasible = True
                node.problem = judged.problem
                node.beam = judged.beam
        return [node.feasible is not False for node in nodes]

    def check_cached(self, node: Node) -> bool:
        """Return False and refute the node if a verdict that is known already shows that it is infeasible."""
        chain, ignored = self._chain(node)
        lengths = range(1, len(chain) + 1 if node.feasible is not True else 0)
        for length in lengths:
            part = chain[:length]
            known = self._chains.get(part, {}).get(ignored)
            for judged in (known, self._refuting_switch(part, ignored)):
                if judged is not None and judged.feasible is False:
                    node.refute("pose", judged.violation, judged.source or judged)
                    return False
        return node.feasible is not False

    def _chain(self, node: Node) -> ChainKey:
        """Return the actions on the object of the node's last action, and the names of all other objects that moved.

        A chain ends before the object is put on another one that has moved, because nothing is known of where that is.
        """
        operators = self._solver.operators
        name = object_of(node.actions[-1], operators)
        moved = frozenset(object_of(action, operators) for action in node.actions) - {name}
        own = [action for action in node.actions if object_of(action, operators) == name]
        chain = takewhile(
            lambda a: lower_object_of(self._solver.scene, a, operators) not in moved, own
        )
        return tuple(chain), moved

    def _judge_chains(self, keys: list[ChainKey]) -> Steps[None]:
        """Judge chains of one length whose prefixes have been judged."""
        sampled: list[Node] = []
        unproved: list[Node] = []

        # A chain that is feasible with few ignored objects is feasible with more of them. Chains with few ignored
        # objects are therefore judged first, and the others inherit their verdicts.
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
        """Create nodes for new chains, and return those whose verdict does not follow from a known one."""
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
                node.source = parent.source or parent
            elif not self._inherit(node, known, ignored):
                fresh.append((node, ignored))
        return fresh

    def _pass_switches(
        self, nodes: list[tuple[Node, Ignored]]
    ) -> Steps[list[tuple[Node, Ignored]]]:
        """Judge the last switches of chains alone, and return the chains that are not refuted by them."""
        fresh = self._fresh_switches(nodes)

        # A switch that has failed is sampled again with another seed.
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
                node.source = judged
        return passed

    def _fresh_switches(self, nodes: list[tuple[Node, Ignored]]) -> dict[ChainKey, Node]:
        """Create and return nodes for the last switches whose verdict is neither known nor follows from a known one."""
        fresh: dict[ChainKey, Node] = {}
        for node, ignored in nodes:
            pair = node.actions[-2:]
            # A chain of two actions costs no more than its last switch alone, so only longer chains are treated.
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
        """Return the node of a chain's last switch if it refutes the chain, and None otherwise."""
        if len(chain) <= 2:
            return None
        judged = self._switches.get(chain[-2:], {}).get(ignored)
        if judged is None or judged.feasible is not False:
            return None
        # The samples may have missed a solution. A feasible chain that ends with the switch proves that there is one.
        is_proved = self._is_proved(chain[-2:], ignored) or self._is_proved(chain, ignored)
        return None if is_proved else judged

    def _is_proved(self, chain: Actions, ignored: Ignored) -> bool:
        """Return whether a chain is known to be feasible with these objects ignored, or with a subset of them."""
        return any(
            others <= ignored and other.feasible
            for others, other in self._chains.get(chain, {}).items()
        )

    def _inherit(self, node: Node, known: dict[Ignored, Node], ignored: Ignored) -> bool:
        """Copy the verdict of a node with the same actions that is feasible with fewer ignored objects.

        Returns:
            Whether there is such a node.
        """
        for others, other in known.items():
            if others < ignored and other.feasible:
                node.feasible = True
                node.problem = other.problem
                node.beam = self._solver.leave_out(other.beam, ignored)
                return True
        return False

    def _count(self, judged: Sequence[Node]) -> None:
        """Add nodes to the counts of verdicts."""
        self._solver.counts.verdicts["pose"] += len(judged)
        self._solver.counts.feasible["pose"] += sum(bool(node.feasible) for node in judged)
