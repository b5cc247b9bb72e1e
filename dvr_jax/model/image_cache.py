"""Images of many scenes in a file, so that a run that is continued does not render them again."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dvr_jax.model.images import (
    LARGEST_HEIGHT,
    UNIT_HEIGHT,
    WHOLE_PIXEL,
    ImageStack,
    scene_images,
    stack_images,
)
from dvr_jax.runtime.archives import read_arrays
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import Scene

_UNITS = (UNIT_HEIGHT, LARGEST_HEIGHT, WHOLE_PIXEL)
"""What the numbers of rendered images mean."""


def cached_images(
    scenes: Sequence[Scene],
    size: int,
    rays: int,
    cache: Path,
    say: Callable[[str], None],
) -> ImageStack:
    """Read the images of scenes from a file, or render them and write the file.

    Args:
        scenes: The scenes.
        size: Height and width of the images [pixels].
        rays: Rays to a pixel along either axis.
        cache: The file. It is replaced if it is missing or holds other images.
        say: Takes a line for the user.

    Returns:
        The images, in the order of the scenes.
    """
    content = repr((tuple(scenes), (size, rays), SCENE_CAMERA, _UNITS))
    key = hashlib.sha256(content.encode()).hexdigest()
    images = _read(cache, key)
    if images is None:
        say(f"rendering {len(scenes)} scenes")
        most_objects = max(len(scene.objects) for scene in scenes)
        rendered = [scene_images(scene, size, rays) for scene in scenes]
        images = stack_images(rendered, most_objects)
        _write(cache, key, images)
    return images


def _read(cache: Path, key: str) -> ImageStack | None:
    """Return the images of a file, or None if there is no file or it has another key."""
    try:
        arrays = read_arrays(cache)
        if str(arrays["key"]) != key:
            return None
        return ImageStack(arrays["height"], arrays["masks"])
    except (OSError, ValueError, KeyError):
        # Missing or damaged: the images are rendered again.
        return None


def _write(cache: Path, key: str, images: ImageStack) -> None:
    """Write images to a file under a key."""
    cache.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez_compressed(
        content,
        key=np.array(key),
        height=images.height,
        masks=images.masks,
    )
    write_whole(cache, content.getvalue())
