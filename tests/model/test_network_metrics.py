"""Average precision against its definition; greedy sequences against single queries of the predictor."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from labelled import sided_examples

from dvr_jax.model.greedy import greedy_sequences
from dvr_jax.model.images import scene_images, stack_images
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.metrics import average_precision
from dvr_jax.model.network import initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.predictor import Predictor
from dvr_jax.model.scene_table import build_scene_table


def by_definition(labels: list[bool], scores: list[int]) -> float:
    """Sum over thresholds of (R_n - R_{n-1}) P_n, each counted from scratch."""
    total = 0.0
    recall_before = 0.0
    for threshold in sorted(set(scores), reverse=True):
        chosen = [label for label, score in zip(labels, scores, strict=True) if score >= threshold]
        recall = sum(chosen) / sum(labels)
        total += (recall - recall_before) * sum(chosen) / len(chosen)
        recall_before = recall
    return total


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.integers(0, 5)), min_size=1, max_size=30))
def test_average_precision_is_its_definition(pairs: list[tuple[bool, int]]) -> None:
    labels, scores = (list(column) for column in zip(*pairs, strict=True))
    value = average_precision(np.array(labels), np.array(scores, float))
    if any(labels):
        assert math.isclose(value, by_definition(labels, scores), abs_tol=1e-12)
    else:
        assert math.isnan(value)


def test_average_precision_on_paper() -> None:
    # Ranks 1 and 3 of 4 are right: (1/1 + 2/3) / 2.
    assert average_precision(
        np.array([1, 0, 1, 0], bool), np.array([4.0, 3, 2, 1])
    ) == pytest.approx(5 / 6)


def test_greedy_sequences_take_the_best_of_the_predictor_at_each_step() -> None:
    examples = sided_examples(3, 5)
    parameters = initial_parameters(
        NetworkConfig(image_size=16, channels=(2, 2, 2), dense=8, hidden=12), 1
    )
    images = [scene_images(scene, 16, 4) for scene in examples.scenes]
    table = build_scene_table(examples.scenes, stack_images(images, 2))
    predictor = Predictor(parameters, NetworkMetadata("dvr", parameters.config))
    k_max = 5
    sequences = greedy_sequences(parameters, table, [2, 0, 1], k_max)
    for scene, sequence in zip((2, 0, 1), sequences, strict=True):
        encoding = predictor.encode_scene(examples.scenes[scene])
        grounding = encoding.grounding
        hidden = encoding.initial_hidden()
        state = grounding.initial_state
        grounding.check_sequence([grounding.actions[index] for index in sequence])
        for depth, taken in enumerate(sequence):
            open_actions = [
                index
                for index in grounding.applicable(state)
                if grounding.can_reach_goal(grounding.successor(state, index), k_max - depth - 1)
            ]
            probabilities, after = predictor.predict(encoding, hidden, open_actions)
            assert taken == open_actions[int(np.argmax(probabilities))]
            hidden = after[[np.argmax(probabilities)]]
            state = grounding.successor(state, taken)
        assert grounding.is_goal(state)
