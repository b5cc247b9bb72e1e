"""The network as the tree searches use it: a scene is encoded once, then each query costs one step of the GRU.

predictor = Predictor.load(Path("out/train/network.npz"))
code = predictor.encode_scene(scene)
hidden = code.initial_hidden(len(children))
probabilities, hidden = predictor.predict(code, hidden, children)     # children: indices of actions

With a depth image of your own camera instead of a rendered one, for a plan too:

images = depth_images(scene, DepthImage(depth, object_masks, goal_mask), size=64)
plan(scene, network=dataclasses.replace(predictor, images=images))
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.logic import Grounding
from dvr_jax.model.encoding import encode_actions, goal_tuple
from dvr_jax.model.export import load_parameters
from dvr_jax.model.images import SceneImages, scene_images, stack_images
from dvr_jax.model.metadata import Kind, NetworkMetadata
from dvr_jax.model.network import (
    NetworkConfig,
    NetworkParameters,
    encode_images,
    encode_symbols,
    input_gates,
    step_from_gates,
)
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.constants import MAXIMUM_OBJECTS

BATCH_SIZES = (16, 64, 256)
"""ConstraintValues for which `predict` is compiled; fewer are padded, more go in several calls. The children of a node are at most 16
with two objects and 64 with eight, and padding costs less than another compilation."""

OBJECT_NUMBERS = (1, 2, 4, 8)
"""Numbers of objects for which `encode_scene` is compiled."""

_MOST_ACTIONS = 12 * MAXIMUM_OBJECTS

_Rows = jax.Array | NDArray[Any]
"""What a program takes: NumPy's arrays as they are, which costs less than to put them on the device before."""

SHIPPED = Path(__file__).parents[1] / "networks"
"""Trained networks, one a kind: KIND.npz. """


@dataclass(frozen=True, slots=True)
class SceneEncoding:
    """A scene as the network sees it."""

    scene: Scene
    grounding: Grounding
    """Its actions; a network's action index is an index into `grounding.actions`."""
    gates: jax.Array
    """What each action adds to the GRU's gates (96, 3 H), on the device; padded to a length that no scene exceeds."""
    hidden_size: int

    def initial_hidden(self, number: int = 1) -> NDArray[np.float32]:
        """The state before the first action, for `number` rows (number, H)."""
        return np.zeros((number, self.hidden_size), np.float32)


