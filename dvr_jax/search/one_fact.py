"""A network that was trained on one object and one region guides the search for a goal of one such fact, as it is.

A goal that one object is on a region, and perhaps that all hands are empty, differs from the paper's only in what the
other hands hold at the end. The network is shown the scene with the paper's goal, and its predictions for the actions
of that scene are those for the actions of the given one. Goals of more facts need `dvr_jax.search.goal_guide`, and so
do scenes where several objects stand on the region: they have longer solutions than those that the network has seen.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.footprint import signed_distance
from dvr_jax.goals import HandsEmpty, On, OnRegion
from dvr_jax.logic import Grounding
from dvr_jax.operators import Operator, ground_scene
from dvr_jax.scene.types import Scene
from dvr_jax.search.goal_guide import action_for_fact, scene_of_fact
from dvr_jax.search.predictor import Encoding, Images, SequencePredictor

MOST_ON_REGION = 1
"""Largest number of objects on the goal's region at the start, as in the scenes that the networks were trained on."""


def only_fact(scene: Scene) -> On | None:
    """Return the fact that an object is on a region, if the goal and the scene are much like the paper's.

    The goal consists of this fact and of empty hands at most, and few objects stand on the region.
    """
    facts = [fact for fact in scene.goal.facts if not isinstance(fact, HandsEmpty)]
    if len(facts) != 1 or not isinstance(facts[0], On):
        return None

    fact = facts[0]
    if fact.support not in scene.region_names:
        return None
    area = scene.region(fact.support).footprint
    others = [item.footprint for item in scene.objects if item.name != fact.object]
    on_region = sum(signed_distance(area, footprint) < 0 for footprint in others)
    return fact if on_region <= MOST_ON_REGION else None


@dataclass(frozen=True, slots=True)
class _FactEncoding(Generic[Encoding]):
    """A scene as the network is shown it."""

    encoding: Encoding
    """The encoding of the scene with the paper's goal."""

    numbers: tuple[int, ...]
    """Number that the network gives to each action of the given scene."""

    def initial_hidden(self) -> Float[np.ndarray, "1 hidden"]:
        """Return the hidden state before the first action."""
        return self.encoding.initial_hidden()


class OneFactNetwork(Generic[Images, Encoding]):
    """A network for scenes with the paper's goal, used for scenes whose goal is one fact; a `SequencePredictor`."""

    def __init__(
        self, network: SequencePredictor[Images, Encoding], operators: Sequence[Operator]
    ) -> None:
        """Keep the network.

        Args:
            network: A network for scenes with the paper's goal.
            operators: The operators that are known.
        """
        self._network = network
        self._operators = operators

    @property
    def kind(self) -> str:
        """Name of the search that the network guides, such as "dvr"."""
        return self._network.kind

    @property
    def checksum(self) -> str:
        """Checksum of the network's parameters."""
        return self._network.checksum

    @property
    def size(self) -> Hashable:
        """Sizes of the network."""
        return self._network.size

    def unfit_reason(self, scene: Scene, operators: Sequence[Operator]) -> str | None:
        """Say why the network cannot guide a search; None if it fits.

        Args:
            scene: The scene.
            operators: Operators that the plan may consist of.
        """
        return self._network.unfit_reason(scene, operators)

    def render(self, scene: Scene) -> Images:
        """Return the images of a scene in the form that the network takes."""
        return self._network.render(scene_of_fact(scene, _require_fact(scene)))

    def encode_scene(
        self,
        scene: Scene,
        grounding: Grounding | None = None,
        images: Images | None = None,
    ) -> _FactEncoding[Encoding]:
        """Encode a scene once for a whole search.

        Args:
            scene: The scene; its goal is one fact.
            grounding: The grounded actions of the scene; None computes them.
            images: What `render` returned for the scene; None renders it.
        """
        fact = _require_fact(scene)
        known = grounding if grounding is not None else ground_scene(scene, self._operators)
        shown = scene_of_fact(scene, fact)
        shown_grounding = ground_scene(shown, self._operators)
        numbers = tuple(
            shown_grounding.index(action_for_fact(action, fact, self._operators))
            for action in known.actions
        )
        encoding = self._network.encode_scene(shown, shown_grounding, images)
        return _FactEncoding(encoding, numbers)

    def predict(
        self,
        encoding: _FactEncoding[Encoding],
        hidden: Float[np.ndarray, "1 hidden"],
        actions: Sequence[int],
    ) -> tuple[Float[np.ndarray, " actions"], Float[np.ndarray, "actions hidden"]]:
        """Predict how promising each of several next actions is.

        Args:
            encoding: The encoding of the scene.
            hidden: The hidden state after the actions taken so far.
            actions: Candidates for the next action, as indices into the actions of the scene's grounding.
        """
        numbers = [encoding.numbers[action] for action in actions]
        return self._network.predict(encoding.encoding, hidden, numbers)


def network_for(
    scene: Scene, network: SequencePredictor[Images, Encoding], operators: Sequence[Operator]
) -> SequencePredictor[Any, Any]:
    """Return the network in the form in which it takes a scene: as it is, or for a goal of one fact.

    Args:
        scene: The scene; its goal is the paper's or one fact.
        network: A network for scenes with the paper's goal.
        operators: The operators that are known.
    """
    if isinstance(scene.goal, OnRegion):
        return network
    return OneFactNetwork(network, operators)


def _require_fact(scene: Scene) -> On:
    """Return the only fact of a scene's goal."""
    fact = only_fact(scene)
    assert fact is not None
    return fact
