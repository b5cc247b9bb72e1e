"""Sequences without needless actions: those of a leaf's actions that suffice for the goal, grasped at any face.

A network may propose a sequence with actions that the goal does not need, such as moving an object that is in nobody's
way. What remains without them often needs another face, because the free arm was in the way of the first one.
"""

from __future__ import annotations

from collections.abc import Sequence

from dvr_jax.logic import Action
from dvr_jax.operators import Operator, Parameter, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree

MOST_PREFIXES = 200
"""Largest number of prefixes that are extended at any face; beyond it, only the faces of the leaf count."""


def shorter_leaves(tree: SequenceTree, leaf: Node) -> list[Node]:
    """Return the sequences that leave out some actions of a leaf and reach the goal, if known bounds allow them.

    Args:
        tree: The tree of the leaf.
        leaf: A node that reaches the goal.
    """
    found: dict[Node, None] = {}
    prefixes: dict[Node, None] = {tree.root: None}
    for action in leaf.actions:
        for prefix in list(prefixes):
            # A prefix that is as long as the longest shorter sequence has no room for another action.
            if prefix.depth >= leaf.depth - 1:
                continue
            for child in tree.expand(prefix):
                is_alike = child.actions[-1] == action or (
                    len(prefixes) < MOST_PREFIXES
                    and _without_face(child.actions[-1], tree.operators)
                    == _without_face(action, tree.operators)
                )
                if is_alike and child.feasible is not False:
                    (found if child.reaches_goal else prefixes)[child] = None
    return list(found)


def _without_face(action: Action, operators: Sequence[Operator]) -> tuple[str, ...]:
    """Return the name and the arguments of an action, but not the face of an object."""
    kinds = operator_of(action, operators).parameters
    arguments = [
        argument
        for argument, kind in zip(action.arguments, kinds, strict=True)
        if kind != Parameter.FACE
    ]
    return (action.operator, *arguments)
