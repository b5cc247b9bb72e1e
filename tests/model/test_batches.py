"""Batches: what is drawn, that each image is there once, and that every step finds its own image again."""

from typing import Any

import numpy as np
import pytest
from jaxtyping import Int
from labelled import sided_examples

from dvr_jax.dataset.examples import Examples
from dvr_jax.errors import DvrError
from dvr_jax.model.batch_sampler import BatchSampler, draw_mirrored
from dvr_jax.model.batches import IMAGE_MULTIPLE, VIEW_MULTIPLE, assemble_batch
from dvr_jax.model.encoding import MIRRORED, SYMBOLS, direction
from dvr_jax.model.images import scene_images, stack_images
from dvr_jax.model.kind import Kind
from dvr_jax.model.scene_table import build_scene_table
from dvr_jax.model.training_data import check_examples, held_out_scenes
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.shapes import FACES

ONE = sided_examples(2, 1, objects=1, longest=3)
TWO = sided_examples(3, 2, objects=2, longest=3)
# Two scenes with one object and three with two.
MIXED = Examples(
    ONE.scenes + TWO.scenes,
    np.concatenate([ONE.scene, TWO.scene + len(ONE.scenes)]),
    *(np.concatenate([mine, theirs]) for mine, theirs in zip(ONE[2:], TWO[2:], strict=True)),
)
TABLE = build_scene_table(
    MIXED.scenes, stack_images([scene_images(scene, 8, 1) for scene in MIXED.scenes], 2)
)


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
            words = (
                direction(word, item) if word in FACES else word
                for word in action.arguments
                if word != name
            )
            symbol = (action.operator, *words)
            assert SYMBOLS[batch.symbol[b, k]] == symbol

            turn = item.yaw + (
                FACES.index(action.arguments[1]) * np.pi / 2 if action.operator == "grasp" else 0
            )
            normal = [np.cos(turn), np.sin(turn)] if action.operator == "grasp" else [0, 0]
            np.testing.assert_allclose(batch.normal[b, k], normal, atol=1e-6)

            second = number if symbol[-1] == "goal" else number + 1
            assert batch.view_scene[batch.image_view[batch.image[b, k]]] == MIXED.scene[row]
            assert tuple(batch.image_pair[batch.image[b, k]]) == (scene.object_index(name), second)

        assert batch.view_scene[batch.image_view[batch.goal_image[b]]] == MIXED.scene[row]
        assert tuple(batch.image_pair[batch.goal_image[b]]) == (scene.goal_index, number)
        np.testing.assert_array_equal(batch.weight[b], np.arange(3) < MIXED.length[row])
        np.testing.assert_array_equal(batch.target[b], MIXED.targets[row])


def test_each_image_is_encoded_once_for_all_steps_and_sequences() -> None:
    rows = np.arange(len(MIXED.scene))
    batch = assemble_batch(MIXED, TABLE, rows, "dvr")
    shown = list(zip(batch.image_view, *batch.image_pair.T, strict=True))
    assert batch.symbol.size > 500
    # With one object both tuples; with two, three actions never put the other object on the goal as well.
    assert len(set(shown)) == 2 * 2 + 3 * 3
    assert len(shown) == IMAGE_MULTIPLE
    # Each of the five scenes is one view.
    assert set(batch.view_scene) == set(range(5)) and len(batch.view_scene) == VIEW_MULTIPLE


def test_mirrored_scenes_are_mirrored_views_with_mirrored_symbols() -> None:
    rows = np.arange(0, len(MIXED.scene), 5)
    mirrored = np.array([[0, 0], [0, 1], [1, 0], [1, 1], [0, 1]], bool)
    plain = assemble_batch(MIXED, TABLE, rows, "dvr")
    batch = assemble_batch(MIXED, TABLE, rows, "dvr", mirrored)

    for row, (in_x, in_y) in enumerate(mirrored[MIXED.scene[rows]].astype(int)):
        np.testing.assert_array_equal(batch.symbol[row], MIRRORED[in_x, in_y, plain.symbol[row]])
        np.testing.assert_array_equal(
            batch.normal[row], plain.normal[row] * [1 - 2 * in_x, 1 - 2 * in_y]
        )
    np.testing.assert_array_equal(batch.view_mirrored, mirrored[batch.view_scene])
    assert not plain.view_mirrored.any()
    for name in (
        "view_scene",
        "image_view",
        "image_pair",
        "image",
        "goal_image",
        "target",
        "weight",
    ):
        np.testing.assert_array_equal(getattr(batch, name), getattr(plain, name))


def test_half_of_the_scenes_are_mirrored_along_either_axis_and_always_the_same() -> None:
    np.testing.assert_array_equal(draw_mirrored(48, 0, 7), draw_mirrored(48, 0, 7))
    assert len(np.unique(draw_mirrored(48, 0, 7), axis=0)) == 4


def test_classifier_learns_that_prefixes_of_feasible_sequences_are_and_refuted_ones_are_not() -> (
    None
):
    rows = np.arange(0, len(MIXED.scene), 7)
    refuted = np.where(MIXED.feasible, 0, 1 + np.arange(len(MIXED.scene)) % MIXED.length)
    batch = assemble_batch(MIXED._replace(refuted_after=refuted), TABLE, rows, "classifier")
    for row, weight in zip(rows, batch.weight, strict=True):
        first = 0 if MIXED.feasible[row] else refuted[row] - 1
        np.testing.assert_array_equal(np.flatnonzero(weight), np.arange(first, MIXED.length[row]))
    assert (batch.weight.sum(axis=1) < MIXED.length[rows]).any()
    np.testing.assert_array_equal(batch.target.max(axis=1) > 0, MIXED.feasible[rows])


