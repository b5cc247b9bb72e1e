"""Labels of one scene: its sequences in order of length, until enough of them are feasible."""

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
from dvr_jax.search.run import Outcome, Run
from dvr_jax.search.searches import multi_bound
from dvr_jax.search.status import PlanStatus
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps
from dvr_jax.solver.engine import NlpSolution


@dataclass(frozen=True, slots=True)
class LabelOptions:
    """What the labels of a scene depend on, besides the scene."""

    solutions: int = 4
    """A scene is done when so many feasible sequences are known ..."""
    leaves: int = 1000
    """... or when so many sequences that reach the goal have been judged (those that the pose bound refutes do not
    count) ..."""
    k_max: int = 6
    """... or when all sequences of at most so many actions have."""
    seed: int = 0
    """Of the particles, and of the order in which sequences of one length are judged."""


Accept = Callable[[Scene, Node, NlpSolution], bool]
"""Whether the independent check accepts a feasible path of a scene."""


class Labelling(Run):
    """A multi-bound search that goes on after its first solution."""

    def __init__(self, tree: SequenceTree, scene: Scene, options: LabelOptions, accept: Accept) -> None:
        super().__init__(tree, lambda node, path: accept(scene, node, path), lambda line: None)
        self.options = options
        self.order = random.Random(f"{options.seed} {scene_to_json(scene)}")
        self.solved = self.judged = 0

    def arrange(self, leaves: list[Node]) -> list[Node]:
        """At random: in the order of the logic, all solutions of a scene would begin with the same actions."""
        return self.order.sample(leaves, len(leaves))

    def judge_prefix_chains(self, leaves: list[Node]) -> Steps[list[Node]]:
        """Sequence bound of leaves, which are counted."""
        self.judged += len(leaves)
        return (yield from super().judge_prefix_chains(leaves))

    def try_leaves(self, leaves: list[Node]) -> Steps[Outcome | None]:
        """Paths of the leaves in their order; an outcome once there is enough of them."""
        for leaf in leaves:
            outcome = yield from self.try_path(leaf)
            self.solved += outcome is not None
            if outcome is not None and self.solved >= self.options.solutions:
                return outcome
        # Any outcome ends the search; nobody reads this one.
        return Outcome(PlanStatus.EXHAUSTED, None, None) if self.judged >= self.options.leaves else None


def label_scene(scene: Scene, index: int, options: LabelOptions, accept: Accept) -> Steps[list[Label]]:
    """Verdicts on sequences of one scene, level by level as multi-bound search visits them, at random within a level.

    A sequence is feasible if its path passes the NLP's tolerances and ``accept``. A refuted prefix is one label.
    """
    try:
        tree = SequenceTree(scene, options.k_max, options.seed)
    except DvrError as error:
        raise DvrError(f"scene {index}: {error}") from None
    yield from multi_bound(Labelling(tree, scene, options, accept))
    return list(_labels(tree, tree.root, index))


def _labels(tree: SequenceTree, node: Node, index: int) -> Iterator[Label]:
    """Labels of a node or, where it has no verdict of its own, of those below it."""
    actions = tuple(map(str, node.actions))
    if node.feasible is False:
        yield Label(index, actions, False, not node.reaches_goal, node.refuted_by, node.violation)
    elif node.solved is not None:
        yield Label(index, actions, node.solved, False, node.refuted_by, node.violation)
    elif node.children is not None:
        if node.feasible:
            # What is too large for the gripper or for its support, once for each prefix known to be feasible.
            for action in tree.statically_infeasible_actions(node):
                yield Label(index, (*actions, str(action)), False, True, "symbolic", math.nan)
        for child in node.children:
            yield from _labels(tree, child, index)
