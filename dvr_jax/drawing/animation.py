"""The animation of a motion: a GIF that repeats."""

import io
import math
from pathlib import Path

import numpy as np
from PIL import Image

from dvr_jax.drawing.picture import render_states
from dvr_jax.errors import DvrError
from dvr_jax.motion.motion import Motion
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene

MOST_FRAMES = 80
"""An animation has no more frames than this; a longer motion is shown with fewer frames a second."""

LAST_FRAME_SECONDS = 1.5
"""Time for which the last frame stays before the animation starts again [s]."""

SHORTEST_FRAME = 20
"""Shortest time of a frame that programs respect [ms]."""

PALETTE_FRAMES = 5
"""Number of frames that the palette of all frames is chosen from."""


def save_animation(
    path: str | Path,
    scene: Scene,
    motion: Motion,
    frames_per_second: float = 8.0,
    speed: float = 1.0,
    width: int = 320,
    height: int = 200,
) -> None:
    """Write a motion as a GIF that repeats, whole or not at all.

    Args:
        path: File to write.
        scene: The scene.
        motion: Its motion.
        frames_per_second: Frames in each second of the animation, as far as `MOST_FRAMES` allows [1/s].
        speed: How many times as fast as the motion the animation is.
        width: Width of the animation [pixels].
        height: Height of the animation [pixels].

    Raises:
        DvrError: `frames_per_second` or `speed` is no positive number.
        OSError: The file cannot be written.
    """
    write_whole(
        Path(path), encode_animation(scene, motion, frames_per_second, speed, width, height)
    )


def encode_animation(
    scene: Scene,
    motion: Motion,
    frames_per_second: float = 8.0,
    speed: float = 1.0,
    width: int = 320,
    height: int = 200,
) -> bytes:
    """Return the content of the GIF that `save_animation` writes.

    Args:
        scene: The scene.
        motion: Its motion.
        frames_per_second: Frames in each second of the animation, as far as `MOST_FRAMES` allows [1/s].
        speed: How many times as fast as the motion the animation is.
        width: Width of the animation [pixels].
        height: Height of the animation [pixels].

    Raises:
        DvrError: `frames_per_second` or `speed` is no positive number.
    """
    for name, value in (("frames_per_second", frames_per_second), ("speed", speed)):
        if not (math.isfinite(value) and value > 0):
            raise DvrError(f"the animation's {name} is {value}; valid are positive numbers.")

    duration = float(motion.time[-1] - motion.time[0]) / speed
    count = min(MOST_FRAMES, max(2, math.ceil(duration * frames_per_second) + 1))
    samples = np.linspace(0, len(motion.time) - 1, count).round().astype(int)
    states = render_states(build_model(scene), motion.qpos[samples], width, height)
    pictures = [Image.fromarray(state) for state in states]

    palette = _common_palette(pictures)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frame_time = max(SHORTEST_FRAME, round(1000 * duration / (count - 1)))
    times = [frame_time] * (count - 1) + [round(1000 * LAST_FRAME_SECONDS)]
    content = io.BytesIO()
    frames[0].save(
        content,
        "GIF",
        save_all=True,
        append_images=frames[1:],
        duration=times,
        loop=0,
        optimize=True,
        disposal=1,
    )
    return content.getvalue()


def _common_palette(pictures: list[Image.Image]) -> Image.Image:
    """One palette for all frames: what does not move keeps its color, and costs no bytes."""
    number = min(len(pictures), PALETTE_FRAMES)
    indices = np.linspace(0, len(pictures) - 1, number).round().astype(int)
    width, height = pictures[0].size
    sheet = Image.new("RGB", (width, height * number))

    for row, index in enumerate(indices):
        sheet.paste(pictures[index], (0, row * height))

    return sheet.quantize(colors=255, method=Image.Quantize.MAXCOVERAGE)
