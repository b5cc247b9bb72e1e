"""The paper's network: a convolutional recurrent one that tells, action by action, whether a sequence is promising.

    image code    z(O)  = Dense_100(relu(Conv(relu(Conv(relu(Conv(I(O, S))))))))     three 5x5 convolutions
                        + Dense_100(maximum of the last convolution's channels over the image)      with `pooling`
    symbol code   e(a)  = relu(Dense_100([onehot(a), normal of the face]))                          with `normals`
    hidden state  h_k   = GRU_300(h_{k-1}, [e(a_k), z(O_k), z(O_goal)])              h_0 = 0
    logit         l_k   = Dense_1(h_k),        probability = sigmoid(l_k)

Without `pooling` and `normals` it is the paper's. The goal's symbol is left out, as in the paper's experiments; without
`goal` this is the recurrent feasibility classifier, which does not see the goal's tuple either. Padding of the
convolutions is not stated in the paper: here an image keeps its size but for the strides.

Linen and not NNX: its parameters are a plain dictionary, which scan, optimiser, checkpoint and compiled programs take
as it is. All is float32, whatever JAX's default is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn

from dvr_jax.errors import DvrError
from dvr_jax.model.convolution import convolve, halving_kernel, pack, packed_kernel, take
from dvr_jax.model.encoding import SYMBOLS
from dvr_jax.model.images import CHANNELS, show_scenes

ParameterTree = dict[str, Any]
"""A tree of float32 arrays."""

KERNEL = (5, 5)
STRIDES = (1, 2, 2)

RECURRENT, INPUT = ("hr", "hz", "hn"), ("ir", "iz", "in")
"""Names of the GRU's layers that act on the state, and of those that act on the codes: of the reset gate, the update
gate and the candidate."""

SMALLEST_IMAGE, LARGEST_IMAGE = 8, 1024

LARGEST_LAYER = 1 << 14

SIZE_UNIT = math.prod(STRIDES)
"""An image's size is a multiple of this, so that every layer's stride divides it."""


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the network; the defaults are the paper's."""

    image_size: int = 64
    """Height and width of the images in pixels."""
    rays: int = 4
    """Rays to a pixel along either axis, whose mean it is; 1 for the paper's network."""
    channels: tuple[int, int, int] = (5, 10, 10)
    """Channels of the three convolutional layers."""
    dense: int = 100
    """Size of an image's code and of a symbol's."""
    hidden: int = 300
    """Size of the GRU's state."""
    normals: bool = True
    """Whether a grasp's symbol comes with the normal of the face, beside the paper's network; without it, a face is
    known by where it looks to within 45 degrees."""
    pooling: bool = True
    """Whether an image's code also sees the strongest response of each last channel anywhere in the image, beside the
    paper's network, whose dense layer has to learn for each place anew what stands there."""
    goal: bool = True
    """Whether the goal's tuple is an input; without it, the network is the recurrent feasibility classifier."""

    def __post_init__(self) -> None:
        numbers = {"image_size": self.image_size, "rays": self.rays, "dense": self.dense, "hidden": self.hidden}
        numbers |= {f"channels[{i}]": value for i, value in enumerate(self.channels)}
        for name, value in numbers.items():
            if type(value) is not int or not 1 <= value <= LARGEST_LAYER:
                raise DvrError(f"the network's {name} is {value}; valid are whole numbers from 1 to {LARGEST_LAYER}.")
        for name in ("normals", "pooling", "goal"):
            if type(getattr(self, name)) is not bool:
                raise DvrError(f"the network's {name} is {getattr(self, name)!r}; valid are true and false.")
        if not SMALLEST_IMAGE <= self.image_size <= LARGEST_IMAGE or self.image_size % SIZE_UNIT:
            raise DvrError(
                f"the images' size is {self.image_size} pixels; valid are multiples of {SIZE_UNIT} from "
                f"{SMALLEST_IMAGE} to {LARGEST_IMAGE}."
            )
        if self.rays * self.image_size > LARGEST_IMAGE:
            raise DvrError(
                f"{self.rays} rays to each of {self.image_size} pixels are {self.rays * self.image_size}; valid are at "
                f"most {LARGEST_IMAGE} along an axis."
            )
        if len(self.channels) != len(STRIDES):
            raise DvrError(f"the network's channels are {self.channels}; valid are {len(STRIDES)} numbers.")


