"""Images against the camera they come from, and their views against plain indexing."""

import math
from dataclasses import replace
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
import pytest

from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.model.encoding import MIRRORED, encode_actions
from dvr_jax.model.images import (
    BRIGHTNESS,
    UNIT_HEIGHT,
    WHOLE_PIXEL,
    depth_images,
    scene_images,
    stack_images,
    view_channels,
)
from dvr_jax.operators import ground_scene
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.sampling import sample_scenes
from dvr_jax.scene.types import Region, SceneObject
from dvr_jax.scene.validation import make_scene

Thing = TypeVar("Thing", SceneObject, Region)


def test_layers_are_objects_goal_and_zeros() -> None:
    scene = next(sample_scenes(1, 3, 0))
    images = scene_images(scene, 48, 1)
    seen = render_depth(scene, 48, 48)
    assert images.height.dtype == np.float32 and images.masks.dtype == np.uint8
    assert images.masks.shape == (5, 48, 48)
    np.testing.assert_array_equal(
        images.masks[:3], WHOLE_PIXEL * seen.object_masks.astype(np.uint8)
    )
    np.testing.assert_array_equal(images.masks[3], WHOLE_PIXEL * seen.goal_mask.astype(np.uint8))
    assert not images.masks[4].any()


def test_a_pixel_is_the_mean_of_its_rays() -> None:
    """A mask of a goal of 8 cm and more knows its area to 4 % and its place to a thirtieth of a pixel, which is 3.4 cm
    wide; of a small cube's goal, to 10 % and a tenth."""
    scene = next(sample_scenes(1, 2, 0))
    fine, coarse = scene_images(scene, 64, 1), scene_images(scene, 16, 4)
    for seen, mean in zip((fine.height, *fine.masks), (coarse.height, *coarse.masks), strict=True):
        blocks = seen.reshape(16, 4, 16, 4).astype(float).mean(axis=(1, 3))
        np.testing.assert_allclose(
            mean, np.rint(blocks) if mean.dtype == np.uint8 else blocks, atol=1e-5
        )
    errors: dict[bool, list[list[float]]] = {False: [], True: []}
    for scene in sample_scenes(20, 2, 0):
        mask = scene_images(scene, 64, 4).masks[2] / WHOLE_PIXEL
        width = 2 * SCENE_CAMERA.position[2] * math.tan(SCENE_CAMERA.field_of_view / 2) / 64
        x = ((np.arange(64) - 31.5) * mask.sum(0)).sum() * width / mask.sum()
        error = [
            x - scene.goal.region.position[0],
            mask.sum() * width**2 / np.prod(scene.goal.region.size) - 1,
        ]
        errors[min(scene.goal.region.size) < 0.08].append(error)
    for small, (place, area) in {False: (1e-3, 0.04), True: (3.4e-3, 0.1)}.items():
        assert len(errors[small]) > 4 and (np.abs(errors[small]).max(axis=0) < [place, area]).all()


def test_images_that_the_network_cannot_average_are_refused() -> None:
    scene = next(sample_scenes(1, 2, 0))
    with pytest.raises(DvrError, match="40 x 40 pixels; valid is a multiple of the network's 64"):
        depth_images(scene, render_depth(scene, 40, 40), 64)


def test_height_is_that_of_what_stands_on_the_table() -> None:
    for scene in sample_scenes(5, 2, 0):
        images = scene_images(scene, 256, 1)  # at 64 all rays may pass beside a small cube
        for mask, item in zip(images.masks, scene.objects, strict=False):
            # Some rays meet the top, the others a side.
            np.testing.assert_allclose(
                images.height[mask > 0].max(), item.height / UNIT_HEIGHT, atol=1e-4
            )
        # Neither the arms nor the floor are seen.
        assert not images.height[~(images.masks[:2] > 0).any(0)].any()


def test_views_are_scenes_as_they_are_or_mirrored() -> None:
    scenes = [next(sample_scenes(1, number, 3)) for number in (1, 3)]
    stack = stack_images([scene_images(scene, 16, 2) for scene in scenes], 3)
    owner = np.array([1, 0, 1, 0])
    mirrored = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], bool)
    height, masks = view_channels(*(jnp.asarray(item) for item in (*stack, owner, mirrored)))
    assert height.dtype == masks.dtype == jnp.float32 and masks.shape == (4, 5, 16, 16)
    for view, (scene, (in_x, in_y)) in enumerate(zip(owner, mirrored, strict=True)):
        alone = scene_images(scenes[scene], 16, 2)
        place = np.s_[..., :: -1 if in_y else 1, :: -1 if in_x else 1]
        np.testing.assert_array_equal(height[view], np.float32(BRIGHTNESS) * alone.height[place])
        np.testing.assert_array_equal(
            masks[view, : len(alone.masks)],
            np.float32(BRIGHTNESS) * alone.masks[place] / WHOLE_PIXEL,
        )
        assert not np.asarray(masks[view, len(alone.masks) :]).any()


@pytest.mark.parametrize("in_x", [False, True])
@pytest.mark.parametrize("in_y", [False, True])
def test_a_mirrored_scene_has_mirrored_images_and_symbols(in_x: bool, in_y: bool) -> None:
    """All of the scene reversed along x, the arms too, and along y."""
    signs = np.where([in_x, in_y], -1.0, 1.0)
    words = {"left": "right", "right": "left"} if in_x else {}
    if (
        in_x != in_y
    ):  # a mirror image has the other hand: with x along the box as before, y goes the other way
        words |= {"+y": "-y", "-y": "+y"}

    def move(thing: Thing) -> Thing:
        yaw = math.atan2(signs[1] * math.sin(thing.yaw), signs[0] * math.cos(thing.yaw))
        return replace(
            thing, position=(signs[0] * thing.position[0], signs[1] * thing.position[1]), yaw=yaw
        )

    for scene in sample_scenes(10, 2, 5):
        moved = make_scene(
            map(move, scene.objects), replace(scene.goal, region=move(scene.goal.region))
        )
        here = scene_images(scene, 64, 1)
        there = scene_images(moved, 64, 1)
        place = np.s_[..., :: -1 if in_y else 1, :: -1 if in_x else 1]
        # Rays graze edges: single ones differ.
        assert (here.masks[place] != there.masks).mean() < 1e-3
        assert (np.abs(here.height[place] - there.height) > 0.05).mean() < 5e-3
        grounding = ground_scene(scene)
        codes = encode_actions(grounding, scene.objects)
        others = encode_actions(grounding, moved.objects)
        for index, action in enumerate(grounding.actions):
            arguments = tuple(words.get(word, word) for word in action.arguments)
            mirrored = grounding.index(Action(action.operator, arguments))
            assert others.symbol[mirrored] == MIRRORED[int(in_x), int(in_y), codes.symbol[index]]
            np.testing.assert_allclose(
                others.normal[mirrored], signs * codes.normal[index], atol=1e-6
            )


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_a_depth_image_in_another_unit_is_refused(factor: float) -> None:
    (scene,) = sample_scenes(1, 2, 7)
    image = render_depth(scene, 64, 64)
    depth_images(scene, image, 64)
    with pytest.raises(DvrError, match=r"the depth image has a median of .*; valid are meters"):
        depth_images(scene, replace(image, depth=factor * image.depth), 64)
