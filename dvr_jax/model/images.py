"""Action-object images of one scene: what the network sees of an action's objects.

The paper's I(O, S) has one channel of depth and two masks, all of the *initial* scene. The depth is the same for all
actions and there are few masks, so both are stored once: a pair of indices into the stack of masks stands for an
image. The stack is: one mask per object in the scene's order, the goal region's, and one of zeros, which fills the
channel of an absent second object.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.scene.camera import render_depth
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import Scene

CHANNELS = 3
"""Depth and two masks."""

TABLE_DEPTH = SCENE_CAMERA.position[2]
"""Depth of the table's top (m): the camera looks straight down, and this is also the mean depth of sampled scenes."""

DEPTH_RANGE = 0.25
"""Height above (or below) the table that becomes 1 (or -1), m. Objects are 4 to 12 cm high; what exceeds the range are
the arms at home and the floor, which look alike in all scenes, so the range is not spent on them."""


MASK_VALUE = 16.0
"""What a mask's pixels of 1 are to the network. An object covers some 10 of 64 x 64 pixels, so this gives the channel
about unit variance. A small network that has to learn which arm stands on the object's side leaves the plateau of the
loss after 100 steps with 16, 150 with 4 and 250 with 1 (learning rate 3e-3, 24 pixels)."""


class SceneImages(NamedTuple):
    """Depth and masks of one scene."""

    depth: NDArray[np.float32]
    """Normalised depth (H, W) in [-1, 1], see `normalize_depth`."""
    masks: NDArray[np.uint8]
    """0 or 1 (N + 2, H, W): the objects in the scene's order, the goal region, zeros."""


class ImageStack(NamedTuple):
    """Depth and masks of S scenes with at most N objects, as one table; scenes with fewer objects have more zeros."""

    depth: NDArray[np.float32]
    """(S, H, W)."""
    masks: NDArray[np.uint8]
    """(S, N + 2, H, W)."""


def normalize_depth(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth in metres to [-1, 1]: 0 at the table's top, positive farther from the camera."""
    return np.clip((depth - TABLE_DEPTH) / DEPTH_RANGE, -1.0, 1.0).astype(np.float32)


def scene_images(scene: Scene, size: int) -> SceneImages:
    """Depth and masks of a scene as images of size x size pixels."""
    image = render_depth(scene, size, size)
    masks = np.concatenate([image.object_masks, image.goal_mask[None], np.zeros((1, size, size), bool)])
    return SceneImages(normalize_depth(image.depth), masks.astype(np.uint8))


def stack_images(images: Sequence[SceneImages], most_objects: int) -> ImageStack:
    """One table of scenes with 1 to `most_objects` objects each."""
    size = images[0].depth.shape[0]
    masks = np.zeros((len(images), most_objects + 2, size, size), np.uint8)
    for row, item in zip(masks, images, strict=True):
        row[: len(item.masks)] = item.masks
    return ImageStack(np.stack([item.depth for item in images]), masks)


def show_scenes(depth: jax.Array, masks: jax.Array, scene: jax.Array, turned: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Channels of shown scenes, depth (V, H, W) and masks (V, M, H, W), as an action-object image has them: view v
    shows scene `scene[v]` (V,) of depth (S, H, W) and masks (S, M, H, W), turned by 180 degrees where `turned` (V,).
    Runs on the device."""

    def turn(images: jax.Array) -> jax.Array:
        return jnp.where(jnp.expand_dims(turned, tuple(range(1, images.ndim))), images[..., ::-1, ::-1], images)

    return turn(depth[scene]), MASK_VALUE * turn(masks[scene]).astype(jnp.float32)
