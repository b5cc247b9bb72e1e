"""What a search needs of a network: predictions of the next actions after a prefix of a sequence.

The searches never import a network. They take any object with the attributes and methods of `SequencePredictor`, such
as `dvr_jax.model.predictor.Predictor`, and treat its images and its encoding of a scene as values that only the
network itself looks into.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from dvr_jax.logic import Grounding
from dvr_jax.operators import Operator
from dvr_jax.scene.types import Scene


class SceneEncoding(Protocol):
    """One scene, encoded by a network for all queries of a search."""

    def initial_hidden(self) -> Float[np.ndarray, "1 hidden"]:
        """Return the hidden state before the first action."""
        ...


Images = TypeVar("Images")
"""The images of a scene as a network takes them."""

Encoding = TypeVar("Encoding", bound=SceneEncoding)
"""The encoding of a scene that a network makes and later reads."""


class SequencePredictor(Protocol[Images, Encoding]):
    """A network that predicts, action by action, how promising a sequence is."""

    @property
    def kind(self) -> str:
        """Name of the search that the network guides, such as "dvr"."""
        ...

    @property
    def checksum(self) -> str:
        """Checksum of the network's parameters, which distinguishes networks in records of a plan."""
        ...

    @property
    def size(self) -> Hashable:
        """Sizes of the network; networks of equal size run the same compiled programs."""
        ...

    def unfit_reason(self, scene: Scene, operators: Sequence[Operator]) -> str | None:
        """Say why the network cannot guide a search.

        Args:
            scene: The scene.
            operators: Operators that the plan may consist of.

        Returns:
            The reason in words; None if the network fits.
        """
        ...

    def render(self, scene: Scene) -> Images:
        """Return the images of a scene in the form that the network takes."""
        ...

    def encode_scene(
        self,
        scene: Scene,
        grounding: Grounding | None = None,
        images: Images | None = None,
    ) -> Encoding:
        """Encode a scene once for a whole search.

        Args:
            scene: The scene.
            grounding: The grounded actions of the scene; None computes them.
            images: What `render` returned for the scene; None renders it.

        Returns:
            The encoding, which `predict` reads.
        """
        ...

    def predict(
        self,
        encoding: Encoding,
        hidden: Float[np.ndarray, "1 hidden"],
        actions: Sequence[int],
    ) -> tuple[Float[np.ndarray, " actions"], Float[np.ndarray, "actions hidden"]]:
        """Predict how promising each of several next actions is.

        Args:
            encoding: The encoding of the scene.
            hidden: The hidden state after the actions taken so far.
            actions: Candidates for the next action, as indices into the actions of the scene's grounding.

        Returns:
            The probability of each candidate and the hidden state after it.
        """
        ...
