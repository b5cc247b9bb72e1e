"""The labelling of one scene: its sequences are judged in order of length until enough of them are feasible."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from dvr_jax.dataset.labels import Label
from dvr_jax.errors import DvrError
from dvr_jax.scene.files import scene_to_json
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.searches import multi_bound
from dvr_jax.search.session import Outcome, SearchSession
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps
from dvr_jax.solver.lane_pool import NlpSolution


@dataclass(frozen=True, slots=True)
class LabelOptions:
    """What the labels of a scene depend on, besides the scene.

    A scene is done when one of three limits is reached: the number of solutions, the number of judged sequences, or the
    length.
    """

    solutions: int = 4
    """Number of known feasible sequences after which a scene is done."""

    leaves: int = 1000
    """Number of judged sequences that reach the goal after which a scene is done.

    Sequences that the pose bound refutes do not count.
    """

    k_max: int = 6
    """Largest number of actions; a scene is done when all these sequences have been judged."""

    seed: int = 0
    """Seed of the keyframe beam, and of the order in which sequences of one length are judged."""


Accept = Callable[[Scene, Node, NlpSolution], bool]
"""A function that says whether the independent check accepts a feasible path of a scene."""


class Labelling(SearchSession):
    """A multi-bound search that goes on after its first solution."""

    def __init__(
        self, tree: SequenceTree, scene: Scene, options: LabelOptions, accept: Accept
    ) -> None:
        """Prepare the search.

        Args:
            tree: the sequences of the scene.
            scene: the scene.
            options: when the search ends.
            accept: the independent check of a path.
        """
        super().__init__(tree, lambda node, path: accept(scene, node, path), lambda line: None)
        self.options = options
        self.order = random.Random(f"{options.seed} {scene_to_json(scene)}")
        self.solved = 0
        self.judged = 0

    def arrange(self, leaves: list[Node]) -> list[Node]:
        """Put leaves into random order.

        In the order of the logic, all solutions of a scene would begin with the same actions.
        """
        return self.order.sample(leaves, len(leaves))

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Judge leaves by the sequence bound, and count them."""
        self.judged += len(leaves)
        return (yield from super().judge_prefix_chains(leaves))

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        """Solve the paths of leaves in their order; there is an outcome once enough is known."""
        for leaf in leaves:
            outcome = yield from self.try_path(leaf)
            if outcome is None:
                continue
            self.solved += 1
            if self.solved >= self.options.solutions:
                return outcome

        # Any outcome ends the search; nobody reads this one.
        if self.judged >= self.options.leaves:
            return Outcome(PlanStatus.EXHAUSTED)
        return None


def label_scene(
    scene: Scene, index: int, options: LabelOptions, accept: Accept
) -> Steps[list[Label]]:
    """Judge sequences of one scene, level by level as multi-bound search visits them, at random within a level.

    A sequence is feasible if its path meets the tolerances of the NLP and `accept` accepts it. A refuted prefix is one
    label.

    Args:
        scene: the scene.
        index: index of the scene in its file.
        options: what the labels depend on.
        accept: the independent check of a path.

    Returns:
        The labels, in no particular order.

    Raises:
        DvrError: the scene has no sequence tree; the message names its index.
    """
    try:
        tree = SequenceTree(scene, options.k_max, options.seed, is_relaxed=False)
    except DvrError as error:
        raise DvrError(f"scene {index}: {error}") from None

    yield from multi_bound(Labelling(tree, scene, options, accept))
    return list(_labels(tree, tree.root, index))


def _labels(tree: SequenceTree, node: Node, index: int) -> Iterator[Label]:
    """Yield the label of a node or, where the node has no verdict of its own, the labels below it."""
    actions = tuple(map(str, node.actions))
    if node.feasible is False:
        yield Label(index, actions, False, not node.reaches_goal, node.refuted_by, node.violation)
        return
    if node.solved is not None:
        yield Label(index, actions, node.solved, False, node.refuted_by, node.violation)
        return
    if node.children is None:
        return

    # Actions that a constant of the scene refutes are no children: one label for each prefix known to be feasible.
    if node.feasible:
        for action in tree.statically_infeasible_actions(node):
            yield Label(index, (*actions, str(action)), False, True, "symbolic", math.nan)
    for child in node.children:
        yield from _labels(tree, child, index)
