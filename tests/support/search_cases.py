"""Sequences judged as a search judges them, and random scenes for tests of the search and the planner."""

from collections.abc import Sequence

from dvr_jax.logic import Action
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps


def judge_prefixes(tree: SequenceTree, actions: Sequence[Action]) -> Steps[Node]:
    """The node of a sequence, with the sequence bounds of its prefixes; below an infeasible one nothing is judged."""
    node = tree.root
    for length in range(1, len(actions) + 1):
        child = Node(tuple(actions[:length]), 0, node, reaches_goal=False)
        if node.feasible:
            yield from tree.judge_sequences([child])
        else:
            child.feasible = False
        node = child
    return node
