"""One scene as the network sees it during a search, and the compiled programs of a search.

The programs are compiled for few shapes: scenes are padded to one of `OBJECT_NUMBERS` objects, and queries to one of
`BATCH_SIZES` rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, UInt8

from dvr_jax.logic import Grounding
from dvr_jax.model.encoding import actions_per_object, encode_actions, goal_tuple, tuples_per_object
from dvr_jax.model.forward import advance_from_gates, encode_images, encode_symbols, input_gates
from dvr_jax.model.images import MASKS_PER_IMAGE, SceneImages, stack_images
from dvr_jax.model.network import NetworkParameters
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.types import MAXIMUM_OBJECTS, Scene

BATCH_SIZES = (16, 64, 256)
"""Numbers of rows for which a query is compiled; fewer rows are padded, more are split.

A node has at most 16 children with two objects and 64 with eight, and padding costs less than another compilation.
"""

OBJECT_NUMBERS = (1, 2, 4, 8)
"""Numbers of objects for which the encoding of a scene is compiled; scenes with fewer objects are padded."""


@dataclass(frozen=True, slots=True)
class SceneEncoding:
    """A scene, encoded by a network once for all queries of a search."""

    scene: Scene
    """The scene."""

    grounding: Grounding
    """Its grounded actions; the network numbers actions as `grounding.actions` does."""

    input_gates: Float[Array, "actions gates"]
    """What each action adds to the GRU's gates, on the device; padded to a length that no scene exceeds."""

    hidden_size: int
    """Size of the hidden state."""

    def initial_hidden(self, number: int = 1) -> Float[np.ndarray, "number hidden"]:
        """Return the hidden state before the first action, for so many rows."""
        return np.zeros((number, self.hidden_size), np.float32)


def encode_scene(
    parameters: NetworkParameters,
    scene: Scene,
    grounding: Grounding,
    images: SceneImages,
) -> SceneEncoding:
    """Encode a scene with 1 to 8 objects.

    Args:
        parameters: Parameters of the network.
        scene: The scene.
        grounding: Its grounded actions.
        images: Its images, in the network's size.

    Returns:
        The encoding.
    """
    actions = encode_actions(grounding, scene.objects)
    objects = next(number for number in OBJECT_NUMBERS if number >= len(scene.objects))
    stack = stack_images([images], objects)

    # The tuples behind the scene's own have two masks of zeros.
    mask_of_zeros = len(scene.objects) + 1
    number_of_tuples = tuples_per_object() * objects
    pairs = np.full((number_of_tuples, MASKS_PER_IMAGE), mask_of_zeros, np.int32)
    pairs[: len(actions.pairs)] = actions.pairs

    number_of_actions = actions_per_object() * objects
    gates = _encode_scene(
        parameters,
        stack.height,
        stack.masks,
        pairs,
        np.asarray(goal_tuple(scene), np.int32),
        pad_rows(actions.symbol, number_of_actions),
        pad_rows(actions.normal, number_of_actions),
        pad_rows(actions.tuple_index, number_of_actions),
    )
    return SceneEncoding(scene, grounding, gates, parameters.config.hidden)


def pad_rows(array: np.ndarray, number: int) -> np.ndarray:
    """Return an array with rows of zeros behind its own.

    Args:
        array: The array (n, ...).
        number: Number of rows of the result, at least n.

    Returns:
        The padded array (number, ...).
    """
    result = np.zeros((number, *array.shape[1:]), array.dtype)
    result[: len(array)] = array
    return result


# NumPy's arrays go into the programs as they are, which costs less than to put them on the device before.


@Program
def _encode_scene(
    parameters: NetworkParameters,
    height: Float[Array | np.ndarray, "1 pixels pixels"],
    masks: UInt8[Array | np.ndarray, "1 masks pixels pixels"],
    pairs: Int[Array | np.ndarray, "tuples 2"],
    goal: Int[Array | np.ndarray, ""],
    symbols: Int[Array | np.ndarray, " actions"],
    normals: Float[Array | np.ndarray, "actions 2"],
    tuples: Int[Array | np.ndarray, " actions"],
) -> Float[Array, "most_actions gates"]:
    """Return the input gates of all actions of one scene, padded for the largest scene."""
    image_codes = encode_images(
        parameters,
        jnp.asarray(height),
        jnp.asarray(masks),
        scene=jnp.zeros(1, jnp.int32),
        mirrored=jnp.zeros((1, 2), bool),
        view=jnp.zeros(len(pairs), jnp.int32),
        pairs=jnp.asarray(pairs),
    )
    symbol_codes = encode_symbols(parameters, jnp.asarray(symbols), jnp.asarray(normals))
    goal_code = image_codes[jnp.asarray(goal)]
    gates = input_gates(
        parameters,
        symbol_codes,
        image_codes,
        jnp.asarray(tuples),
        goal_code,
    )

    most_actions = actions_per_object() * MAXIMUM_OBJECTS
    return jnp.pad(gates, ((0, most_actions - len(gates)), (0, 0)))


@Program
def predict_rows(
    parameters: NetworkParameters,
    gates: Float[Array, "actions gates"],
    hidden: Float[Array | np.ndarray, "#rows hidden"],
    actions: Int[Array | np.ndarray, " rows"],
) -> tuple[Float[Array, " rows"], Float[Array, "rows hidden"]]:
    """Return the probabilities of actions and the hidden states after them."""
    chosen_gates = gates[jnp.asarray(actions)]
    logit, after = advance_from_gates(parameters, jnp.asarray(hidden), chosen_gates)
    return jax.nn.sigmoid(logit), after
