"""The network as a search uses it: a scene is encoded once, then each query costs one step of the GRU.

    predictor = Predictor.load(Path("out/train/network.npz"))
    encoding = predictor.encode_scene(scene)
    hidden = encoding.initial_hidden()
    probabilities, hidden = predictor.predict(encoding, hidden, actions)     # indices of actions

With the depth image of a real camera instead of a rendered one, also for a plan:

    images = depth_images(scene, DepthImage(depth, object_masks, goal_mask), size=64)
    plan(scene, network=dataclasses.replace(predictor, images=images))
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.errors import DvrError
from dvr_jax.logic import Grounding
from dvr_jax.model.encoding import unfit_reason
from dvr_jax.model.export import load_parameters
from dvr_jax.model.images import SceneImages, scene_images
from dvr_jax.model.kind import Kind
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.network import NetworkParameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.scene_encoding import (
    BATCH_SIZES,
    SceneEncoding,
    encode_scene,
    pad_rows,
    predict_rows,
)
from dvr_jax.operators import Operator, ground_scene
from dvr_jax.scene.types import Scene

SHIPPED = Path(__file__).parents[1] / "networks"
"""Folder of the shipped networks, `KIND.npz` for each kind."""


@dataclass(frozen=True)
class Predictor:
    """A trained network of any kind, for scenes of 1 to 8 objects.

    It is a `dvr_jax.search.predictor.SequencePredictor`.
    """

    parameters: NetworkParameters
    """Parameters of the network."""

    metadata: NetworkMetadata
    """Kind, inputs and training of the network."""

    images: SceneImages | None = None
    """Images of a real camera (`dvr_jax.model.images.depth_images`); None renders every scene."""

    @staticmethod
    def load(path: str | Path) -> Predictor:
        """Read a network from an exported file, or from the latest checkpoint of a training's folder."""
        parameters, metadata = load_parameters(Path(path))
        return Predictor(parameters, metadata)

    @staticmethod
    def shipped(kind: str) -> Predictor:
        """Return the shipped network of a kind, "dvr" or "classifier"; its file is read once."""
        return _shipped(kind)

    @property
    def kind(self) -> Kind:
        """What the network predicts, which is also the name of the search that it guides."""
        return self.metadata.kind

    @property
    def checksum(self) -> str:
        """Checksum of the parameters, which distinguishes networks."""
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(self.parameters)]
        return hashlib.sha256(b"".join(leaf.tobytes() for leaf in leaves)).hexdigest()[:16]

    @property
    def size(self) -> NetworkConfig:
        """Sizes of the network; networks of equal size run the same compiled programs."""
        return self.parameters.config

    def unfit_reason(self, scene: Scene, operators: Sequence[Operator]) -> str | None:
        """Say why the network cannot guide a search; None if it can.

        Args:
            scene: The scene.
            operators: Operators that the plan may consist of.

        Returns:
            The reason in words.
        """
        return unfit_reason(scene, operators)

    def render(self, scene: Scene) -> SceneImages:
        """Return the images of a scene in the network's size, or the real camera's if there are any."""
        if self.images is not None:
            return self.images
        return scene_images(scene, self.size.image_size, self.size.rays)

    def encode_scene(
        self,
        scene: Scene,
        grounding: Grounding | None = None,
        images: SceneImages | None = None,
    ) -> SceneEncoding:
        """Encode a scene once for a whole search.

        Args:
            scene: A scene with 1 to 8 objects.
            grounding: Its grounded actions; None computes them.
            images: What `render` returned for the scene; None renders it.

        Returns:
            The encoding, which `predict` reads.

        Raises:
            DvrError: The images do not fit the network and the scene, or the network does not know an action.
        """
        if grounding is None:
            grounding = ground_scene(scene)
        if images is None:
            images = self.render(scene)
        self._check_images(images, scene)
        return encode_scene(self.parameters, scene, grounding, images)

    def predict(
        self,
        encoding: SceneEncoding,
        hidden: Float[np.ndarray, "#actions hidden"],
        actions: Sequence[int] | Int[np.ndarray, " actions"],
    ) -> tuple[Float[np.ndarray, " actions"], Float[np.ndarray, "actions hidden"]]:
        """Predict how promising each of several next actions is.

        Args:
            encoding: The encoding of the scene.
            hidden: The hidden state before each action (B, H), or one state before all of them (1, H).
            actions: The next actions, as indices into the actions of the scene's grounding (B,).

        Returns:
            The probability of each action (B,) and the hidden state after it (B, H).

        Raises:
            DvrError: The states have another shape, or there is no such action.
        """
        chosen = np.asarray(actions, np.int32).reshape(-1)
        hidden = np.asarray(hidden, np.float32)
        self._check_query(encoding, hidden, chosen)

        one_state = hidden.shape == (1, encoding.hidden_size)
        probabilities = np.empty(len(chosen), np.float32)
        after = np.empty((len(chosen), encoding.hidden_size), np.float32)
        for first in range(0, len(chosen), BATCH_SIZES[-1]):
            rows = slice(first, min(first + BATCH_SIZES[-1], len(chosen)))
            count = rows.stop - first
            size = next(size for size in BATCH_SIZES if size >= count)
            before = hidden if one_state else pad_rows(hidden[rows], size)
            result = predict_rows(
                self.parameters, encoding.input_gates, before, pad_rows(chosen[rows], size)
            )
            probabilities[rows] = np.asarray(result[0])[:count]
            after[rows] = np.asarray(result[1])[:count]
        return probabilities, after

    def _check_images(self, images: SceneImages, scene: Scene) -> None:
        """Refuse images whose shapes do not fit the network and the scene."""
        size = self.size.image_size
        height_shape = (size, size)
        masks_shape = (len(scene.objects) + 2, size, size)
        if images.height.shape != height_shape or images.masks.shape != masks_shape:
            raise DvrError(
                f"the images have shapes {images.height.shape} and {images.masks.shape}; valid for this network and "
                f"scene are {height_shape} and {masks_shape}."
            )

    def _check_query(
        self,
        encoding: SceneEncoding,
        hidden: Float[np.ndarray, "states hidden"],
        actions: Int[np.ndarray, " actions"],
    ) -> None:
        """Refuse states of a wrong shape and actions that the scene does not have."""
        valid = (len(actions), encoding.hidden_size)
        if hidden.shape not in (valid, (1, encoding.hidden_size)):
            raise DvrError(f"the states have shape {hidden.shape}; valid is {valid}.")

        number_of_actions = len(encoding.grounding.actions)
        wrong = actions[(actions < 0) | (actions >= number_of_actions)]
        if len(wrong):
            raise DvrError(
                f"there is no action {wrong[0]}; valid are 0 to {number_of_actions - 1}."
            )


def load_network(kind: str, path: Path | None = None) -> Predictor:
    """Return a trained network of a kind.

    Args:
        kind: Kind of the network, "dvr" or "classifier".
        path: File or folder of the network; None takes the shipped one, which is read once.

    Returns:
        The network.

    Raises:
        DvrError: There is no such network, or it is of another kind.
    """
    if path is None:
        return Predictor.shipped(kind)
    predictor = Predictor.load(path)
    if predictor.kind != kind:
        raise DvrError(f"{path} holds a network of the kind '{predictor.kind}'; valid is '{kind}'.")
    return predictor


@cache
def _shipped(kind: str) -> Predictor:
    """Read the shipped network of a kind; the cache lets plans find its compiled programs after the first."""
    path = SHIPPED / f"{kind}.npz"
    if not path.exists():
        raise DvrError(
            f"no network of the kind '{kind}' is shipped with this installation; name a file of one."
        )
    return load_network(kind, path)
