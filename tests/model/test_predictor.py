"""The predictor against the network on whole sequences, for every number of objects."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from dvr_jax.errors import DvrError
from dvr_jax.logic import enumerate_sequences
from dvr_jax.model import predictor as predictor_module
from dvr_jax.model import scene_encoding
from dvr_jax.model.encoding import SYMBOLS, direction
from dvr_jax.model.export import export_network
from dvr_jax.model.images import BRIGHTNESS, WHOLE_PIXEL, depth_images, scene_images
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.network import Network, initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.predictor import SHIPPED, Predictor, load_network
from dvr_jax.model.scene_encoding import BATCH_SIZES
from dvr_jax.scene.camera import empty_depth, render_depth
from dvr_jax.scene.sampling import SceneDistribution, sample_scenes
from dvr_jax.shapes import FACES

PARAMETERS = initial_parameters(
    NetworkConfig(image_size=16, channels=(2, 3, 3), dense=9, hidden=13), 4
)
PREDICTOR = Predictor(PARAMETERS, NetworkMetadata("dvr", PARAMETERS.config))
SPARSE = SceneDistribution(wide_side=(0.05, 0.08))


@pytest.mark.parametrize("number", [1, 2, 3, 5, 8])
def test_steps_are_the_network_on_the_actions_images(number: int) -> None:
    scene = next(sample_scenes(1, number, 1, SPARSE))
    encoding = PREDICTOR.encode_scene(scene)
    sequence = next(enumerate_sequences(encoding.grounding, 4))
    network, variables = PARAMETERS.network()
    images = scene_images(scene, 16, 4)

    def encode(first: int, second: int) -> object:
        channels = [images.height, *images.masks[[first, second]] / WHOLE_PIXEL]
        image = BRIGHTNESS * np.stack(channels, axis=-1).astype(np.float32)
        return network.apply(variables, jnp.asarray(image[None]), method=Network.encode_images)

    goal = encode(scene.goal_index, number)
    mine = encoding.initial_hidden()
    theirs = jnp.zeros((1, 13), jnp.float32)
    for index in sequence:
        action = encoding.grounding.actions[index]
        name = action.arguments[2 if action.operator == "grasp" else 1]
        item = scene.objects[scene.object_index(name)]
        words = (
            direction(word, item) if word in FACES else word
            for word in action.arguments
            if word != name
        )
        symbol = SYMBOLS.index((action.operator, *words))

        image = encode(
            scene.object_index(name), number if action.arguments[-1] == "goal" else number + 1
        )
        turn = item.yaw + (
            FACES.index(action.arguments[1]) * np.pi / 2 if action.operator == "grasp" else 0
        )
        normal = jnp.array([[np.cos(turn), np.sin(turn)]], jnp.float32) * (
            action.operator == "grasp"
        )
        word = network.apply(variables, jnp.array([symbol]), normal, method=Network.encode_symbols)

        logit, theirs = network.apply(variables, theirs, word, image, goal, method=Network.advance)
        probability, mine = PREDICTOR.predict(encoding, mine, [index])
        np.testing.assert_allclose(probability, 1 / (1 + np.exp(-np.asarray(logit))), atol=1e-5)
        np.testing.assert_allclose(mine, theirs, atol=1e-5)


def test_images_of_another_camera_take_the_place_of_the_rendered_ones() -> None:
    scene = next(sample_scenes(1, 2, 0))
    seen = render_depth(scene, 64, 64)

    def answer(predictor: Predictor) -> Float[np.ndarray, " actions"]:
        encoding = predictor.encode_scene(scene)
        return predictor.predict(encoding, encoding.initial_hidden(24), range(24))[0]

    def answer_to(depth: Float[np.ndarray, "height width"]) -> Float[np.ndarray, " actions"]:
        return answer(
            replace(PREDICTOR, images=depth_images(scene, replace(seen, depth=depth), 16))
        )

    np.testing.assert_array_equal(answer_to(seen.depth), answer(PREDICTOR))
    empty = empty_depth(scene.workcell, 64, 64)
    assert not np.array_equal(answer_to(empty), answer(PREDICTOR))
    np.testing.assert_array_equal(
        answer_to(np.full((64, 64), np.nan, np.float32)), answer_to(empty)
    )
    with pytest.raises(DvrError, match=r"\(8, 8\).*valid.*\(16, 16\)"):
        answer(replace(PREDICTOR, images=scene_images(scene, 8, 1)))
    with pytest.raises(DvrError, match=r"\(64, 63\).*valid.*\(64, 64\)"):
        answer_to(seen.depth[:, 1:])


def test_rows_do_not_see_each_other_nor_the_padding() -> None:
    encoding = PREDICTOR.encode_scene(next(sample_scenes(1, 2, 0)))
    generator = np.random.default_rng(0)
    number = BATCH_SIZES[-1] + 3
    actions = generator.integers(0, 24, number)
    hidden = generator.normal(size=(number, 13)).astype(np.float32)
    probabilities, after = PREDICTOR.predict(encoding, hidden, actions)
    for row in (0, 7, number - 1):
        alone, state = PREDICTOR.predict(encoding, hidden[[row]], actions[[row]])
        np.testing.assert_allclose(alone[0], probabilities[row], atol=1e-6)
        np.testing.assert_allclose(state[0], after[row], atol=1e-6)
    assert [item.shape for item in PREDICTOR.predict(encoding, hidden[:0], [])] == [(0,), (0, 13)]


def test_one_state_serves_all_actions() -> None:
    encoding = PREDICTOR.encode_scene(next(sample_scenes(1, 2, 0)))
    hidden = np.random.default_rng(0).normal(size=(1, 13)).astype(np.float32)
    for number in (1, 7, 24):
        for mine, theirs in zip(
            PREDICTOR.predict(encoding, hidden, range(number)),
            PREDICTOR.predict(encoding, np.repeat(hidden, number, axis=0), range(number)),
            strict=True,
        ):
            np.testing.assert_allclose(mine, theirs, atol=1e-6)


def test_few_shapes_are_compiled_and_images_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: dict[str, list[tuple[int, ...]]] = {"predict_rows": [], "_encode_scene": []}
    for module, name in ((predictor_module, "predict_rows"), (scene_encoding, "_encode_scene")):
        original = getattr(module, name)

        def recorded(*args: object, name: str = name, original: object = original) -> object:
            shapes[name].append(args[3].shape)  # type: ignore[attr-defined]
            return original(*args)  # type: ignore[operator]

        monkeypatch.setattr(module, name, recorded)

    encoding = PREDICTOR.encode_scene(next(sample_scenes(1, 2, 0)))
    for number in range(1, 300, 13):
        PREDICTOR.predict(encoding, encoding.initial_hidden(number), np.zeros(number, int))
    assert set(shapes["predict_rows"]) == {(size,) for size in BATCH_SIZES}
    assert len(shapes["_encode_scene"]) == 1


def test_classifier_needs_no_goal(tmp_path: Path) -> None:
    parameters = initial_parameters(
        NetworkConfig(image_size=16, channels=(1, 1, 1), dense=4, hidden=5, goal=False), 0
    )
    export_network(
        tmp_path / "network.npz", parameters, NetworkMetadata("classifier", parameters.config)
    )
    predictor = Predictor.load(tmp_path / "network.npz")
    assert predictor.kind == "classifier"
    encoding = predictor.encode_scene(next(sample_scenes(1, 1, 0)))
    probabilities, _ = predictor.predict(encoding, encoding.initial_hidden(12), range(12))
    assert probabilities.shape == (12,) and np.all((probabilities > 0) & (probabilities < 1))


def test_wrong_queries_are_refused() -> None:
    encoding = PREDICTOR.encode_scene(next(sample_scenes(1, 1, 0)))
    with pytest.raises(DvrError, match="no action 12; valid are 0 to 11"):
        PREDICTOR.predict(encoding, encoding.initial_hidden(), [12])
    with pytest.raises(DvrError, match=r"shape \(3, 13\); valid is \(2, 13\)"):
        PREDICTOR.predict(encoding, encoding.initial_hidden(3), [0, 1])


def test_the_shipped_network_is_read_once() -> None:
    """So that plans from Python find its programs ready after the first."""
    assert load_network("dvr") is load_network("dvr") is Predictor.shipped("dvr")
    with pytest.raises(DvrError, match="no network of the kind 'oracle' is shipped"):
        Predictor.shipped("oracle")
    with pytest.raises(
        DvrError, match=r"dvr\.npz holds a network of the kind 'dvr'; valid is 'classifier'"
    ):
        load_network("classifier", SHIPPED / "dvr.npz")
