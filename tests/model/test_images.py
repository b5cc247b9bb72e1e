"""Images against the camera they come from, and their assembly against plain indexing."""

import jax.numpy as jnp
import numpy as np

from dvr_jax.model.images import MASK_VALUE, assemble_images, normalize_depth, scene_images, stack_images
from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.sampling import sample_scenes


def test_layers_are_objects_goal_and_zeros() -> None:
    scene = next(sample_scenes(1, 3, 0))
    images, seen = scene_images(scene, 48), render_depth(scene, 48, 48)
    assert images.depth.dtype == np.float32 and images.masks.dtype == np.uint8
    assert images.masks.shape == (5, 48, 48)
    np.testing.assert_array_equal(images.masks[:3] > 0, seen.object_masks)
    np.testing.assert_array_equal(images.masks[3] > 0, seen.goal_mask)
    assert not images.masks[4].any()


def test_depth_is_zero_on_the_table_and_tells_heights_apart() -> None:
    np.testing.assert_allclose(normalize_depth(np.float32([2.6, 2.5, 2.35, 1.0, 3.0])), [0, -0.4, -1, -1, 1], atol=1e-6)
    depths = np.stack([scene_images(scene, 32).depth for scene in sample_scenes(10, 2, 0)])
    assert abs(depths.mean()) < 0.3 and depths.min() >= -1 and depths.max() <= 1


def test_assembly_puts_the_pair_behind_the_depth() -> None:
    scenes = [next(sample_scenes(1, number, 3)) for number in (1, 3)]
    stack = stack_images([scene_images(scene, 16) for scene in scenes], 3)
    owner, pairs = np.array([1, 0, 1]), np.array([[2, 3], [0, 2], [1, 4]])
    images = assemble_images(*(jnp.asarray(item) for item in (*stack, owner, pairs)))
    assert images.shape == (3, 16, 16, 3) and images.dtype == jnp.float32
    for image, scene, (first, second) in zip(np.asarray(images), owner, pairs, strict=True):
        alone = scene_images(scenes[scene], 16)
        np.testing.assert_array_equal(image[..., 0], alone.depth)
        np.testing.assert_array_equal(image[..., 1], MASK_VALUE * alone.masks[first])
        np.testing.assert_array_equal(image[..., 2], MASK_VALUE * alone.masks[second])
