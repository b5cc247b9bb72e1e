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
        # A prefix that is as long as the longest shorter sequence has no room for another action.
        short = [prefix for prefix in prefixes if prefix.depth < leaf.depth - 1]
        for prefix in short:
            extended = _extended(tree, prefix, action, at_any_face=len(prefixes) < MOST_PREFIXES)
            found.update((child, None) for child in extended if child.reaches_goal)
            prefixes.update((child, None) for child in extended if not child.reaches_goal)
    return list(found)


def _extended(tree: SequenceTree, prefix: Node, action: Action, at_any_face: bool) -> list[Node]:
    """Return a prefix followed by an action, if no bound refutes that.

    Args:
        tree: The tree of the prefix.
        prefix: A prefix.
        action: The action.
        at_any_face: Whether the action may also take place at another face of the object.
    """
    alike = _without_face(action, tree.operators)
    return [
        child
        for child in tree.expand(prefix)
        if child.feasible is not False
        and (
            child.actions[-1] == action
            or (at_any_face and _without_face(child.actions[-1], tree.operators) == alike)
        )
    ]


def _without_face(action: Action, operators: Sequence[Operator]) -> tuple[str, ...]:
    """Return the name and the arguments of an action, but not the face of an object."""
    kinds = operator_of(action, operators).parameters
    arguments = [
        argument
        for argument, kind in zip(action.arguments, kinds, strict=True)
        if kind != Parameter.FACE
    ]
    return (action.operator, *arguments)
