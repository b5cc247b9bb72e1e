"""The paper's network: a convolutional recurrent one that predicts, action by action, whether a sequence is promising.

    image code    z(O)  = Dense_100(relu(Conv(relu(Conv(relu(Conv(I(O, S))))))))     three 5x5 convolutions
                        + Dense_100(maximum of the last convolution's channels over the image)      with `pooling`
    symbol code   e(a)  = relu(Dense_100([onehot(a), normal of the face]))                          with `normals`
    hidden state  h_k   = GRU_300(h_{k-1}, [e(a_k), z(O_k), z(O_goal)])              h_0 = 0
    logit         l_k   = Dense_1(h_k),        probability = sigmoid(l_k)

I(O, S) is the action-object image of the tuple O in the scene S (`dvr_jax.model.images`), a is an action's symbol
(`dvr_jax.model.encoding`). Without `pooling` and `normals` the network is the paper's. The goal's symbol is left out,
as in the paper's experiments. Without `goal` the network is the recurrent feasibility classifier, which does not see
the goal's tuple. The paper does not state how its convolutions are padded; here an image keeps its size except for
strides.

The module below defines layers and parameters. `dvr_jax.model.forward` computes the same faster. Flax's Linen is used
and not its NNX, because the parameters of Linen are a plain dictionary, which scan, optimizer, checkpoint and compiled
programs take as it is. All numbers are float32, whatever JAX's default is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax import Array
from jaxtyping import Float, Int

from dvr_jax.model.encoding import SYMBOLS
from dvr_jax.model.images import CHANNELS
from dvr_jax.model.network_config import STRIDES, NetworkConfig

ParameterTree = dict[str, Any]
"""A tree of float32 arrays: dictionaries by layer, and arrays by name in a layer."""

KERNEL = (5, 5)
"""Size of the convolutions' kernels [pixels]."""

STATE_LAYERS = ("hr", "hz", "hn")
"""Names of the GRU's layers that act on the hidden state: those of reset gate, update gate and candidate."""

INPUT_LAYERS = ("ir", "iz", "in")
"""Names of the GRU's layers that act on the codes, in the same order."""


class Network(nn.Module):
    """The layers of the network, as `Network(config).apply({"params": tree}, ..., method=Network.advance)`."""

    config: NetworkConfig

    def setup(self) -> None:
        """Define the layers."""
        config = self.config
        self.convolutions = [
            nn.Conv(channels, KERNEL, strides=(stride, stride), padding="SAME")
            for channels, stride in zip(config.channels, STRIDES, strict=True)
        ]
        self.image_dense = nn.Dense(config.dense)
        if config.pooling:
            self.pool_dense = nn.Dense(config.dense, use_bias=False)
        self.symbol_dense = nn.Dense(config.dense)
        self.cell = nn.GRUCell(config.hidden)
        self.output = nn.Dense(1)

    def encode_images(
        self,
        images: Float[Array, "images height width channels"],
    ) -> Float[Array, "images dense"]:
        """Return the codes of action-object images; `dvr_jax.model.forward.encode_images` computes them faster."""
        for convolution in self.convolutions:
            images = nn.relu(convolution(images))

        code = self.image_dense(images.reshape(images.shape[0], -1))
        if self.config.pooling:
            code = code + self.pool_dense(images.max((1, 2)))
        return code

    def encode_symbols(
        self,
        symbols: Int[Array, "*actions"],
        normals: Float[Array, "*actions 2"],
    ) -> Float[Array, "*actions dense"]:
        """Return the codes of symbols.

        Args:
            symbols: Indices into `SYMBOLS`.
            normals: Horizontal normals of the grasped faces in the world; ignored by a network without normals.

        Returns:
            The codes.
        """
        inputs = jax.nn.one_hot(symbols, len(SYMBOLS), dtype=jnp.float32)
        if self.config.normals:
            inputs = jnp.concatenate([inputs, normals], axis=-1)
        return nn.relu(self.symbol_dense(inputs))

    def advance(
        self,
        hidden: Float[Array, "*batch hidden"],
        symbol_code: Float[Array, "*batch dense"],
        image_code: Float[Array, "*batch dense"],
        goal_code: Float[Array, "*batch dense"] | None,
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch hidden"]]:
        """Advance the hidden state by one action.

        Args:
            hidden: State before the action.
            symbol_code: Code of the action's symbol.
            image_code: Code of the action's image.
            goal_code: Code of the goal's image; ignored by a network without goal.

        Returns:
            The logit of the action and the state after it.
        """
        codes = [symbol_code, image_code]
        if self.config.goal:
            assert goal_code is not None
            codes.append(goal_code)
        hidden, _ = self.cell(hidden, jnp.concatenate(codes, axis=-1))
        return self.output(hidden)[..., 0], hidden

    def __call__(
        self,
        images: Float[Array, "images height width channels"],
        symbols: Int[Array, " images"],
    ) -> Float[Array, " images"]:
        """Return logits of first actions whose tuple is the goal's; flax initializes every parameter through it."""
        image_code = self.encode_images(images)
        hidden = jnp.zeros((len(images), self.config.hidden), jnp.float32)
        normals = jnp.zeros((len(images), 2), jnp.float32)
        symbol_code = self.encode_symbols(symbols, normals)
        logit, _ = self.advance(hidden, symbol_code, image_code, image_code)
        return logit


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NetworkParameters:
    """Parameters of a network together with its sizes, which are static and so distinguish compiled programs."""

    tree: ParameterTree
    config: NetworkConfig = field(metadata={"static": True})

    def network(self) -> tuple[Network, dict[str, ParameterTree]]:
        """Return the flax module and its variables."""
        return Network(self.config), {"params": self.tree}


def parameter_shapes(config: NetworkConfig) -> ParameterTree:
    """Return the tree of parameters with shapes in place of arrays."""
    image_shape = (1, config.image_size, config.image_size, CHANNELS)
    variables: Any = jax.eval_shape(
        Network(config).init,
        jax.random.key(0),
        jax.ShapeDtypeStruct(image_shape, jnp.float32),
        jax.ShapeDtypeStruct((1,), jnp.int32),
    )
    return variables["params"]


def initial_parameters(config: NetworkConfig, seed: int) -> NetworkParameters:
    """Draw random parameters.

    Kernels are normal with variance 1 / (number of inputs), the GRU's kernels that act on the state are orthogonal, and
    biases are zero. NumPy draws them, because XLA takes 20 s to compile the drawing of all layers.

    Args:
        config: Sizes of the network.
        seed: Seed of the random numbers.

    Returns:
        The parameters.
    """
    generator = np.random.default_rng(seed)

    def draw(path: tuple[Any, ...], leaf: jax.ShapeDtypeStruct) -> Array:
        layer, name = (key.key for key in path[-2:])
        if name != "kernel":
            values = np.zeros(leaf.shape)
        elif layer in STATE_LAYERS:
            factor, triangle = np.linalg.qr(generator.normal(size=leaf.shape))
            # These signs make the matrix uniform over the orthogonal ones.
            values = factor * np.sign(np.diag(triangle))
        else:
            inputs = math.prod(leaf.shape[:-1])
            values = generator.normal(size=leaf.shape) / math.sqrt(inputs)
        return jnp.asarray(values, jnp.float32)

    tree = jax.tree_util.tree_map_with_path(draw, parameter_shapes(config))
    return NetworkParameters(tree, config)