@dataclass(frozen=True)
class Predictor:
    """A trained network of any kind, for scenes of 1 to 8 objects."""

    weights: NetworkParameters
    kind: Kind
    images: SceneImages | None = None
    """What a camera of your own sees (`dvr_jax.model.images.depth_images`); by default scenes are rendered."""

    @staticmethod
    def load(path: Path) -> Predictor:
        """From an exported file, or from the latest checkpoint of a training's folder."""
        weights, header = load_parameters(path)
        return Predictor.of(weights, header)

    @staticmethod
    def of(weights: NetworkParameters, header: NetworkMetadata) -> Predictor:
        """From weights in memory."""
        return Predictor(weights, header.kind)

    @property
    def checksum(self) -> str:
        """Of its weights, by which networks are told apart."""
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(self.weights.tree)]
        return hashlib.sha256(b"".join(leaf.tobytes() for leaf in leaves)).hexdigest()[:16]

    @property
    def size(self) -> NetworkConfig:
        """Equal for networks that run the same compiled programs."""
        return self.weights.config

    def render(self, scene: Scene) -> SceneImages:
        """Heights and masks of a scene in the network's size, rendered unless there are images of another camera."""
        config = self.weights.config
        return scene_images(scene, config.image_size, config.rays) if self.images is None else self.images

    def encode_scene(self, scene: Scene, grounding: Grounding | None = None, images: SceneImages | None = None) -> SceneEncoding:
        """Encode a scene, once for a whole search.

        Args:
            scene: with 1 to 8 objects.
            grounding: that of its objects and goal, if known.
            images: what `render` gave, if it was asked before.
        """
        names = [item.name for item in scene.objects]
        if grounding is None:
            grounding = ground_scene(scene)
        actions = encode_actions(grounding, scene.objects)
        number = next(size for size in OBJECT_NUMBERS if size >= len(names))
        stack = stack_images([self._checked(self.render(scene) if images is None else images, scene)], number)
        pairs = np.full((2 * number, 2), len(names) + 1, np.int32)  # padding: two masks of zeros
        pairs[: len(actions.pairs)] = actions.pairs
        gates = _encode_scene(
            self.weights,
            stack.height,
            stack.masks,
            pairs,
            np.asarray(goal_tuple(scene), np.int32),
            *(_padded(rows, 12 * number) for rows in (actions.symbol, actions.normal, actions.tuple_index)),
        )
        return SceneEncoding(scene, grounding, gates, self.weights.config.hidden)

    def _checked(self, images: SceneImages, scene: Scene) -> SceneImages:
        size = self.weights.config.image_size
        if images.height.shape != (size, size) or images.masks.shape != (len(scene.objects) + 2, size, size):
            raise DvrError(
                f"the images have shapes {images.height.shape} and {images.masks.shape}; valid for this network and "
                f"scene are {(size, size)} and {(len(scene.objects) + 2, size, size)}."
            )
        return images

    def predict(
        self, code: SceneEncoding, hidden: NDArray[np.float32], actions: Sequence[int] | NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Probabilities (B,) of the next actions `actions` (B,) after prefixes whose states are `hidden` (B, H), and
        the states (B, H) after those actions; one state (1, H) where all follow the same prefix."""
        chosen = np.asarray(actions, np.int32).reshape(-1)
        hidden = np.asarray(hidden, np.float32)
        shared = hidden.shape == (1, code.hidden_size)
        if not shared and hidden.shape != (len(chosen), code.hidden_size):
            raise DvrError(f"the states have shape {hidden.shape}; valid is {(len(chosen), code.hidden_size)}.")
        wrong = chosen[(chosen < 0) | (chosen >= len(code.grounding.actions))]
        if len(wrong):
            raise DvrError(f"there is no action {wrong[0]}; valid are 0 to {len(code.grounding.actions) - 1}.")
        probabilities = np.empty(len(chosen), np.float32)
        after = np.empty((len(chosen), code.hidden_size), np.float32)
        for first in range(0, len(chosen), BATCH_SIZES[-1]):
            rows = slice(first, min(first + BATCH_SIZES[-1], len(chosen)))
            count = rows.stop - first
            size = next(size for size in BATCH_SIZES if size >= count)
            before = hidden if shared else _padded(hidden[rows], size)
            result = _step(self.weights, code.gates, before, _padded(chosen[rows], size))
            probabilities[rows], after[rows] = (np.asarray(item)[:count] for item in result)
        return probabilities, after


def load_network(kind: str, path: Path | None = None) -> Predictor:
    """A trained network of a kind, "dvr" or "classifier"; without a path, the shipped one, which is read once."""
    if path is None:
        return _shipped_network(kind)
    predictor = Predictor.load(path)
    if predictor.kind != kind:
        raise DvrError(f"{path} holds a network of the kind '{predictor.kind}'; valid is '{kind}'.")
    return predictor


@cache
def _shipped_network(kind: str) -> Predictor:
    path = SHIPPED / f"{kind}.npz"
    if not path.exists():
        raise DvrError(f"no network of the kind '{kind}' is shipped with this installation; name a file of one.")
    return load_network(kind, path)


def _padded(rows: NDArray[Any], size: int) -> NDArray[Any]:
    """The array with rows of zeros behind it."""
    result = np.zeros((size, *rows.shape[1:]), rows.dtype)
    result[: len(rows)] = rows
    return result


@Program
def _encode_scene(
    weights: NetworkParameters,
    height: _Rows,
    masks: _Rows,
    pairs: _Rows,
    goal: _Rows,
    symbols: _Rows,
    normals: _Rows,
    tuples: _Rows,
) -> jax.Array:
    """Gates of one scene's actions (96, 3 H), from heights (1, H, W), masks (1, M, H, W), pairs (P, 2), goal's tuple
    (), symbol and tuple of each action (A,), normal of its face (A, 2)."""
    height, masks, pairs, symbols, normals = map(jnp.asarray, (height, masks, pairs, symbols, normals))
    only, as_it_is = jnp.zeros(1, jnp.int32), jnp.zeros((1, 2), bool)
    images = encode_images(weights, height, masks, only, as_it_is, jnp.zeros(len(pairs), jnp.int32), pairs)
    words = encode_symbols(weights, symbols, normals)
    gates = input_gates(weights, words, images, jnp.asarray(tuples), images[jnp.asarray(goal)])
    return jnp.pad(gates, ((0, _MOST_ACTIONS - len(gates)), (0, 0)))


@Program
def _step(weights: NetworkParameters, gates: jax.Array, hidden: _Rows, actions: _Rows) -> tuple[jax.Array, jax.Array]:
    """Probabilities (B,) and states (B, H) after actions (B,)."""
    logit, after = step_from_gates(weights, jnp.asarray(hidden), gates[jnp.asarray(actions)])
    return jax.nn.sigmoid(logit), after
