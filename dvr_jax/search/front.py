"""Best-first search of prefixes by the relaxation's bound on the number of actions.

This is A* with the number of actions as the cost. Of the prefixes that may lead to a solution of the least number of
actions, the longest one is expanded first, and all its children are judged in one batch. Among equally long ones those
come first that put nothing onto a region where no fact of the goal wants it, because it would be in the way. A prefix
is expanded only if its keyframes are feasible, so the search never completes a sequence whose beginning is impossible.
It finds long solutions, for which there are too many sequences to complete each of them. An object that was delivered
is moved again only where no other sequence remains, because that raises the bound.

A guide may rank the children of a prefix. Then only the `WIDTH` most promising ones are judged at first, and the others
when nothing better is left.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from itertools import count
from typing import Protocol

from dvr_jax.scene.start import end_conditions, objects_as_supports
from dvr_jax.search.node import Node
from dvr_jax.search.session import SearchSession
from dvr_jax.search.work import Steps

WIDTH = 8
"""Number of children of a prefix that are judged at a time if a guide ranks them."""


class Guide(Protocol):
    """Ranks the children of prefixes, as `dvr_jax.search.goal_guide.GoalGuide` does."""

    def rank(self, node: Node, children: Sequence[Node]) -> list[float]:
        """Return how promising children are: the larger, the better.

        Args:
            node: A prefix.
            children: Prefixes that are one action longer.
        """
        ...


class PrefixFront:
    """Prefixes with feasible keyframes that are not expanded yet, or not with all of their children."""

    def __init__(self, session: SearchSession, guide: Guide | None = None) -> None:
        """Begin at the root of the tree.

        Args:
            session: The search in progress; its relaxation is known.
            guide: Ranks the children of prefixes; None judges all children of a prefix at once.
        """
        self._session = session
        self._guide = guide
        self._count = count()
        self._heap: list[tuple[int, int, int, float, float, int, Node]] = []
        self._waiting: dict[Node, list[tuple[Node, float]]] = {}
        self._wanted = _wanted_places(session)
        scene = session.tree.scene
        self._places = frozenset((*scene.region_names, *objects_as_supports(scene)))
        self._push(session.tree.root, 0.0)

    def __len__(self) -> int:
        return len(self._heap)

    def advance(self, expansions: int) -> Steps[list[Node]]:
        """Expand prefixes until feasible leaves are found.

        Args:
            expansions: Largest number of prefixes to expand.

        Returns:
            Leaves with feasible keyframes that have not been tried, children of one prefix; none if no prefix has any.
        """
        for _ in range(expansions):
            if not self._heap:
                break
            node = heapq.heappop(self._heap)[-1]
            ranked = self._next_children(node)
            children = [child for child, _ in ranked]
            passed = yield from self._session.judge_children(children)
            rank_of = dict(ranked)
            for child in children:
                # The second look is left to the search beside which this one goes on.
                if child.deserves_second_look:
                    child.reopen()
            for child in passed:
                if not child.reaches_goal:
                    self._push(child, rank_of[child])
            leaves = [child for child in passed if child.reaches_goal and child.solved is None]
            if leaves:
                return leaves
        return []

    def _next_children(self, node: Node) -> list[tuple[Node, float]]:
        """Return the next children of a prefix to be judged, with their ranks; the prefix stays if there are more."""
        if self._guide is None:
            return [(child, 0.0) for child in self._session.tree.expand(node)]
        if node not in self._waiting:
            children = self._session.tree.expand(node)
            with self._session.timed("network"):
                ranks = self._guide.rank(node, children) if children else []
            ranked = list(zip(children, ranks, strict=True))
            self._waiting[node] = sorted(ranked, key=lambda pair: -pair[1])

        chosen = self._waiting[node][:WIDTH]
        self._waiting[node] = self._waiting[node][WIDTH:]
        if self._waiting[node]:
            self._push(node, self._waiting[node][0][1])
        return chosen

    def _push(self, node: Node, rank: float) -> None:
        """Add a prefix."""
        tree = self._session.tree
        least = node.depth + tree.relaxation.remaining(node.actions)
        in_the_way = sum(
            action.arguments[-1] in self._places and (action.arguments[1:] not in self._wanted)
            for action in node.actions
        )
        violation = float(node.beam.violation.min()) if node.beam is not None else 0.0
        key = (least, -node.depth, in_the_way, -rank, violation, next(self._count))
        heapq.heappush(self._heap, (*key, node))


def _wanted_places(session: SearchSession) -> frozenset[tuple[str, ...]]:
    """Return the objects and regions of the facts of a goal that has several of them.

    A sequence for the paper's goal ends when its only fact holds, so no prefix has put the object there.
    """
    conditions = end_conditions(session.tree.scene)
    return frozenset(
        (condition.item, condition.fact[-1])
        for condition in conditions
        if condition.holds and condition.fact[0] == "on"
    )
