"""Action-object images of one scene: what the network sees of an action's objects.

The image I(O, S) of the paper has one channel of depth and two masks, all of the initial scene. Two things differ here:

- The depth is replaced by the height above the same table with nothing on it, so this channel is zero except where an
  object stands. Arms and floor, which look alike in all scenes and are ten times as high, would drown the objects.
- A pixel is a mean over several rays, and a mask holds the fraction of the pixel that the object covers. A pixel is
  3 cm wide, but 1 cm decides whether two boxes fit on a target.

All actions share the heights, and there are few distinct masks, so both are stored once and an image is a pair of
indices into the masks. The masks are: one for each object in the scene's order, one for the goal region, and one of
zeros, which stands for an absent second object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, Shaped, UInt8

from dvr_jax.errors import DvrError
from dvr_jax.scene.camera import DepthImage, empty_depth, render_depth
from dvr_jax.scene.types import Scene

MASKS_PER_IMAGE = 2
"""Masks of an action-object image: those of a tuple's two members."""

CHANNELS = 1 + MASKS_PER_IMAGE
"""Channels of an action-object image: heights and masks."""

UNIT_HEIGHT = 0.1
"""Height [m] that becomes 1; objects are 4 to 12 cm high."""

LARGEST_HEIGHT = 2.0
"""Largest absolute height, in units of `UNIT_HEIGHT`; heights are clipped to it."""

WHOLE_PIXEL = 255
"""Value of a mask at a pixel that the object covers completely."""

MOST_OFF = 10.0
"""Factor by which the median depth of an image may be off: 1000 would be millimeters."""

BRIGHTNESS = 16.0
"""Value that the network gets for a height of 1 and for a pixel that a mask covers completely.

An object covers some 10 of 64 x 64 pixels, so this gives each channel about unit variance. A small network that has to
learn which arm stands on the object's side leaves the plateau of the loss after 100 steps with 16, after 150 with 4 and
after 250 with 1 (learning rate 3e-3, 24 pixels).
"""


class SceneImages(NamedTuple):
    """Heights and masks of one scene with N objects."""

    height: Float[np.ndarray, "pixels pixels"]
    """Height above the empty table as the camera sees it, in units of `UNIT_HEIGHT`."""

    masks: UInt8[np.ndarray, "masks pixels pixels"]
    """Covered fraction of each pixel in units of 1 / `WHOLE_PIXEL`: N objects, goal region, zeros (N + 2 masks)."""


class ImageStack(NamedTuple):
    """Heights and masks of several scenes as one table; a scene with fewer objects has more masks of zeros."""

    height: Float[np.ndarray, "scenes pixels pixels"]
    """Heights of each scene, as in `SceneImages`."""

    masks: UInt8[np.ndarray, "scenes masks pixels pixels"]
    """Masks of each scene, as in `SceneImages`."""


def scene_images(scene: Scene, size: int, rays: int) -> SceneImages:
    """Render heights and masks of a scene.

    Args:
        scene: The scene.
        size: Height and width of the images [pixels].
        rays: Rays to a pixel along either axis, of which a pixel is the mean.

    Returns:
        The images.
    """
    depth = render_depth(scene, rays * size, rays * size)
    return depth_images(scene, depth, size)


def depth_images(scene: Scene, image: DepthImage, size: int) -> SceneImages:
    """Turn a depth image, rendered or taken by a real camera, into heights and masks.

    The network knows one camera, `dvr_jax.scene.pinhole.SCENE_CAMERA`, and the arms at their home postures.

    Args:
        scene: The scene that the image shows.
        image: Depth [m] along the camera's optical axis and masks, all of H x H pixels, H a multiple of `size`. A
            pixel whose depth is not finite counts as empty table. The goal's mask covers the whole region, also where
            something stands on it.
        size: Height and width of the network's images [pixels].

    Returns:
        The images.

    Raises:
        DvrError: The shapes do not fit the scene or the size, or the depth is not in meters.
    """
    pixels = len(image.depth)
    _check_shapes(scene, image, size)
    empty = empty_depth(scene.workcell, pixels, pixels)
    _check_unit(image, empty)

    height = (empty - image.depth) / UNIT_HEIGHT
    height = np.nan_to_num(height, nan=0, posinf=0, neginf=0)
    height = np.clip(height, -LARGEST_HEIGHT, LARGEST_HEIGHT)

    zeros = np.zeros((1, pixels, pixels), bool)
    masks = np.concatenate([image.object_masks, image.goal_mask[None], zeros])
    covered = np.rint(WHOLE_PIXEL * _block_means(masks, size))
    return SceneImages(_block_means(height, size), covered.astype(np.uint8))


