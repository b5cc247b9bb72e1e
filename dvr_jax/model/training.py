"""One step of the training: the loss of a batch and Adam.

The loss of a batch, with s_bk the logit of sequence b at step k, f_bk its target and m_bk the weight of the target:

    w_bk = m_bk (positive_weight if f_bk = 1 else 1),      loss = sum_bk w_bk BCE(s_bk, f_bk) / sum_bk w_bk
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from jaxtyping import Float, UInt8

from dvr_jax.model.batches import Batch
from dvr_jax.model.forward import encode_images, encode_symbols, run_sequence
from dvr_jax.model.network import NetworkParameters, ParameterTree

ADAM = optax.scale_by_adam()
"""Adam without the learning rate, which changes from step to step."""


def batch_logits(
    parameters: NetworkParameters,
    height: Float[Array, "scenes pixels pixels"],
    masks: UInt8[Array, "scenes masks pixels pixels"],
    batch: Batch,
) -> Float[Array, "batch steps"]:
    """Run the network along the sequences of a batch.

    Args:
        parameters: Parameters of the network.
        height: Heights of all scenes.
        masks: Masks of all scenes.
        batch: The batch.

    Returns:
        The logit of each action.
    """
    image_codes = encode_images(
        parameters,
        height,
        masks,
        jnp.asarray(batch.view_scene),
        jnp.asarray(batch.view_mirrored),
        jnp.asarray(batch.image_view),
        jnp.asarray(batch.image_pair),
    )
    symbol_codes = encode_symbols(
        parameters,
        jnp.asarray(batch.symbol),
        jnp.asarray(batch.normal),
    )
    return run_sequence(
        parameters,
        symbol_codes,
        image_codes[jnp.asarray(batch.image)],
        image_codes[jnp.asarray(batch.goal_image)],
    )


def weighted_loss(
    logits: Float[Array, "batch steps"],
    target: Float[Array | np.ndarray, "batch steps"],
    weight: Float[Array | np.ndarray, "batch steps"],
    positive_weight: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Compute the loss of a batch, as the head of this file defines it.

    Args:
        logits: Logit of each action.
        target: Target of each action, 0 or 1.
        weight: Weight of each target.
        positive_weight: Further weight of targets of 1.

    Returns:
        The loss and its denominator.
    """
    total_weight = weight * jnp.where(target > 0.5, positive_weight, jnp.float32(1.0))
    denominator = jnp.sum(total_weight)
    cross_entropy = optax.sigmoid_binary_cross_entropy(logits, jnp.asarray(target))
    return jnp.sum(total_weight * cross_entropy) / denominator, denominator


@jax.jit
def evaluate_batch(
    parameters: NetworkParameters,
    height: Float[Array, "scenes pixels pixels"],
    masks: UInt8[Array, "scenes masks pixels pixels"],
    batch: Batch,
    positive_weight: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, "batch steps"]]:
    """Compute the loss of a batch without training on it.

    Args:
        parameters: Parameters of the network.
        height: Heights of all scenes.
        masks: Masks of all scenes.
        batch: The batch.
        positive_weight: Weight of targets of 1.

    Returns:
        The loss, its denominator and the logit of each action.
    """
    logits = batch_logits(parameters, height, masks, batch)
    loss, denominator = weighted_loss(logits, batch.target, batch.weight, positive_weight)
    return loss, denominator, logits


@partial(jax.jit, donate_argnums=(0, 1))
def train_step(
    parameters: NetworkParameters,
    optimizer: optax.OptState,
    height: Float[Array, "scenes pixels pixels"],
    masks: UInt8[Array, "scenes masks pixels pixels"],
    batch: Batch,
    learning_rate: Float[Array, ""],
    positive_weight: Float[Array, ""],
) -> tuple[NetworkParameters, optax.OptState, Float[Array, ""]]:
    """Change the parameters by one step of Adam; parameters and optimizer state are consumed.

    Args:
        parameters: Parameters of the network.
        optimizer: State of Adam.
        height: Heights of all scenes.
        masks: Masks of all scenes.
        batch: The batch.
        learning_rate: Learning rate of this step.
        positive_weight: Weight of targets of 1.

    Returns:
        Parameters and state of Adam after the step, and the loss before it.
    """

    def loss_of(tree: ParameterTree) -> Float[Array, ""]:
        candidate = NetworkParameters(tree, parameters.config)
        logits = batch_logits(candidate, height, masks, batch)
        loss, _ = weighted_loss(logits, batch.target, batch.weight, positive_weight)
        return loss

    loss, gradient = jax.value_and_grad(loss_of)(parameters.tree)
    direction, optimizer = ADAM.update(gradient, optimizer)
    tree = jax.tree.map(
        lambda old, change: old - learning_rate * change,
        parameters.tree,
        direction,
    )
    return NetworkParameters(tree, parameters.config), optimizer, loss
