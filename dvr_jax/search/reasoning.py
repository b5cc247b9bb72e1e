"""The searches that a network guides: Algorithm 1 of the paper, and a variant for the recurrent feasibility classifier.

The network predicts for each action how promising it is after the prefix before it. The node with the highest
prediction is expanded first. Of the sequences found that reach the goal (the *leaves*), those are solved whose
prediction exceeds a threshold, which decreases during the search. Whatever the network predicts, every sequence of at
most K_max actions is reached in the end unless a bound has refuted a prefix of it, so that these searches are as
complete as breadth-first search.

Three things differ from the paper. If the network's first prediction is right, they change nothing.

- Each time that none of the leaves tried was feasible, the search collects four times as many leaves above the
  threshold before the next try, and judges their keyframes in one batch; their paths are tried in the order of the
  predictions. A batch is many times cheaper than its members one after the other.
- After the first failure the relaxation of the scene is computed (`dvr_jax.search.relaxation`). The search ends if it
  shows that there is no solution, and skips all prefixes that cannot lead to one. If the first leaf had feasible
  keyframes and only its path failed, there mostly is a solution that differs little. Then the next leaves come before
  the relaxation, which is expensive where the motions of windows have to be judged.
- After each failure, a best-first search by the relaxation's bound goes on for a number of prefixes
  (`dvr_jax.search.front`). It finds solutions that are longer than those that the network was trained on. It also gets
  its turn whenever the network has expanded many prefixes without proposing a leaf.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count

import numpy as np
from jaxtyping import Float

from dvr_jax.search.front import PrefixFront
from dvr_jax.search.node import Node
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.session import Outcome, SearchSession
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.work import Steps

THRESHOLD = 0.5
"""Initial threshold; leaves with a prediction above it are solved (sec. IV-F of the paper)."""

DISCOUNT = 0.9
"""Factor by which the threshold decreases each time that it leaves too few leaves for the next try."""

GROWTH = 4
"""Factor by which the number of leaves in a batch grows each time that none of them was feasible."""

LARGEST_BATCH = 64
"""Largest number of leaves whose keyframes are judged in one batch."""


EXPANSIONS = 4
"""After each failure at least this number times the lower bound on the number of actions is the number of prefixes that
the best-first search expands. It gets to a leaf in as many expansions as the bound if it never has to turn back."""

FIRST_EXPANSIONS = 2
"""The same after the first failure, because the network's next leaves are more likely to be right than later ones."""

PATIENCE = 100
"""Number of prefixes that the network expands without proposing a leaf before the best-first search has a turn."""


@dataclass(slots=True, eq=False)
class _Candidate:
    """A node with the network's prediction for it (not to be confused with the candidates of a keyframe beam)."""

    node: Node
    """The node."""

    probability: float
    """The network's prediction for the node's last action."""

    hidden: Float[np.ndarray, " hidden"] | None
    """Hidden state of the network after the node's actions; None for a leaf, which is not expanded."""


