"""The network's computations as functions of its parameters: codes of images and symbols, and steps of the GRU.

They compute what `dvr_jax.model.network.Network` defines, the expensive parts faster:

- `encode_images` convolves heights once per view and masks once per mask, not once per image.
- `input_gates` computes once per scene what each action adds to the GRU's gates, whatever was done before it, and
  `advance_from_gates` continues from there. Flax's cell multiplies codes and state by all its kernels in each call,
  which is five times the work of a query.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax import Array
from jaxtyping import Bool, Float, Int, UInt8

from dvr_jax.model.convolution import (
    convolve,
    space_to_depth,
    stride_one_kernel,
    stride_two_kernel,
    take_images,
)
from dvr_jax.model.images import CHANNELS, MASKS_PER_IMAGE, view_channels
from dvr_jax.model.network import INPUT_LAYERS, STATE_LAYERS, Network, NetworkParameters
from dvr_jax.model.network_config import STRIDES


def encode_images(
    parameters: NetworkParameters,
    height: Float[Array, "scenes pixels pixels"],
    masks: UInt8[Array, "scenes masks pixels pixels"],
    scene: Int[Array, " views"],
    mirrored: Bool[Array, "views 2"],
    view: Int[Array, " images"],
    pairs: Int[Array, "images 2"],
) -> Float[Array, "images dense"]:
    """Encode action-object images of views of scenes.

    Args:
        parameters: Parameters of the network.
        height: Heights of each scene.
        masks: Masks of each scene; the last of a scene is all zeros.
        scene: The scene that each view shows.
        mirrored: Whether each view reverses the scene's x and its y.
        view: The view that each image belongs to.
        pairs: The two masks of each image, as indices into the scene's masks.

    Returns:
        The codes of the images.
    """
    layers = [parameters.tree[f"convolutions_{i}"] for i in range(len(STRIDES))]
    view_height, view_masks = view_channels(height, masks, scene, mirrored)

    images = _first_convolution(layers[0], view_height, view_masks, view, pairs)
    images = _halving_convolution(layers[1], images)
    images = _halving_convolution(layers[2], space_to_depth(images))

    dense = parameters.tree["image_dense"]
    code = images.reshape(images.shape[0], -1) @ dense["kernel"] + dense["bias"]
    if parameters.config.pooling:
        code = code + images.max((1, 2)) @ parameters.tree["pool_dense"]["kernel"]
    return code


def _halving_convolution(
    layer: dict[str, Array],
    images: Float[Array, "images rows columns depth"],
) -> Float[Array, "images rows columns outputs"]:
    """Return the response of a layer with stride 2 to space-to-depth images, as plain images."""
    kernel = stride_two_kernel(layer["kernel"])
    return nn.relu(convolve(images, kernel) + layer["bias"])


def _first_convolution(
    layer: dict[str, Array],
    view_height: Float[Array, "views pixels pixels"],
    view_masks: Float[Array, "views masks pixels pixels"],
    view: Int[Array, " images"],
    pairs: Int[Array, "images 2"],
) -> Float[Array, "images rows columns depth"]:
    """Return the first layer's response to each image, as space-to-depth images.

    The convolution is linear, so the parts of heights and masks are computed one by one and then added for each image.
    """
    kernels = [layer["kernel"][:, :, channel : channel + 1] for channel in range(CHANNELS)]
    height_kernel, *mask_kernels = map(stride_one_kernel, kernels)
    bias = jnp.tile(layer["bias"], 4)
    of_height = convolve(space_to_depth(view_height[..., None]), height_kernel) + bias

    # Every mask may be the first or the second of an image, so it is convolved with both kernels at once.
    view_masks = view_masks[:, :-1]
    all_masks = view_masks.reshape(-1, *view_masks.shape[2:], 1)
    both_kernels = jnp.concatenate(mask_kernels, axis=-1)
    of_masks = convolve(space_to_depth(all_masks), both_kernels)

    # The mask of zeros was not convolved; an index behind the last mask stands for it.
    count = view_masks.shape[1]
    index = jnp.where(pairs < count, view[:, None] * count + pairs, len(of_masks))
    of_first, of_second = jnp.split(of_masks, MASKS_PER_IMAGE, axis=-1)
    first = take_images(of_first, index[:, 0])
    second = take_images(of_second, index[:, 1])
    return nn.relu(take_images(of_height, view) + first + second)


def encode_symbols(
    parameters: NetworkParameters,
    symbols: Int[Array, "*actions"],
    normals: Float[Array, "*actions 2"],
) -> Float[Array, "*actions dense"]:
    """Encode symbols; see `Network.encode_symbols`.

    Args:
        parameters: Parameters of the network.
        symbols: Indices into `dvr_jax.model.encoding.SYMBOLS`.
        normals: Horizontal normals of the grasped faces in the world.

    Returns:
        The codes of the symbols.
    """
    network, variables = parameters.network()
    result: Any = network.apply(
        variables,
        symbols,
        normals,
        method=Network.encode_symbols,
    )
    return result


def advance(
    parameters: NetworkParameters,
    hidden: Float[Array, "*batch hidden"],
    symbol_code: Float[Array, "*batch dense"],
    image_code: Float[Array, "*batch dense"],
    goal_code: Float[Array, "*batch dense"] | None,
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch hidden"]]:
    """Advance the hidden state by one action; see `Network.advance`.

    Args:
        parameters: Parameters of the network.
        hidden: State before the action.
        symbol_code: Code of the action's symbol.
        image_code: Code of the action's image.
        goal_code: Code of the goal's image; ignored by a network without goal.

    Returns:
        The logit of the action and the state after it.
    """
    network, variables = parameters.network()
    result: Any = network.apply(
        variables,
        hidden,
        symbol_code,
        image_code,
        goal_code,
        method=Network.advance,
    )
    return result


def input_gates(
    parameters: NetworkParameters,
    symbol_codes: Float[Array, "actions dense"],
    image_codes: Float[Array, "images dense"],
    image: Int[Array, " actions"],
    goal_code: Float[Array, " dense"],
) -> Float[Array, "actions gates"]:
    """Compute what actions add to the GRU's gates, whatever was done before them.

    Args:
        parameters: Parameters of the network.
        symbol_codes: Codes of the actions' symbols.
        image_codes: Codes of the scene's images.
        image: The image of each action.
        goal_code: Code of the goal's image; ignored by a network without goal.

    Returns:
        The summands of reset gate, update gate and candidate, one after the other (A, 3 hidden).
    """
    layers = [parameters.tree["cell"][name] for name in INPUT_LAYERS]
    kernel = jnp.concatenate([layer["kernel"] for layer in layers], axis=1)
    symbol_kernel, image_kernel, *goal_kernel = jnp.split(kernel, 2 + parameters.config.goal)

    gates = symbol_codes @ symbol_kernel + (image_codes @ image_kernel)[image]
    gates = gates + jnp.concatenate([layer["bias"] for layer in layers])
    if goal_kernel:
        gates = gates + goal_code @ goal_kernel[0]
    return gates


def advance_from_gates(
    parameters: NetworkParameters,
    hidden: Float[Array, "#batch hidden"],
    gates: Float[Array, "#batch gates"],
) -> tuple[Float[Array, "#batch"], Float[Array, "#batch hidden"]]:
    """Advance the hidden state by one action, from what `input_gates` gave for it.

    Args:
        parameters: Parameters of the network.
        hidden: State before each action (B, hidden), or one state before all actions (1, hidden).
        gates: What each action adds to the gates (B, 3 hidden).

    Returns:
        The logits of the actions (B,) and the states after them (B, hidden), as `advance` gives them.
    """
    cell = parameters.tree["cell"]
    output = parameters.tree["output"]
    of_reset, of_update, of_candidate = (hidden @ cell[name]["kernel"] for name in STATE_LAYERS)
    reset, update, candidate = jnp.split(gates, 3, axis=-1)

    kept = nn.sigmoid(update + of_update)
    admitted = nn.sigmoid(reset + of_reset)
    candidate = jnp.tanh(candidate + admitted * (of_candidate + cell["hn"]["bias"]))
    after = (1 - kept) * candidate + kept * hidden

    logit = after @ output["kernel"] + output["bias"]
    return logit[..., 0], after


def run_sequence(
    parameters: NetworkParameters,
    symbol_codes: Float[Array, "batch steps dense"],
    image_codes: Float[Array, "batch steps dense"],
    goal_code: Float[Array, "batch dense"] | None,
) -> Float[Array, "batch steps"]:
    """Run the network along sequences, from the hidden state 0.

    Args:
        parameters: Parameters of the network.
        symbol_codes: Codes of the actions' symbols.
        image_codes: Codes of the actions' images.
        goal_code: Code of the goal's image of each sequence; ignored by a network without goal.

    Returns:
        The logit of each action.
    """

    def body(hidden: Array, codes: tuple[Array, Array]) -> tuple[Array, Array]:
        symbol_code, image_code = codes
        logit, hidden = advance(parameters, hidden, symbol_code, image_code, goal_code)
        return hidden, logit

    start = jnp.zeros((symbol_codes.shape[0], parameters.config.hidden), jnp.float32)
    by_step = (jnp.swapaxes(symbol_codes, 0, 1), jnp.swapaxes(image_codes, 0, 1))
    _, logits = jax.lax.scan(body, start, by_step)
    return jnp.swapaxes(logits, 0, 1)
