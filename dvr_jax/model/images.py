"""Action-object images of one scene: what the network sees of an action's objects.

The paper's I(O, S) has one channel of depth and two masks, all of the *initial* scene. Here the depth is taken against
that of the same table with nothing on it, so that the channel is zero but for what stands there: arms and floor, which
look alike in all scenes and are ten times as high, would drown it. And a pixel is a mean over several rays, a mask's
the share that it covers: a pixel is 3 cm wide, and whether two boxes fit on a target is a matter of 1 cm.

The heights are the same for all actions and there are few masks, so both are stored once: a pair of indices into the
stack of masks stands for an image. The stack is: one mask per object in the scene's order, the goal region's, and one
of zeros, which fills the channel of an absent second object.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.scene.camera import DepthImage, empty_depth, render_depth
from dvr_jax.scene.types import Scene

CHANNELS = 3
"""Heights and two masks."""

UNIT_HEIGHT = 0.1
"""Height that becomes 1, m: objects are 4 to 12 cm high."""

LARGEST_HEIGHT = 2.0
"""Heights are cut off here (in units of UNIT_HEIGHT)."""

WHOLE_PIXEL = 255
"""What a mask says of a pixel that it covers."""

BRIGHTNESS = 16.0
"""What a height of 1, and a mask's pixel of 1, are to the network. An object covers some 10 of 64 x 64 pixels, so this
gives each channel about unit variance. A small network that has to learn which arm stands on the object's side leaves
the plateau of the loss after 100 steps with 16, 150 with 4 and 250 with 1 (learning rate 3e-3, 24 pixels)."""


class SceneImages(NamedTuple):
    """Heights and masks of one scene."""

    height: NDArray[np.float32]
    """Height above the empty table as the camera sees it (H, W), in units of UNIT_HEIGHT."""
    masks: NDArray[np.uint8]
    """Shares of each pixel in units of 1 / `WHOLE_PIXEL` (N + 2, H, W): the objects in the scene's order, the goal
    region, zeros."""


class ImageStack(NamedTuple):
    """Heights and masks of S scenes with at most N objects, as one table; scenes with fewer objects have more zeros."""

    height: NDArray[np.float32]
    """(S, H, W)."""
    masks: NDArray[np.uint8]
    """(S, N + 2, H, W)."""


def scene_images(scene: Scene, size: int, rays: int) -> SceneImages:
    """Heights and masks of a scene as images of size x size pixels, each the mean over rays x rays rays."""
    return depth_images(scene, render_depth(scene, rays * size, rays * size), size)


def depth_images(scene: Scene, image: DepthImage, size: int) -> SceneImages:
    """The same of a depth image of the scene, rendered or a real camera's (H, H), H a multiple of the network's size.

    The network knows one camera, `dvr_jax.scene.pinhole.SCENE_CAMERA`: depth [m] along its optical axis, seen from its
    place; the arms are at home. A pixel that is not finite counts as empty table. The goal's mask covers the whole
    region, also where something stands on it.
    """
    H = len(image.depth)
    shapes = image.depth.shape, image.object_masks.shape, image.goal_mask.shape
    valid = (H, H), (len(scene.objects), H, H), (H, H)
    if shapes != valid:
        raise DvrError(f"depth, objects' masks and goal's mask have the shapes {shapes}; valid are {valid}.")
    if H == 0 or H % size:
        raise DvrError(f"the images have {H} x {H} pixels; valid is a multiple of the network's {size}.")
    height = np.nan_to_num((empty_depth(scene.home, H, H) - image.depth) / UNIT_HEIGHT, nan=0, posinf=0, neginf=0)
    masks = np.concatenate([image.object_masks, image.goal_mask[None], np.zeros((1, H, H), bool)])
    return SceneImages(
        _mean(np.clip(height, -LARGEST_HEIGHT, LARGEST_HEIGHT), size),
        np.rint(WHOLE_PIXEL * _mean(masks, size)).astype(np.uint8),
    )


def _mean(images: NDArray[Any], size: int) -> NDArray[np.float32]:
    """Images (..., H, H) as (..., size, size), each pixel a mean."""
    share = images.shape[-1] // size
    rows = np.asarray(np.sum([images[..., i::share, :] for i in range(share)], axis=0, dtype=np.float32))
    return np.asarray(np.sum([rows[..., i::share] for i in range(share)], axis=0) / np.float32(share**2))


def stack_images(images: Sequence[SceneImages], most_objects: int) -> ImageStack:
    """One table of scenes with 1 to `most_objects` objects each."""
    size = images[0].height.shape[0]
    masks = np.zeros((len(images), most_objects + 2, size, size), np.uint8)
    for row, item in zip(masks, images, strict=True):
        row[: len(item.masks)] = item.masks
    return ImageStack(np.stack([item.height for item in images]), masks)


def show_scenes(
    height: jax.Array, masks: jax.Array, scene: jax.Array, mirrored: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Channels of shown scenes, heights (V, H, W) and masks (V, M, H, W), as an action-object image has them: view v
    shows scene `scene[v]` (V,) of heights (S, H, W) and masks (S, M, H, W), its x and its y reversed where `mirrored`
    (V, 2). Runs on the device."""

    def show(images: jax.Array) -> jax.Array:
        in_x, in_y = jnp.expand_dims(mirrored.T, tuple(range(2, images.ndim + 1)))
        images = jnp.where(in_x, images[..., ::-1], images)
        return BRIGHTNESS * jnp.where(in_y, images[..., ::-1, :], images).astype(jnp.float32)

    return show(height[scene]), show(masks[scene]) / WHOLE_PIXEL
