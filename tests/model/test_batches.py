"""Batches: what is drawn, that each image is there once, and that every step finds its own image again."""

from typing import Any

import numpy as np
import pytest
from labelled import Examples, sided_examples

from dvr_jax.errors import DvrError
from dvr_jax.logic import FACES
from dvr_jax.model.batches import (
    IMAGE_BUCKET,
    assemble_batch,
    check_examples,
    draw_rows,
    draw_turned,
    held_out_scenes,
    scene_table,
    share_of_ones,
)
from dvr_jax.model.encoding import SYMBOLS, TURNED, direction
from dvr_jax.model.images import scene_images, stack_images

ONE, TWO = sided_examples(2, 1, objects=1, longest=3), sided_examples(3, 2, objects=2, longest=3)
MIXED = Examples(
    ONE.scenes + TWO.scenes,
    np.concatenate([ONE.scene, TWO.scene + 2]),
    *(np.concatenate([mine, theirs]) for mine, theirs in zip(ONE[2:], TWO[2:], strict=True)),
)  # scenes with one object and with two
TABLE = scene_table(MIXED.scenes, stack_images([scene_images(scene, 8) for scene in MIXED.scenes], 2))


def test_every_step_finds_symbol_and_masks_of_its_action() -> None:
    rows = np.random.default_rng(0).permutation(len(MIXED.scene))[:40]
    batch = assemble_batch(MIXED, TABLE, rows, "dvr")
    for b, row in enumerate(rows):
        scene = MIXED.scenes[MIXED.scene[row]]
        number = len(scene.objects)
        for k in range(MIXED.length[row]):
            action = TABLE.groundings[MIXED.scene[row]].actions[MIXED.actions[row, k]]
            name = action.arguments[2 if action.operator == "grasp" else 1]
            item = scene.objects[scene.object_index(name)]
            words = (direction(word, item) if word in FACES else word for word in action.arguments if word != name)
            symbol = (action.operator, *words)
            second = number if symbol[-1] == "goal" else number + 1
            assert SYMBOLS[batch.symbol[b, k]] == symbol
            assert batch.image_scene[batch.image[b, k]] == MIXED.scene[row]
            assert tuple(batch.image_pair[batch.image[b, k]]) == (scene.object_index(name), second)
        assert batch.image_scene[batch.goal_image[b]] == MIXED.scene[row]
        assert tuple(batch.image_pair[batch.goal_image[b]]) == (scene.goal_index, number)
        np.testing.assert_array_equal(batch.mask[b], np.arange(3) < MIXED.length[row])
        np.testing.assert_array_equal(batch.target[b], MIXED.targets[row])


def test_each_image_is_encoded_once_for_all_steps_and_sequences() -> None:
    rows = np.arange(len(MIXED.scene))
    batch = assemble_batch(MIXED, TABLE, rows, "dvr")
    shown = list(zip(batch.image_scene, *batch.image_pair.T, strict=True))
    assert batch.symbol.size > 500
    # With one object both tuples; with two, three actions never put the other object on the goal as well.
    assert len(set(shown)) == 2 * 2 + 3 * 3
    assert len(shown) == IMAGE_BUCKET


def test_turned_sequences_find_turned_images_and_symbols() -> None:
    rows, turned = np.arange(40), np.arange(40) % 3 == 0
    plain, batch = assemble_batch(MIXED, TABLE, rows, "dvr"), assemble_batch(MIXED, TABLE, rows, "dvr", turned)
    np.testing.assert_array_equal(batch.symbol[turned], TURNED[plain.symbol[turned]])
    np.testing.assert_array_equal(batch.symbol[~turned], plain.symbol[~turned])
    np.testing.assert_array_equal(batch.image_turned[batch.image], np.repeat(turned[:, None], 3, axis=1))
    np.testing.assert_array_equal(batch.image_turned[batch.goal_image], turned)
    np.testing.assert_array_equal(batch.image_scene[batch.image], plain.image_scene[plain.image])
    np.testing.assert_array_equal(batch.image_pair[batch.image], plain.image_pair[plain.image])
    np.testing.assert_array_equal(draw_turned(48, 0, 7), draw_turned(48, 0, 7))


def test_classifier_learns_the_verdict_at_the_last_step_and_that_prefixes_of_feasible_ones_are() -> None:
    rows = np.arange(0, len(MIXED.scene), 7)
    batch = assemble_batch(MIXED, TABLE, rows, "classifier")
    last = np.arange(3) == MIXED.length[rows, None] - 1
    before = (np.arange(3) < MIXED.length[rows, None]) & MIXED.feasible[rows, None]
    np.testing.assert_array_equal(batch.mask, last | before)
    np.testing.assert_array_equal(batch.target.max(axis=1) > 0, MIXED.feasible[rows])


def test_draw_depends_on_seed_and_step_alone_and_holds_enough_feasible() -> None:
    rows, feasible = np.arange(10_000), np.arange(0, 10_000, 500)
    drawn = [draw_rows(rows, feasible, 48, 16, 3, step) for step in range(20)]
    for step, batch in enumerate(drawn):
        assert len(batch) == 48 and np.isin(batch, feasible).sum() >= 16
        np.testing.assert_array_equal(batch, draw_rows(rows, feasible, 48, 16, 3, step))
    assert len({tuple(batch) for batch in drawn}) == 20
    assert tuple(draw_rows(rows, feasible, 48, 16, 4, 0)) != tuple(drawn[0])
    assert len(draw_rows(rows, feasible[:0], 48, 16, 3, 0)) == 48


def test_share_of_ones_is_what_batches_hold_on_average() -> None:
    rows, feasible = np.arange(len(MIXED.scene)), np.flatnonzero(MIXED.feasible)
    batches = [assemble_batch(MIXED, TABLE, draw_rows(rows, feasible, 48, 16, 0, step), "dvr") for step in range(300)]
    share = sum(batch.target.sum() for batch in batches) / sum(batch.mask.sum() for batch in batches)
    assert abs(share - share_of_ones(MIXED, rows, feasible, 1 / 3, "dvr")) < 0.01


def test_held_out_scenes_stay_when_scenes_are_added() -> None:
    few, many = held_out_scenes(1_000, 0.1), held_out_scenes(5_000, 0.1)
    np.testing.assert_array_equal(few, many[:1_000])
    assert 400 < many.sum() < 600 and not held_out_scenes(100, 0.0).any()
    with pytest.raises(DvrError, match=r"fraction is 1\.5"):
        held_out_scenes(10, 1.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": MIXED.scene + 1}, "scene goes from 1 to 5; valid is 0 to 4"),
        ({"length": MIXED.length + 1}, "length goes from 3 to 4; valid is 1 to 3"),
        ({"actions": np.where(MIXED.actions == 3, 24, MIXED.actions)}, "has action 24 at step 1; valid are 0 to 11"),
        ({"targets": MIXED.targets[:, :2]}, "targets has shape"),
        ({"scene": MIXED.scene[:0]}, "no labelled sequence"),
    ],
)
def test_contradictory_examples_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        check_examples(MIXED._replace(**change), "data")


def test_good_examples_pass() -> None:
    check_examples(MIXED, "data")
