"""The network against SciPy's correlation, the GRU's equations and flax's own cell; scan against single steps."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn
from jaxtyping import Float
from scipy.signal import correlate2d

from dvr_jax.errors import DvrError
from dvr_jax.model.forward import advance, encode_images, encode_symbols, run_sequence
from dvr_jax.model.network import Network, NetworkParameters, ParameterTree, initial_parameters
from dvr_jax.model.network_config import NetworkConfig

SMALL = NetworkConfig(image_size=16, channels=(2, 3, 4), dense=7, hidden=11)


def random_parameters(config: NetworkConfig, seed: int = 0) -> NetworkParameters:
    """With biases that are not zero."""
    parameters = initial_parameters(config, seed)
    generator = np.random.default_rng(seed)
    return jax.tree.map(
        lambda leaf: leaf + generator.normal(0, 0.1, leaf.shape).astype("float32"), parameters
    )


def convolve(
    image: Float[np.ndarray, "height width channels"], layer: Any, stride: int
) -> Float[np.ndarray, "height width outputs"]:
    """Relu of a 5x5 layer on an image (H, W, C), padded as much as its stride needs."""
    kernel = np.asarray(layer["kernel"], float)
    bias = np.asarray(layer["bias"], float)
    planes = []
    for out in range(kernel.shape[-1]):
        # With an even size and stride 2 one row less is padded before than behind.
        before = (4 - (stride - 1)) // 2
        padded = np.pad(image, ((before, 4 - before), (before, 4 - before), (0, 0)))
        plane = sum(
            correlate2d(padded[..., c], kernel[..., c, out], "valid")
            for c in range(image.shape[-1])
        )
        planes.append(plane[::stride, ::stride] + bias[out])
    return np.maximum(np.stack(planes, axis=-1), 0)


@pytest.mark.parametrize("pooling", [True, False])
def test_image_encoder_is_three_correlations_and_a_dense_layer(pooling: bool) -> None:
    parameters = random_parameters(replace(SMALL, pooling=pooling))
    image: np.ndarray = np.random.default_rng(0).normal(size=(16, 16, 3)).astype(np.float32)
    network, variables = parameters.network()
    code = network.apply(variables, jnp.asarray(image[None]), method=Network.encode_images)
    for i, stride in enumerate((1, 2, 2)):
        image = convolve(image, parameters.tree[f"convolutions_{i}"], stride)
    dense = parameters.tree["image_dense"]
    expected = image.ravel() @ np.asarray(dense["kernel"], float) + np.asarray(dense["bias"], float)
    if pooling:
        expected = expected + image.max((0, 1)) @ np.asarray(
            parameters.tree["pool_dense"]["kernel"], float
        )
    np.testing.assert_allclose(np.asarray(code)[0], expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("pooling", [True, False])
def test_fast_encoder_is_the_network_on_whole_images_in_values_and_gradients(pooling: bool) -> None:
    size = 24
    number = 8
    config = replace(SMALL, image_size=size, pooling=pooling)
    parameters = random_parameters(config)
    generator = np.random.default_rng(0)
    height = generator.uniform(-1, 1, (5, size, size)).astype(np.float32)
    masks = generator.integers(0, 256, (5, 4, size, size)).astype(np.uint8)
    masks[:, -1] = 0
    scene = np.array([4, 1, 1, 0])
    mirrored = np.array([[0, 0], [1, 1], [0, 1], [1, 0]], bool)
    view = generator.integers(0, 4, number)
    pairs = generator.integers(0, 4, (number, 2))
    view[-1] = view[0]
    pairs[-1] = (1, 3)
    target = generator.normal(size=(number, config.dense)).astype(np.float32)

    def fast(parameters: ParameterTree) -> tuple[jax.Array, jax.Array]:
        arrays = (jnp.asarray(item) for item in (height, masks, scene, mirrored, view, pairs))
        codes = encode_images(NetworkParameters(parameters, config), *arrays)
        return jnp.vdot(codes, target) / number, codes

    images = np.zeros((number, size, size, 3), np.float32)
    for image, which, pair in zip(images, view, pairs, strict=True):
        channels = 16.0 * np.stack(
            [height[scene[which]], *masks[scene[which], pair] / 255], axis=-1
        )
        in_x, in_y = mirrored[which]
        image[:] = channels[:: -1 if in_y else 1, :: -1 if in_x else 1]

    def plain(parameters: ParameterTree) -> tuple[jax.Array, jax.Array]:
        codes: Any = Network(config).apply(
            {"params": parameters}, jnp.asarray(images), method=Network.encode_images
        )
        return jnp.vdot(codes, target) / number, codes

    (_, mine), my_gradient = jax.jit(jax.value_and_grad(fast, has_aux=True))(parameters.tree)
    (_, theirs), their_gradient = jax.jit(jax.value_and_grad(plain, has_aux=True))(parameters.tree)
    np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-5 * float(jnp.abs(theirs).max()))
    for one, other in zip(*map(jax.tree.leaves, (my_gradient, their_gradient)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5 * float(jnp.abs(other).max()))
    assert float(jnp.abs(my_gradient["convolutions_0"]["kernel"]).min()) > 0


def test_advance_is_a_gru_and_a_linear_layer() -> None:
    parameters = random_parameters(SMALL)
    hidden, symbol, image, goal = (
        jax.random.normal(jax.random.key(i), (5, n), "float32") for i, n in enumerate((11, 7, 7, 7))
    )
    logit, after = advance(parameters, hidden, symbol, image, goal)
    inputs = np.concatenate([symbol, image, goal], axis=-1)
    theirs, _ = nn.GRUCell(11).apply({"params": parameters.tree["cell"]}, hidden, inputs)
    np.testing.assert_allclose(after, theirs, atol=1e-6)

    def gate(name: str, values: Any) -> Any:
        layer = parameters.tree["cell"][name]
        return np.asarray(values, float) @ np.asarray(layer["kernel"], float) + np.asarray(
            layer.get("bias", 0.0), float
        )

    reset = 1 / (1 + np.exp(-gate("ir", inputs) - gate("hr", hidden)))
    update = 1 / (1 + np.exp(-gate("iz", inputs) - gate("hz", hidden)))
    candidate = np.tanh(gate("in", inputs) + reset * gate("hn", hidden))
    by_hand = (1 - update) * candidate + update * np.asarray(hidden, float)
    np.testing.assert_allclose(after, by_hand, atol=1e-5)
    output = parameters.tree["output"]
    np.testing.assert_allclose(
        logit, (by_hand @ np.asarray(output["kernel"]) + output["bias"])[:, 0], atol=1e-5
    )


@pytest.mark.parametrize("goal", [True, False])
def test_sequence_agrees_with_single_steps(goal: bool) -> None:
    parameters = random_parameters(NetworkConfig(image_size=16, goal=goal))
    normals = jax.random.normal(jax.random.key(3), (2, 6, 2), "float32")
    symbols = encode_symbols(parameters, jnp.arange(12).reshape(2, 6), normals)
    images = jax.random.normal(jax.random.key(1), (2, 6, 100), "float32")
    aim = jax.random.normal(jax.random.key(2), (2, 100), "float32") if goal else None
    logits = jax.jit(run_sequence)(parameters, symbols, images, aim)
    hidden = jnp.zeros((2, 300), "float32")
    one_step = jax.jit(advance)
    for k in range(6):
        logit, hidden = one_step(parameters, hidden, symbols[:, k], images[:, k], aim)
        np.testing.assert_allclose(logits[:, k], logit, atol=1e-5)


def test_sizes_are_those_of_the_paper() -> None:
    shapes = jax.tree.map(
        jnp.shape, initial_parameters(NetworkConfig(normals=False, pooling=False), 0).tree
    )
    assert [shapes[f"convolutions_{i}"]["kernel"] for i in range(3)] == [
        (5, 5, 3, 5),
        (5, 5, 5, 10),
        (5, 5, 10, 10),
    ]
    assert shapes["image_dense"]["kernel"] == (16 * 16 * 10, 100) and "pool_dense" not in shapes
    assert shapes["symbol_dense"]["kernel"] == (12, 100)
    assert shapes["cell"]["in"]["kernel"] == (300, 300) and shapes["cell"]["hn"]["kernel"] == (
        300,
        300,
    )
    assert shapes["output"]["kernel"] == (300, 1)
    classifier = initial_parameters(NetworkConfig(goal=False), 0).tree
    assert classifier["cell"]["in"]["kernel"].shape == (200, 300)
    assert classifier["symbol_dense"]["kernel"].shape == (
        12 + 2,
        100,
    )  # beyond the paper: a face's normal


def test_parameters_are_single_precision_whatever_the_default() -> None:
    assert jax.config.values["jax_enable_x64"]
    parameters = initial_parameters(SMALL, 0)
    assert {leaf.dtype for leaf in jax.tree.leaves(parameters)} == {jnp.dtype("float32")}
    codes = encode_symbols(parameters, jnp.arange(12)[None], jnp.zeros((1, 12, 2), "float32"))
    assert run_sequence(parameters, codes, codes, codes[:, 0]).dtype == jnp.float32


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"image_size": 4}, "size is 4"),
        ({"image_size": 66}, "size is 66 pixels; valid are multiples of 4 from 8 to 1024"),
        ({"hidden": 0}, "hidden is 0"),
        ({"channels": (5, 0, 10)}, r"channels\[1\] is 0; valid are whole numbers from 1 to 16384"),
        ({"hidden": 5.0}, "hidden is 5.0; valid are whole numbers"),
        ({"dense": 10**12}, "dense is 1000000000000; valid are whole numbers"),
        ({"goal": "no"}, "goal is 'no'; valid are true and false"),
    ],
)
def test_impossible_sizes_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        NetworkConfig(**wrong)