def _check_unit(image: DepthImage, empty: Float[np.ndarray, "pixels pixels"]) -> None:
    """Refuse a depth image whose usual depth is not near that of the empty table, as one in millimeters."""
    depth = np.asarray(image.depth, dtype=np.float64)
    usual = float(np.median(depth[np.isfinite(depth)])) if np.isfinite(depth).any() else math.nan
    expected = float(np.median(empty))

    if math.isfinite(usual) and not expected / MOST_OFF <= usual <= expected * MOST_OFF:
        raise DvrError(
            f"the depth image has a median of {usual:g}; valid are meters, of which the empty table has {expected:.2f}."
        )


def _check_shapes(scene: Scene, image: DepthImage, size: int) -> None:
    """Refuse a depth image whose shapes do not fit the scene or the network's size."""
    pixels = len(image.depth)
    shapes = (image.depth.shape, image.object_masks.shape, image.goal_mask.shape)
    valid = (
        (pixels, pixels),
        (len(scene.objects), pixels, pixels),
        (pixels, pixels),
    )
    if shapes != valid:
        raise DvrError(
            f"depth, objects' masks and goal's mask have the shapes {shapes}; valid are {valid}."
        )
    if pixels == 0 or pixels % size:
        raise DvrError(
            f"the images have {pixels} x {pixels} pixels; valid is a multiple of the network's {size}."
        )


def _block_means(
    images: Shaped[np.ndarray, "*images fine fine"],
    size: int,
) -> Float[np.ndarray, "*images size size"]:
    """Reduce images to `size` x `size` pixels, each the mean of a square block."""
    block = images.shape[-1] // size
    # A sum of slices is faster than a mean over axes of a few elements.
    rows = [images[..., i::block, :] for i in range(block)]
    row_sums = np.asarray(np.sum(rows, axis=0, dtype=np.float32))
    columns = [row_sums[..., i::block] for i in range(block)]
    sums = np.sum(columns, axis=0)
    return np.asarray(sums / np.float32(block**2))


def stack_images(images: Sequence[SceneImages], most_objects: int) -> ImageStack:
    """Put the images of several scenes into one table.

    Args:
        images: The images of each scene, all of the same size.
        most_objects: Largest number of objects that a scene may have.

    Returns:
        The table, with `most_objects` + 2 masks a scene.
    """
    size = images[0].height.shape[0]
    height = np.stack([item.height for item in images])
    masks = np.zeros((len(images), most_objects + 2, size, size), np.uint8)
    for scene_masks, item in zip(masks, images, strict=True):
        scene_masks[: len(item.masks)] = item.masks
    return ImageStack(height, masks)


def view_channels(
    height: Float[Array, "scenes pixels pixels"],
    masks: UInt8[Array, "scenes masks pixels pixels"],
    scene: Int[Array, " views"],
    mirrored: Bool[Array, "views 2"],
) -> tuple[Float[Array, "views pixels pixels"], Float[Array, "views masks pixels pixels"]]:
    """Return the channels of views of scenes, as an action-object image has them, on the device.

    Args:
        height: Heights of each scene.
        masks: Masks of each scene.
        scene: The scene that each view shows.
        mirrored: Whether the view reverses the scene's x and its y.

    Returns:
        Heights and masks of each view, scaled by `BRIGHTNESS`.
    """

    def mirror(images: Shaped[Array, "views ..."]) -> Float[Array, "views ..."]:
        in_x, in_y = jnp.expand_dims(mirrored.T, tuple(range(2, images.ndim + 1)))
        images = jnp.where(in_x, images[..., ::-1], images)
        images = jnp.where(in_y, images[..., ::-1, :], images)
        return BRIGHTNESS * images.astype(jnp.float32)

    return mirror(height[scene]), mirror(masks[scene]) / WHOLE_PIXEL
