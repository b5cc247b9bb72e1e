"""Explains what a search has refuted: single sequences, and the scene as a whole (`dvr_jax.search.reasons`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import object_of, operator_of
from dvr_jax.search.node import Node
from dvr_jax.search.object_graph import UNREACHED, Edge
from dvr_jax.search.reasons import (
    NO_MOTION,
    Reason,
    ReasonKind,
    evidence_reason,
    obstruction_reason,
    outline,
    reach_reason,
    static_reason,
)
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.windows import Window, last_windows

PROMISING = 3
"""Number of refuted sequences that a plan reports."""

_ORDER = ("check", "path", "sequence", "pose", "symbolic")
"""Bounds, from the one that judges the most promising sequences."""


@dataclass(frozen=True, slots=True)
class Refutation:
    """A sequence, or the beginning of sequences, that a search has refuted."""

    actions: tuple[Action, ...]
    """The actions, up to the one that is impossible."""

    bound: str
    """The bound that refuted them."""

    reason: Reason
    """What is impossible."""


def explain_node(tree: SequenceTree, node: Node) -> Reason | None:
    """Return why a node, or a prefix of it, is refuted; None if nothing is known of it.

    Args:
        tree: The tree of the node.
        node: The node.
    """
    refuted: Node | None = node
    while refuted is not None and not refuted.refuted_by:
        refuted = refuted.parent
    if refuted is None:
        return None
    if refuted.refuted_by == "symbolic":
        return static_reason(tree.scene, refuted.actions[-1], tree.operators)

    blocker = tree.relaxation.obstruction(refuted.actions)
    if blocker is not None:
        return obstruction_reason(tree.scene, refuted.actions[-1], blocker, tree.operators)
    judged = refuted.source or refuted
    if judged.evidence is None:
        return _window_reason(tree, last_windows(refuted.actions, tree.operators))
    reason = evidence_reason(tree.scene, judged.actions, *judged.evidence, tree.operators)
    if refuted.refuted_by in ("path", "check"):
        sentence = NO_MOTION + reason.sentence
        return replace(reason, kind=ReasonKind.MOTION, sentence=sentence)
    return reason


def promising_refutations(tree: SequenceTree, number: int = PROMISING) -> list[Refutation]:
    """Return the refuted prefixes that came closest to a solution.

    Args:
        tree: A tree that was searched.
        number: Largest number of prefixes.
    """

    def rank(node: Node) -> tuple[int, int, float]:
        violation = node.violation if math.isfinite(node.violation) else math.inf
        return _ORDER.index(node.refuted_by), -node.depth, violation

    found = []
    for node in sorted(_refuted_nodes(tree.root), key=rank)[:number]:
        reason = explain_node(tree, node)
        if reason is not None:
            found.append(Refutation(node.actions, node.refuted_by, reason))
    return found


def _refuted_nodes(root: Node) -> Iterator[Node]:
    """Yield the nodes that are refuted themselves."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if node.refuted_by:
            yield node
        waiting += node.children or []


def explain_scene(tree: SequenceTree) -> Reason | None:
    """Return why a scene has no solution of at most `k_max` actions; None if no reason is known for all sequences.

    Args:
        tree: A tree whose relaxation was computed.
    """
    relaxation = tree.relaxation
    if relaxation.lower_bound <= tree.k_max:
        return None
    needed = relaxation.least_without_limit()
    if tree.k_max < needed < UNREACHED:
        return _actions_reason(tree, needed)

    name = relaxation.goal_object
    if relaxation.alone >= UNREACHED:
        return _object_reason(tree, name)
    for blocker in sorted(relaxation.immovable()):
        reason = _first_reason(tree, blocker)
        if reason is not None:
            sentence = f"'{blocker}' stands in the way and cannot be moved. {reason.sentence}"
            return replace(reason, sentence=sentence)
    return None


def _actions_reason(tree: SequenceTree, needed: int) -> Reason:
    """Return the reason that more actions are needed than are allowed."""
    blockers = sorted(tree.relaxation.required)
    cause = ""
    if blockers:
        quoted = [f"'{name}'" for name in blockers]
        listed = " and ".join([*([", ".join(quoted[:-1])] if quoted[1:] else []), quoted[-1]])
        verb = "has" if len(blockers) == 1 else "have"
        cause = f", because {listed} {verb} to be moved out of the way"
    sentence = (
        f"The scene needs at least {needed} actions{cause}; "
        f"{tree.k_max} are allowed (try --k-max {needed})."
    )
    missing = float(needed - tree.k_max)
    return Reason(ReasonKind.ACTIONS, "", tuple(blockers), missing, sentence)


