"""A network that was trained on one object and one region guides a search for several facts.

Each fact "object on region" that is still open is a goal that the network knows. It is asked for each of them: what is
the probability that an action is promising for this object and this region? An action counts as promising as it is for
the fact that it serves best, so the largest probability ranks it: one fact after the other has to become true, and
their order is free. A mean would rank actions low that serve a single fact.

The network was trained on sequences that end when their goal holds. When a fact has become true and all hands are
empty, the histories for the other facts therefore start anew, as if the scene began there. The image stays that of the
initial scene. The ranks decide only in which order prefixes are examined, so they may be wrong without a solution being
missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np
from jaxtyping import Float

from dvr_jax.goals import GOAL_REGION, TABLE, On, OnRegion
from dvr_jax.logic import Action, Grounding
from dvr_jax.operators import Operator, Parameter, ground_scene, operator_of
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor
from dvr_jax.search.tree import SequenceTree


@dataclass(frozen=True, slots=True)
class _Question(Generic[Encoding]):
    """What the network is asked about one fact."""

    fact: On
    """The fact."""

    encoding: Encoding
    """The scene with this fact as its goal."""

    number: dict[Action, int]
    """Number that the network gives to each action of the scene."""


class GoalGuide(Generic[Images, Encoding]):
    """Ranks the actions after a prefix by the facts that are still open."""

    def __init__(self, tree: SequenceTree, network: SequencePredictor[Images, Encoding]) -> None:
        """Encode the scene once for each fact "object on region".

        Args:
            tree: Tree of the scene's sequences.
            network: The network.
        """
        self._tree = tree
        self._network = network
        self._questions = [
            self._question(fact) for fact in tree.scene.goal.facts if isinstance(fact, On)
        ]
        self._hidden: dict[tuple[int, tuple[Action, ...]], Float[np.ndarray, "1 hidden"]] = {}

    def _question(self, fact: On) -> _Question[Encoding]:
        """Encode the scene with one fact as the goal."""
        scene = scene_of_fact(self._tree.scene, fact)
        grounding = ground_scene(scene, self._tree.operators)
        encoding = self._network.encode_scene(scene, grounding, self._network.render(scene))
        number = {
            action: grounding.index(action_for_fact(action, fact, self._tree.operators))
            for action in self._tree.grounding.actions
        }
        return _Question(fact, encoding, number)

    def rank(self, node: Node, children: Sequence[Node]) -> list[float]:
        """Return how promising children of a node are, by their last actions: the larger, the better.

        Args:
            node: A prefix.
            children: Prefixes that are one action longer.
        """
        actions = [child.actions[-1] for child in children]
        best = np.zeros(len(actions))
        for index, question in enumerate(self._questions):
            if not _is_open(self._tree.grounding, node, question.fact):
                continue
            numbers = [question.number[action] for action in actions]
            before = self._state_after(index, node)
            probabilities, _ = self._network.predict(question.encoding, before, numbers)
            best = np.maximum(best, probabilities)
        return [float(value) for value in best]

    def _state_after(self, index: int, node: Node) -> Float[np.ndarray, "1 hidden"]:
        """Return the network's hidden state after a prefix, for the question of this index."""
        key = (index, node.actions)
        if key not in self._hidden:
            question = self._questions[index]
            if node.parent is None or self._begins_anew(node):
                self._hidden[key] = question.encoding.initial_hidden()
            else:
                before = self._state_after(index, node.parent)
                number = question.number[node.actions[-1]]
                _, after = self._network.predict(question.encoding, before, [number])
                self._hidden[key] = after
        return self._hidden[key]

    def _begins_anew(self, node: Node) -> bool:
        """Return whether the last action made a fact true, and all hands are empty."""
        assert node.parent is not None
        grounding = self._tree.grounding
        if any(fact[0] == "holding" for fact in grounding.facts_in(node.state)):
            return False
        return any(
            _is_open(grounding, node.parent, question.fact)
            and not _is_open(grounding, node, question.fact)
            for question in self._questions
        )


def _is_open(grounding: Grounding, node: Node, fact: On) -> bool:
    """Return whether a fact does not hold after a prefix."""
    return not grounding.holds(node.state, "on", fact.object, fact.support)


def scene_of_fact(scene: Scene, fact: On) -> Scene:
    """Return a scene whose goal is one fact, as in the paper.

    Args:
        scene: A scene with a goal of several facts.
        fact: One of them.
    """
    region = replace(scene.region(fact.support), name=GOAL_REGION)
    return replace(scene, goal=OnRegion(fact.object, region), regions=())


def action_for_fact(action: Action, fact: On, operators: Sequence[Operator]) -> Action:
    """Return an action in the scene of one fact: the fact's region is the goal region, and all others are the table.

    Args:
        action: An action of the whole scene.
        fact: The fact.
        operators: The operators that are known.
    """
    kinds = operator_of(action, operators).parameters

    def renamed(argument: str, kind: Parameter) -> str:
        if kind != Parameter.SUPPORT:
            return argument
        return GOAL_REGION if argument == fact.support else TABLE

    return replace(action, arguments=tuple(map(renamed, action.arguments, kinds)))
