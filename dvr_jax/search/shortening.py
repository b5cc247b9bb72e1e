"""Sequences without needless actions: those of a leaf's actions that suffice for the goal, with one other face at most.

A network may propose a sequence with actions that the goal does not need, such as moving an object that is in nobody's
way. What remains without them often needs another face for one grasp, because the free arm was in the way of the first
one. Only those sequences are returned that are not refuted by what is known: by the lower bound on the number of
actions, by objects that stand on the target, and by windows (`dvr_jax.search.relaxation`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

from dvr_jax.logic import Action
from dvr_jax.operators import Operator, Parameter, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.tree import SequenceTree

MOST_SUBSEQUENCES = 10_000
"""Largest number of subsequences that are enumerated; a leaf of 13 actions has fewer than this."""

MOST_LEAVES = 128
"""Largest number of shorter sequences; the shortest ones come first."""


def shorter_leaves(tree: SequenceTree, leaf: Node) -> list[Node]:
    """Return the sequences that leave out some actions of a leaf and reach the goal, if known bounds allow them.

    Args:
        tree: The tree of the leaf.
        leaf: A node that reaches the goal.
    """
    chosen = [
        actions
        for actions in islice(_subsequences(tree, leaf.actions), MOST_SUBSEQUENCES)
        if tree.relaxation.lower_bound <= len(actions) < leaf.depth
        and not (tree.is_relaxed and _is_obstructed(tree, actions))
    ]
    variants = (
        variant
        for actions in sorted(dict.fromkeys(chosen), key=len)
        for variant in _with_other_faces(tree, actions)
    )
    nodes = (tree.descend(variant) for variant in dict.fromkeys(variants))
    return list(islice((node for node in nodes if node is not None), MOST_LEAVES))


def _subsequences(
    tree: SequenceTree, actions: Sequence[Action], state: int | None = None
) -> Iterator[tuple[Action, ...]]:
    """Yield the subsequences of some actions that the logic allows and that reach the goal with their last action.

    Args:
        tree: A tree.
        actions: The actions.
        state: Symbolic state before them; None for the initial one.
    """
    grounding = tree.grounding
    before = grounding.initial_state if state is None else state
    allowed = set(grounding.applicable(before))
    for number, action in enumerate(actions):
        index = grounding.index(action)
        if index not in allowed:
            continue
        after = grounding.successor(before, index)
        if grounding.is_goal(after):
            yield (action,)
            continue
        for rest in _subsequences(tree, actions[number + 1 :], after):
            yield (action, *rest)


def _is_obstructed(tree: SequenceTree, actions: tuple[Action, ...]) -> bool:
    """Return whether an object stands where an action of a sequence places another one."""
    lengths = range(1, len(actions) + 1)
    return any(tree.relaxation.obstruction(actions[:length]) is not None for length in lengths)


def _with_other_faces(
    tree: SequenceTree, actions: tuple[Action, ...]
) -> Iterator[tuple[Action, ...]]:
    """Yield a sequence, and all sequences in which one action takes place at another face."""
    yield actions
    for number, action in enumerate(actions):
        alike = _without_face(action, tree.operators)
        for other in tree.grounding.actions:
            if other != action and _without_face(other, tree.operators) == alike:
                yield (*actions[:number], other, *actions[number + 1 :])


def _without_face(action: Action, operators: Sequence[Operator]) -> tuple[str, ...]:
    """Return the name and the arguments of an action, but not the face of an object."""
    kinds = operator_of(action, operators).parameters
    arguments = [
        argument
        for argument, kind in zip(action.arguments, kinds, strict=True)
        if kind != Parameter.FACE
    ]
    return (action.operator, *arguments)