def _object_reason(tree: SequenceTree, name: str) -> Reason | None:
    """Return why an object cannot get to the goal even if it is alone in the world."""
    graph = tree.relaxation.walks.graph(name)
    impossible = _static_reason_of_all(tree, name, ModeKind.PLACED)
    if impossible is not None:
        return impossible
    first = _first_reason(tree, name)
    if first is not None:
        return first

    # No way into the goal is open, or no way leads from the first grasps to these.
    is_open = tree.relaxation.walks.is_open(name)
    last = [edge for goal in graph.goals for edge in graph.edges_to[goal]]
    if not any(map(is_open, last)):
        return _join(
            tree, last, "No arm reaches the target", f"No arm can place '{name}' on the target"
        )
    between = [edge for edge in graph.edges if not is_open(edge)]
    return _join(
        tree,
        between,
        "No arm reaches what it has to",
        f"No arm that can grasp '{name}' can place it on the target, or pass it on to one that can",
    )


def _first_reason(tree: SequenceTree, name: str) -> Reason | None:
    """Return why no arm can grasp an object where it stands; None if one can."""
    impossible = _static_reason_of_all(tree, name, ModeKind.HELD)
    if impossible is not None:
        return impossible
    graph = tree.relaxation.walks.graph(name)
    first = graph.edges_from[graph.root]
    if any(map(tree.relaxation.walks.is_open(name), first)):
        return None
    return _join(
        tree, first, f"No arm reaches '{name}'", f"No arm can grasp '{name}' where it stands"
    )


def _static_reason_of_all(tree: SequenceTree, name: str, mode: ModeKind) -> Reason | None:
    """Return why the constants of the scene allow no grasp of an object, or no place on the target; None if they do.

    Args:
        tree: The tree.
        name: Name of the object.
        mode: Mode after the actions: held or placed.
    """
    actions = [
        action
        for action in tree.grounding.actions
        if object_of(action, tree.operators) == name
        and operator_of(action, tree.operators).mode_after == mode
        and (mode == ModeKind.HELD or action.arguments[-1] in tree.scene.region_names)
    ]
    reasons = [static_reason(tree.scene, action, tree.operators) for action in actions]
    known = [reason for reason in reasons if reason is not None]
    if not known or len(known) < len(reasons):
        return None
    return _general(tree, min(known, key=_amount), name)


def _general(tree: SequenceTree, reason: Reason, name: str) -> Reason:
    """Return a reason of one action as one of a whole object."""
    if reason.kind != ReasonKind.WIDTH:
        return replace(reason, action="")
    item = tree.scene.objects[tree.scene.object_index(name)]
    opening = 100 * tree.scene.workcell.robot.maximum_opening
    sentence = f"'{name}' is {outline(item)} cm; the gripper opens {opening:.3g} cm."
    return replace(reason, action="", sentence=sentence)


def _join(tree: SequenceTree, edges: Iterable[Edge], reach: str, other: str) -> Reason | None:
    """Return the reason that comes closest among those of refuted edges, with a sentence for all of them.

    Args:
        tree: The tree.
        edges: The edges.
        reach: Beginning of the sentence if all of them are out of reach.
        other: Beginning of the sentence otherwise.
    """
    reasons = [r for r in (_window_reason(tree, edge.windows) for edge in edges) if r is not None]
    if not reasons:
        return None
    near = [
        reason
        for reason in reasons
        if reason.kind != ReasonKind.REACH or "reach" not in reason.sentence
    ]
    if near:
        best = min(near, key=_amount)
        return replace(best, sentence=f"{other}. {best.sentence}")
    best = min(reasons, key=_amount)
    where = best.sentence.partition(": ")[2].replace("the base", "the nearer base")
    return replace(best, action="", sentence=f"{reach}: {where}")


def _window_reason(tree: SequenceTree, windows: Iterable[Window | None]) -> Reason | None:
    """Return why one of some windows is refuted, or None."""
    bound = tree.relaxation.windows
    for window in windows:
        if window is None:
            continue
        name = object_of(_last(window), tree.operators)
        others = tree.relaxation.walks.others(name)
        if bound.verdict(window, others) is not False:
            continue
        node = bound.node(window, others)
        if node is None or node.evidence is None:
            return reach_reason(tree.scene, window, tree.operators)
        return evidence_reason(tree.scene, node.actions, *node.evidence, tree.operators)
    return None


def _last(window: Window) -> Action:
    """Return the last action of a window."""
    action = window[-1]
    assert action is not None
    return action


def _amount(reason: Reason) -> float:
    """Return the amount of a reason, infinite if it is not known."""
    return reason.amount if math.isfinite(reason.amount) else math.inf