class Network(nn.Module):
    """The network; use it through the functions below, or `Network(config).apply(..., method=Network.step)`."""

    config: NetworkConfig

    def setup(self) -> None:
        """Layers."""
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

    def encode_images(self, images: jax.Array) -> jax.Array:
        """Codes (B, dense) of action-object images (B, H, W, 3); `encode_images` below gives the same, faster."""
        for convolution in self.convolutions:
            images = nn.relu(convolution(images))
        code = self.image_dense(images.reshape(images.shape[0], -1))
        return code + self.pool_dense(images.max((1, 2))) if self.config.pooling else code

    def encode_symbols(self, symbols: jax.Array, normals: jax.Array) -> jax.Array:
        """Codes (..., dense) of symbols (...), indices into SYMBOLS, and normals (..., 2) of the faces."""
        inputs = jax.nn.one_hot(symbols, len(SYMBOLS), dtype=jnp.float32)
        if self.config.normals:
            inputs = jnp.concatenate([inputs, normals], axis=-1)
        return nn.relu(self.symbol_dense(inputs))

    def step(
        self, hidden: jax.Array, symbol_code: jax.Array, image_code: jax.Array, goal_code: jax.Array | None
    ) -> tuple[jax.Array, jax.Array]:
        """Logit (...) of the next action and the state (..., hidden) after it, from the state before (..., hidden) and
        codes (..., dense); `goal_code` is ignored by a network without goal."""
        codes = [symbol_code, image_code]
        if self.config.goal:
            assert goal_code is not None
            codes.append(goal_code)
        hidden, _ = self.cell(hidden, jnp.concatenate(codes, axis=-1))
        return self.output(hidden)[..., 0], hidden

    def __call__(self, images: jax.Array, symbols: jax.Array) -> jax.Array:
        """Logits (B,) of first actions whose tuple is the goal's; touches every parameter, for initialisation."""
        code = self.encode_images(images)
        hidden = jnp.zeros((len(images), self.config.hidden), jnp.float32)
        normals = jnp.zeros((len(images), 2), jnp.float32)
        return self.step(hidden, self.encode_symbols(symbols, normals), code, code)[0]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NetworkParameters:
    """ParameterTree with the sizes they belong to; the sizes are static, so compiled programs are told apart by them."""

    tree: ParameterTree
    config: NetworkConfig = field(metadata={"static": True})

    def network(self) -> tuple[Network, dict[str, ParameterTree]]:
        """The module and its variables."""
        return Network(self.config), {"params": self.tree}


def parameter_shapes(config: NetworkConfig) -> ParameterTree:
    """The tree of parameters with shapes in place of arrays."""
    images = jax.ShapeDtypeStruct((1, config.image_size, config.image_size, CHANNELS), jnp.float32)
    symbols = jax.ShapeDtypeStruct((1,), jnp.int32)
    variables: Any = jax.eval_shape(Network(config).init, jax.random.key(0), images, symbols)
    return variables["params"]


def initial_parameters(config: NetworkConfig, seed: int) -> NetworkParameters:
    """Random parameters of a seed: kernels normal with variance 1 / inputs, the GRU's recurrent ones orthogonal, biases
    zero. Drawn by NumPy, because XLA takes 20 s to compile the drawing of all layers."""
    generator = np.random.default_rng(seed)

    def draw(path: tuple[Any, ...], leaf: jax.ShapeDtypeStruct) -> jax.Array:
        layer, name = (key.key for key in path[-2:])
        if name != "kernel":
            values = np.zeros(leaf.shape)
        elif layer in RECURRENT:
            factor, triangle = np.linalg.qr(generator.normal(size=leaf.shape))
            values = factor * np.sign(np.diag(triangle))  # uniform over the orthogonal matrices
        else:
            values = generator.normal(size=leaf.shape) / math.sqrt(math.prod(leaf.shape[:-1]))
        return jnp.asarray(values, jnp.float32)

    return NetworkParameters(jax.tree_util.tree_map_with_path(draw, parameter_shapes(config)), config)


