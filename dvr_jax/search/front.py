"""Best-first search of prefixes by the relaxation's bound on the number of actions.

This is A* with the number of actions as the cost. Of the prefixes that may lead to a solution of the least number of
actions, the longest one is expanded first, and all its children are judged in one batch. Among equally long ones those
come first that put nothing onto the region of the goal, where it would be in the way. A prefix is expanded only if
its keyframes are feasible, so the search never completes a sequence whose beginning is impossible. It finds long
solutions, for which there are too many sequences to complete each of them.
"""

from __future__ import annotations

import heapq
from itertools import count

from dvr_jax.search.node import Node
from dvr_jax.search.session import SearchSession
from dvr_jax.search.work import Steps


class PrefixFront:
    """Prefixes with feasible keyframes that are not expanded yet."""

    def __init__(self, session: SearchSession) -> None:
        """Begin at the root of the tree.

        Args:
            session: The search in progress; its relaxation is known.
        """
        self._session = session
        self._count = count()
        self._heap: list[tuple[int, int, int, float, int, Node]] = []
        self._push(session.tree.root)

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
            children = self._session.tree.expand(node)
            passed = yield from self._session.judge_children(children)
            for child in children:
                # The second look is left to the search beside which this one goes on.
                if child.deserves_second_look:
                    child.reopen()
            for child in passed:
                if not child.reaches_goal:
                    self._push(child)
            leaves = [child for child in passed if child.reaches_goal and child.solved is None]
            if leaves:
                return leaves
        return []

    def _push(self, node: Node) -> None:
        """Add a prefix."""
        tree = self._session.tree
        least = node.depth + tree.relaxation.remaining(node.actions)
        regions = tree.scene.region_names
        on_regions = sum(action.arguments[-1] in regions for action in node.actions)
        violation = float(node.beam.violation.min()) if node.beam is not None else 0.0
        key = (least, -node.depth, on_regions, violation, next(self._count))
        heapq.heappush(self._heap, (*key, node))