def without_solutions(hopeless: tuple[int, ...]) -> Int[np.ndarray, " sequences"]:
    """The sequences, but of some scenes only the infeasible ones."""
    return np.flatnonzero(~(MIXED.feasible & np.isin(MIXED.scene, hopeless)))


def test_draw_depends_on_seed_and_step_alone() -> None:
    sampler = BatchSampler.from_examples(MIXED, np.arange(len(MIXED.scene)), 3, 48, 16)
    drawn = [sampler.draw(3, step) for step in range(20)]
    for step, batch in enumerate(drawn):
        np.testing.assert_array_equal(batch, sampler.draw(3, step))
    assert len({tuple(batch) for batch in drawn}) == 20
    assert tuple(sampler.draw(4, 0)) != tuple(drawn[0])


def test_batch_is_dealt_out_to_its_scenes_and_holds_enough_feasible() -> None:
    rows = without_solutions((0, 2, 3))
    sampler = BatchSampler.from_examples(
        MIXED, np.random.default_rng(0).permutation(rows), 2, 48, 16
    )
    for step in range(50):
        batch = sampler.draw(0, step)
        assert len(batch) == 48 and np.isin(batch, rows).all()
        first = MIXED.scene[batch[:16]]
        rest = MIXED.scene[batch[16:]]
        assert MIXED.feasible[batch[:16]].all() and set(first) == set(rest) - {0, 2, 3}
        assert np.unique(rest, return_counts=True)[1].tolist() == [16, 16]

    few = BatchSampler.from_examples(MIXED, without_solutions(tuple(range(5))), 12, 48, 16)
    assert len(few.draw(0, 0)) == 48 and set(MIXED.scene[few.draw(0, 0)]) == set(range(5))


@pytest.mark.parametrize("stratified", [True, False])
def test_others_are_drawn_evenly_by_the_number_of_actions_after_which_they_are_refuted(
    stratified: bool,
) -> None:
    rows = np.arange(len(MIXED.scene))[MIXED.scene == 3]
    # Half of the longest are continuations of what was refuted after two actions.
    refuted = np.where(
        (MIXED.length == 3) & (np.arange(len(MIXED.scene)) % 2 == 0), 2, MIXED.refuted_after
    )
    sampler = BatchSampler.from_examples(
        MIXED._replace(refuted_after=refuted), rows, 1, 48, 0, stratified
    )
    drawn = np.concatenate([sampler.draw(0, step) for step in range(400)])
    kinds = 10 * refuted + MIXED.length
    kinds[MIXED.feasible] = 0

    share = {kind: np.mean(kinds[drawn] == kind) for kind in (0, 22, 23, 33)}
    even = (
        dict.fromkeys(share, 0.25)
        if stratified
        else {kind: np.mean(kinds[rows] == kind) for kind in share}
    )
    assert sum(share.values()) == pytest.approx(1) and share == pytest.approx(even, abs=0.02)

    # Within a stratum all sequences are equally likely.
    one = rows[kinds[rows] == 23]
    counts = np.bincount(drawn, minlength=len(kinds))[one]
    assert counts.min() > 0.4 * counts.mean() and counts.max() < 1.8 * counts.mean()


def test_steps_count_as_much_as_their_target_weighs() -> None:
    weight = MIXED.weight * (np.arange(3) != 1)
    batch = assemble_batch(MIXED._replace(weight=weight), TABLE, np.arange(40), "dvr")
    np.testing.assert_array_equal(batch.weight, weight[:40])


@pytest.mark.parametrize("least_feasible", [16, 0])
@pytest.mark.parametrize("kind", ["dvr", "classifier"])
def test_fraction_of_ones_is_what_batches_hold_on_average(kind: Kind, least_feasible: int) -> None:
    """Scenes without solutions, which batches with feasible sequences hold less often, have more and longer rows."""
    rows = without_solutions((2, 3, 4))
    rows = rows[~((MIXED.scene[rows] < 2) & (MIXED.length[rows] > 2))]
    sampler = BatchSampler.from_examples(MIXED, rows, 2, 48, least_feasible)
    examples = MIXED._replace(refuted_after=np.minimum(MIXED.refuted_after, 2))
    batches = [
        assemble_batch(examples, TABLE, sampler.draw(0, step), kind) for step in range(1_000)
    ]
    share = sum(batch.target.sum() for batch in batches) / sum(
        batch.weight.sum() for batch in batches
    )
    assert abs(share - sampler.fraction_of_ones(examples, kind)) < 0.01


def test_held_out_scenes_stay_when_scenes_are_added() -> None:
    scenes = list(sample_scenes(1_000, 1, 0))
    few = held_out_scenes(scenes[::3], 0.1)
    many = held_out_scenes(scenes, 0.1)
    np.testing.assert_array_equal(few, many[::3])
    assert 70 < many.sum() < 130 and not held_out_scenes(scenes, 0.0).any()
    with pytest.raises(DvrError, match=r"fraction is 1\.5"):
        held_out_scenes(scenes, 1.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": MIXED.scene + 1}, "scene goes from 1 to 5; valid is 0 to 4"),
        ({"length": MIXED.length + 1}, "length goes from 3 to 4; valid is 1 to 3"),
        (
            {"actions": np.where(MIXED.actions == 3, 24, MIXED.actions)},
            "has action 24 at step 1; valid are 0 to 11",
        ),
        ({"targets": MIXED.targets[:, :2]}, "targets has shape"),
        ({"scene": MIXED.scene[:0]}, "no labelled sequence"),
    ],
)
def test_contradictory_examples_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DvrError, match=message):
        check_examples(MIXED._replace(**change), "data")


def test_good_examples_pass() -> None:
    check_examples(MIXED, "data")