def encode_images(
    weights: NetworkParameters,
    height: jax.Array,
    masks: jax.Array,
    scene: jax.Array,
    mirrored: jax.Array,
    view: jax.Array,
    pairs: jax.Array,
) -> jax.Array:
    """Codes (B, dense) of action-object images of shown scenes: image b has the heights of view `view[b]` (B,) and its
    masks `pairs[b]` (B, 2), of the views that `images.show_scenes` makes of heights (S, H, W), masks (S, M, H, W),
    scene (V,) and mirrored (V, 2). The last of a scene's masks is all zeros.

    The first convolution is linear, so the heights' part is convolved once per view and the masks' once per mask."""
    layers = [weights.tree[f"convolutions_{i}"] for i in range(len(STRIDES))]
    seen, marked = show_scenes(height, masks, scene, mirrored)
    ground, first, second = (packed_kernel(layers[0]["kernel"][:, :, i : i + 1]) for i in range(CHANNELS))
    bias = jnp.tile(layers[0]["bias"], 4)
    of_height = convolve(pack(seen[..., None]), ground) + bias
    marked = marked[:, :-1]
    of_masks = convolve(pack(marked.reshape(-1, *marked.shape[2:], 1)), jnp.concatenate([first, second], axis=-1))
    # Of the two channels' parts; the zeros are none of the masks that were convolved.
    count = marked.shape[1]
    place = jnp.where(pairs < count, view[:, None] * count + pairs, len(of_masks))
    parts = [take(part, place[:, i]) for i, part in enumerate(jnp.split(of_masks, 2, axis=-1))]
    images = nn.relu(take(of_height, view) + parts[0] + parts[1])
    images = nn.relu(convolve(images, halving_kernel(layers[1]["kernel"])) + layers[1]["bias"])
    images = nn.relu(convolve(pack(images), halving_kernel(layers[2]["kernel"])) + layers[2]["bias"])
    dense = weights.tree["image_dense"]
    code = images.reshape(images.shape[0], -1) @ dense["kernel"] + dense["bias"]
    return code + images.max((1, 2)) @ weights.tree["pool_dense"]["kernel"] if weights.config.pooling else code


def encode_symbols(weights: NetworkParameters, symbols: jax.Array, normals: jax.Array) -> jax.Array:
    """Codes (..., dense) of symbols (...) and normals (..., 2)."""
    network, variables = weights.network()
    return _only(network.apply(variables, symbols, normals, method=Network.encode_symbols))


def step(
    weights: NetworkParameters, hidden: jax.Array, symbol_code: jax.Array, image_code: jax.Array, goal_code: jax.Array | None
) -> tuple[jax.Array, jax.Array]:
    """Logit (...) and next state (..., hidden) of one action; see `Network.step`."""
    network, variables = weights.network()
    result: Any = network.apply(variables, hidden, symbol_code, image_code, goal_code, method=Network.step)
    return result


def input_gates(
    weights: NetworkParameters, symbol_codes: jax.Array, image_codes: jax.Array, image: jax.Array, goal_code: jax.Array
) -> jax.Array:
    """What actions add to the GRU's gates (A, 3 hidden), whatever was done before them: a search computes it once.

    Args:
        weights: of the network.
        symbol_codes: (A, dense).
        image_codes: (P, dense).
        image: index of each action's image (A,).
        goal_code: (dense,); ignored by a network without goal.
    """
    layers = [weights.tree["cell"][name] for name in INPUT]
    kernel = jnp.concatenate([layer["kernel"] for layer in layers], axis=1)
    of_symbol, of_image, *of_goal = jnp.split(kernel, 2 + weights.config.goal)
    gates = symbol_codes @ of_symbol + (image_codes @ of_image)[image]
    gates = gates + jnp.concatenate([layer["bias"] for layer in layers])
    return gates + goal_code @ of_goal[0] if of_goal else gates


def step_from_gates(weights: NetworkParameters, hidden: jax.Array, gates: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Logits (B,) and states (B, hidden) as `step` gives them, from `input_gates` (B, 3 hidden) and the states before
    (B, hidden), or one state (1, hidden) before all actions. Flax's cell, which `step` calls, multiplies codes and
    state by all its kernels each time: five times the work of a query."""
    cell, output = weights.tree["cell"], weights.tree["output"]
    of_reset, of_update, of_candidate = (hidden @ cell[name]["kernel"] for name in RECURRENT)
    reset, update, candidate = jnp.split(gates, 3, axis=-1)
    kept = nn.sigmoid(update + of_update)
    candidate = jnp.tanh(candidate + nn.sigmoid(reset + of_reset) * (of_candidate + cell["hn"]["bias"]))
    after = (1 - kept) * candidate + kept * hidden
    return (after @ output["kernel"] + output["bias"])[..., 0], after


def run_sequence(
    weights: NetworkParameters, symbol_codes: jax.Array, image_codes: jax.Array, goal_code: jax.Array | None
) -> jax.Array:
    """Logits (B, K) along sequences of codes (B, K, dense) with the goal's code (B, dense), from the zero state."""

    def body(hidden: jax.Array, codes: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        logit, hidden = step(weights, hidden, *codes, goal_code)
        return hidden, logit

    start = jnp.zeros((symbol_codes.shape[0], weights.config.hidden), jnp.float32)
    along = (jnp.swapaxes(symbol_codes, 0, 1), jnp.swapaxes(image_codes, 0, 1))
    return jnp.swapaxes(jax.lax.scan(body, start, along)[1], 0, 1)


def _only(result: Any) -> jax.Array:
    """What a module returns, which its types leave open."""
    return result
