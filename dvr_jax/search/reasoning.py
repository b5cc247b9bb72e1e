"""Search that a network guides: Algorithm 1 of the paper ("LGP with Deep Visual Reasoning"), and its variant for the
recurrent feasibility classifier.

The network says of each action how promising it is after the prefix before it. The node with the highest prediction
is expanded first; of the sequences found that reach the goal, those are solved whose prediction exceeds a threshold,
which falls as the search goes on. Whatever the network says, every sequence of at most K_max actions is reached in the
end unless a bound has refuted a prefix of it, so nothing that breadth-first search finds is lost.

Beyond the paper: each time that none of the sequences tried was feasible, the next try waits for four times as many
above the threshold and judges their keyframes in one batch; paths are tried in the order of the predictions. Where the
network is right nothing changes; where it is wrong, a batch is many times cheaper than its members one by one."""

from __future__ import annotations

import heapq
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvr_jax.logic import Grounding
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.run import Outcome, Run
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.work import Steps

THRESHOLD = 0.5
"""Prediction above which a sequence is solved, at first (sec. IV-F of the paper)."""

DISCOUNT = 0.9
"""Factor of the threshold each time that too few of the sequences known exceed it for the next try."""

GROWTH = 4
"""Factor of the number of sequences judged at once, each time that none was feasible."""

LARGEST_BATCH = 64
"""Sequences whose keyframes are judged at once, at most."""


class Code(Protocol):
    """A scene as a network has encoded it."""

    def initial_hidden(self) -> NDArray[np.float32]:
        """State before the first action (1, H)."""
        ...


class Network(Protocol):
    """What the search needs of a network (`dvr_jax.model.predictor.Predictor`)."""

    @property
    def size(self) -> Hashable:
        """Equal for networks that run the same compiled programs."""
        ...

    def look(self, scene: Scene) -> Any:
        """What the camera sees of a scene, as the network takes it."""
        ...

    def begin(self, scene: Scene, grounding: Grounding | None = None, images: Any = None) -> Any:
        """Encode a scene, once for a whole search; a `Code`. `images` as `look` gives them; by default it looks."""
        ...

    def step(
        self, code: Any, hidden: NDArray[np.float32], actions: Sequence[int]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Probabilities (B,) of actions (B,) after a prefix with the state (1, H), and the states after them (B, H)."""
        ...


@dataclass(slots=True, eq=False)
class _Candidate:
    """A node with what the network makes of it."""

    node: Node
    probability: float
    hidden: NDArray[np.float32] | None
    """State after the node's actions; None of a sequence that reaches the goal, after which nothing is asked."""


class _ByProbability:
    """Nodes to be expanded, the most promising first."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, _Candidate]] = []
        self._count = count()

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, candidate: _Candidate) -> None:
        heapq.heappush(self._heap, (-candidate.probability, next(self._count), candidate))

    def pop(self, threshold: float) -> _Candidate:
        return heapq.heappop(self._heap)[2]

    def take(self, number: int, threshold: float) -> list[_Candidate]:
        """The `number` most promising that nothing has refuted, if all exceed the threshold, else none; if the
        threshold is negative, as many as there are. Refuted ones are dropped."""
        entries: list[tuple[float, int, _Candidate]] = []
        while self._heap and len(entries) < number:
            entry = heapq.heappop(self._heap)
            if not _is_refuted(entry[2].node):
                entries.append(entry)
        if threshold < 0 or (len(entries) == number and entries[-1][2].probability > threshold):
            return [entry[2] for entry in entries]
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
        while self._heap and (self._heap[0][2].probability > threshold or not self._ready):
            candidate = heapq.heappop(self._heap)[2]
            entry = candidate.node.depth, -candidate.probability, next(self._count), candidate
            heapq.heappush(self._ready, entry)
        return heapq.heappop(self._ready)[3]


def visual_reasoning(run: Run, network: Network) -> Steps[Outcome]:
    """Algorithm 1: the network predicts whether an action leads to the goal."""
    return (yield from _guided(run, network, _ByProbability()))


def feasibility_classifier(run: Run, network: Network) -> Steps[Outcome]:
    """The network predicts whether a prefix is feasible, whatever the goal: breadth-first among the feasible ones."""
    return (yield from _guided(run, network, _ByDepth()))


def _guided(run: Run, network: Network, expand: _ByProbability) -> Steps[Outcome]:
    tree = run.tree
    with run.timed("image"):
        images = network.look(tree.scene)
    with run.timed("network"):
        code = network.begin(tree.scene, tree.grounding, images)
    expand.push(_Candidate(tree.root, 1.0, code.initial_hidden()[0]))
    leaves, threshold, width = _ByProbability(), THRESHOLD, 1
    while expand or leaves:
        tree.solver.look_at_the_clock()
        if expand:
            candidate = expand.pop(threshold)
            if not _is_refuted(candidate.node) and (
                candidate.node is tree.root or tree.check_cached_pose_bound(candidate.node)
            ):
                with run.timed("network"):
                    children = _query(run, network, code, candidate)
                for child in children:
                    (leaves if child.node.reaches_goal else expand).push(child)
        while leaves:
            # With nothing left to expand all sequences are known, and the threshold has done its work.
            batch = leaves.take(width, threshold if expand else -1.0)
            if not batch:
                threshold *= DISCOUNT
                break
            outcome = yield from _try(run, [leaf.node for leaf in batch])
            if outcome is not None:
                return outcome
            width = min(GROWTH * width, LARGEST_BATCH)
    return Outcome(PlanStatus.EXHAUSTED, None, None, run.seconds)


def _query(run: Run, network: Network, code: Any, parent: _Candidate) -> list[_Candidate]:
    """Children of a node that pass the symbolic bound, with their predictions."""
    children = run.tree.expand(parent.node)
    if not children:
        return []
    actions = [run.tree.grounding.index(child.actions[-1]) for child in children]
    assert parent.hidden is not None
    probabilities, after = network.step(code, parent.hidden[None], actions)
    return [
        # Where all reach the goal, as in the last level, nothing keeps the states.
        _Candidate(child, probability, None if child.reaches_goal else hidden)
        for child, probability, hidden in zip(children, probabilities.tolist(), after, strict=True)
    ]


def _try(run: Run, leaves: list[Node]) -> Steps[Outcome | None]:
    """All bounds of leaves, the path bound in the order of their predictions.

    A leaf alone is what the network is sure of; the pose bound, which other leaves share, pays where there are many."""
    run.tree.counts.verdicts["leaf"] += len(leaves)
    passed = yield from (run.judge_leaves(leaves) if len(leaves) > 1 else run.judge_prefix_chains(leaves))
    for leaf in passed:
        outcome = yield from run.try_leaves([leaf])
        if outcome is not None:
            return outcome
    return None


def _is_refuted(node: Node) -> bool:
    """Whether a bound has refuted a node or a prefix of it."""
    prefix: Node | None = node
    while prefix is not None:
        if prefix.feasible is False:
            return True
        prefix = prefix.parent
    return False