class _ByProbability:
    """Nodes to be expanded or tried, the most promising first."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, _Candidate]] = []
        self._count = count()

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, candidate: _Candidate) -> None:
        """Add a candidate."""
        heapq.heappush(self._heap, (-candidate.probability, next(self._count), candidate))

    def pop(self, threshold: float) -> _Candidate:
        """Remove and return the most promising candidate, whatever the threshold."""
        return heapq.heappop(self._heap)[2]

    def take(self, number: int, threshold: float) -> list[_Candidate]:
        """Remove and return the most promising candidates that no bound has refuted; refuted ones are dropped.

        Args:
            number: Number of candidates to return.
            threshold: If fewer than `number` candidates exceed the threshold, none is removed and the result is empty.
                With a negative threshold, all candidates up to `number` are returned.
        """
        entries: list[tuple[float, int, _Candidate]] = []
        while self._heap and len(entries) < number:
            entry = heapq.heappop(self._heap)
            if not _is_refuted(entry[2].node):
                entries.append(entry)

        is_enough = len(entries) == number and entries[-1][2].probability > threshold
        if threshold < 0 or is_enough:
            return [candidate for _, _, candidate in entries]
        for entry in entries:
            heapq.heappush(self._heap, entry)
        return []


class _ByDepth(_ByProbability):
    """Nodes to be expanded, the shortest first; those that are predicted infeasible wait until the threshold falls."""

    def __init__(self) -> None:
        super().__init__()
        self._ready: list[tuple[int, float, int, _Candidate]] = []

    def __len__(self) -> int:
        return len(self._heap) + len(self._ready)

    def pop(self, threshold: float) -> _Candidate:
        """Remove and return the shortest candidate above the threshold, or the most promising one."""
        while self._heap and (-self._heap[0][0] > threshold or not self._ready):
            candidate = heapq.heappop(self._heap)[2]
            entry = (candidate.node.depth, -candidate.probability, next(self._count), candidate)
            heapq.heappush(self._ready, entry)
        return heapq.heappop(self._ready)[3]


def visual_reasoning(
    session: SearchSession, network: SequencePredictor[Images, Encoding]
) -> Steps[Outcome]:
    """Search by Algorithm 1 of the paper: the network predicts whether an action leads to a feasible sequence.

    Args:
        session: The search in progress.
        network: A network of the kind "dvr".
    """
    return (yield from _guided(session, network, _ByProbability()))


def feasibility_classifier(
    session: SearchSession, network: SequencePredictor[Images, Encoding]
) -> Steps[Outcome]:
    """Search breadth-first among the prefixes that the network predicts to be feasible, independent of the goal.

    Args:
        session: The search in progress.
        network: A network of the kind "classifier".
    """
    return (yield from _guided(session, network, _ByDepth()))


def _guided(
    session: SearchSession, network: SequencePredictor[Images, Encoding], to_expand: _ByProbability
) -> Steps[Outcome]:
    """Search with a network's predictions; `to_expand` determines the order in which nodes are expanded."""
    tree = session.tree
    if tree.is_refuted_at_once() and not (yield from session.judge_scene()):
        return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)

    session.relaxes_first = True

    # The images of the initial scene are rendered and encoded once.
    with session.timed("image"):
        images = network.render(tree.scene)
    with session.timed("network"):
        encoding = network.encode_scene(tree.scene, tree.grounding, images)
    to_expand.push(_Candidate(tree.root, 1.0, encoding.initial_hidden()[0]))

    front = PrefixFront(session)
    leaves = _ByProbability()
    threshold = THRESHOLD
    width = 1
    failures = 0
    expanded = 0
    while to_expand or leaves:
        tree.solver.look_at_the_clock()
        if expanded == PATIENCE:
            # The network goes on for long without a proposal, as it does where solutions are longer than it knows.
            expanded = 0
            outcome = yield from _advance(session, front, 0, EXPANSIONS)
            if outcome is not None:
                return outcome
        if to_expand:
            expanded += 1
            for child in _expand(session, network, encoding, to_expand.pop(threshold)):
                (leaves if child.node.reaches_goal else to_expand).push(child)

        while leaves:
            # If no node is left to expand, all leaves are known, and they are tried whatever the threshold is.
            batch = leaves.take(width, threshold if to_expand else -1.0)
            if not batch:
                threshold *= DISCOUNT
                break
            tried_paths = tree.counts.verdicts["path"]
            outcome = yield from _try(session, [leaf.node for leaf in batch])
            if outcome is not None:
                return outcome
            failures += 1
            expanded = 0
            width = min(GROWTH * width, LARGEST_BATCH)
            if failures > 1:
                outcome = yield from _advance(session, front, width, EXPANSIONS)
            elif tree.counts.verdicts["path"] == tried_paths:
                # Nothing but a path is missing where the first leaf had keyframes: the next leaves come first then.
                outcome = yield from _advance(session, front, 0, FIRST_EXPANSIONS)
            if outcome is not None:
                return outcome

    # The relaxation may know a reason, also if it was not needed.
    yield from session.judge_scene()
    return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)


def _advance(
    session: SearchSession, front: PrefixFront, least: int, factor: int
) -> Steps[Outcome | None]:
    """Go on by the relaxation after the network's leaves have failed.

    Args:
        session: The search in progress.
        front: The best-first search beside the network's.
        least: Least number of prefixes that the best-first search expands.
        factor: The same as a multiple of the lower bound on the number of actions.

    Returns:
        How the search ends; None if it goes on.
    """
    if not (yield from session.judge_scene()):
        return Outcome(PlanStatus.EXHAUSTED, seconds=session.seconds)
    if not session.tree.is_relaxed:
        return None
    expansions = max(least, factor * session.tree.relaxation.lower_bound)
    return (yield from session.try_leaves((yield from front.advance(expansions))))


def _expand(
    session: SearchSession,
    network: SequencePredictor[Images, Encoding],
    encoding: Encoding,
    parent: _Candidate,
) -> list[_Candidate]:
    """Return the children of a node that pass the symbolic bound, with predictions; a refuted node has none."""
    tree = session.tree
    if _is_refuted(parent.node):
        return []
    if parent.node is not tree.root and not tree.check_cached_pose_bound(parent.node):
        return []
    with session.timed("network"):
        children = tree.expand(parent.node)
        if not children:
            return []
        actions = [tree.grounding.index(child.actions[-1]) for child in children]
        assert parent.hidden is not None
        probabilities, after = network.predict(encoding, parent.hidden[None], actions)
    return [
        # The hidden states of leaves are not stored, because leaves are not expanded.
        _Candidate(child, probability, None if child.reaches_goal else hidden)
        for child, probability, hidden in zip(children, probabilities.tolist(), after, strict=True)
    ]


def _try(session: SearchSession, leaves: list[Node]) -> Steps[Outcome | None]:
    """Compute all bounds of leaves, the path bound in the order of their predictions, until a path is accepted.

    A single leaf is one that the network is confident about, so its sequence bound is computed at once. The verdicts of
    the pose bound are shared by many leaves, so the pose bound is worthwhile only for several leaves.
    """
    session.tree.counts.verdicts["leaf"] += len(leaves)
    if len(leaves) > 1:
        passed = yield from session.judge_leaves(leaves)
    else:
        passed = yield from session.judge_prefix_chains(leaves)
    for leaf in passed:
        outcome = yield from session.try_leaves([leaf])
        if outcome is not None:
            return outcome
    return None


def _is_refuted(node: Node) -> bool:
    """Return whether a bound has refuted a node or a prefix of it."""
    prefix: Node | None = node
    while prefix is not None:
        if prefix.feasible is False:
            return True
        prefix = prefix.parent
    return False
