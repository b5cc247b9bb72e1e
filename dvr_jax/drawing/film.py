"""Pictures of a plan for people: a strip of its keyframes, an animation, and what the network sees of the scene.

Everything is cast by rays (`dvr_jax.drawing.picture`) and lettered with Pillow: no OpenGL, no fonts but Pillow's own.
"""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dvr_jax.drawing.picture import render_picture
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action, describe
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.camera import FARTHEST_DEPTH, render_depth
from dvr_jax.scene.colours import GOAL_COLOUR, PALETTE, object_colours
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import Scene

PAPER, INK, SOFT_INK, BAND = (255, 255, 255), (28, 30, 34), (105, 110, 118), (240, 241, 243)
"""Colours (RGB, 0 to 255) of the background, of text, of text beside the matter, and of a caption's band."""

GAP = 12
"""Pixels between panels and along the borders."""

PANEL = (440, 275)
"""Width and height of one picture in the strip, pixels."""

MOST_FRAMES = 80
"""An animation has no more frames than this; a longer motion is shown with fewer of them a second."""

LAST_FRAME_SECONDS = 1.5
"""An animation rests on its last frame before it starts again."""

DEPTH_PIXELS = 256
"""Rays along either axis of the depth picture: the shipped networks see means of 4 x 4 of them."""

TILE = 2
"""Pixels of the picture to a ray."""

DEPTH_COLOURS = np.array(
    [
        (253, 231, 37),
        (160, 218, 57),
        (74, 193, 109),
        (31, 161, 135),
        (39, 127, 142),
        (54, 92, 141),
        (70, 50, 127),
        (68, 1, 84),
    ]
)
"""Near to far, even steps of viridis (S. van der Walt, N. Smith): lightness falls evenly, also for the colour-blind."""

NOTHING_COLOUR = (214, 216, 220)
"""Pixels of the depth image whose ray meets nothing."""


def save_film(path: str | Path, scene: Scene, actions: Sequence[Action], motion: Motion) -> None:
    """Write the initial state and the state at each switch, each with its action in words, as one PNG."""
    model = build_model(scene)
    states = motion.qpos[[0, *motion.switch.tolist()]]
    captions = ["start", *(f"{number}  {describe(action)}" for number, action in enumerate(actions, start=1))]
    if len(captions) != len(states):
        raise DvrError(f"the motion has {len(motion.switch)} switches; valid are {len(actions)}, one an action.")
    columns = _columns(len(states))
    rows = math.ceil(len(states) / columns)
    width, height = PANEL
    title, caption = 44, 34
    size = (GAP + columns * (width + GAP), GAP + title + rows * (height + caption + GAP))
    film = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(film)
    middle, room = GAP + title // 2 - 4, size[0] - 2 * GAP
    end = _write(draw, (GAP, middle), f"goal: {scene.goal.object} on the red spot", 25, room)
    _write(draw, (GAP + end + 24, middle), _tell_colours(scene), 18, room - end - 24, SOFT_INK)
    for index, (picture, text) in enumerate(zip(_render(model, states, width, height), captions, strict=True)):
        left = GAP + index % columns * (width + GAP)
        top = GAP + title + index // columns * (height + caption + GAP)
        film.paste(picture, (left, top))
        draw.rectangle((left, top + height, left + width - 1, top + height + caption - 1), fill=BAND)
        _write(draw, (left + 10, top + height + caption // 2), text, 18, width - 20)
    film.save(path, "PNG", optimize=True)


def save_animation(
    path: str | Path,
    scene: Scene,
    motion: Motion,
    frames_per_second: float = 8.0,
    speed: float = 1.0,
    width: int = 320,
    height: int = 200,
) -> None:
    """Write the motion as a GIF that repeats, `speed` times as fast as it is."""
    for name, value in (("frames_per_second", frames_per_second), ("speed", speed)):
        if not (math.isfinite(value) and value > 0):
            raise DvrError(f"the animation's {name} is {value}; valid are positive numbers.")
    duration = float(motion.time[-1] - motion.time[0]) / speed
    count = min(MOST_FRAMES, max(2, math.ceil(duration * frames_per_second) + 1))
    samples = np.linspace(0, len(motion.time) - 1, count).round().astype(int)
    model = build_model(scene)
    pictures = _render(model, motion.qpos[samples], width, height)
    # One palette for all frames, from a few of them: what does not move keeps its colour and costs nothing.
    chosen = [pictures[index] for index in np.linspace(0, count - 1, min(count, 5)).round().astype(int)]
    sheet = Image.new("RGB", (width, height * len(chosen)))
    for index, picture in enumerate(chosen):
        sheet.paste(picture, (0, index * height))
    palette = sheet.quantize(colors=255, method=Image.Quantize.MAXCOVERAGE)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    milliseconds = [max(20, round(1000 * duration / (count - 1)))] * (count - 1) + [round(1000 * LAST_FRAME_SECONDS)]
    frames[0].save(
        path, "GIF", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, optimize=True, disposal=1
    )


def save_depth_picture(path: str | Path, scene: Scene) -> None:
    """Write what the camera sees as a PNG: the depth image with its scale, and the masks beside it."""
    view = render_depth(scene, DEPTH_PIXELS, DEPTH_PIXELS)
    met = view.depth < FARTHEST_DEPTH - 1e-6
    # The arms reach far above the objects: the colours are spent on the objects, all above has the first one.
    farthest = SCENE_CAMERA.position[2]
    nearest = farthest - max(item.height for item in scene.objects) - 0.05
    colours = _depth_colours((view.depth - nearest) / (farthest - nearest))
    colours[~met] = NOTHING_COLOUR
    side = TILE * view.depth.shape[0]
    head, bar, scale = 40, 18, 70

    masks = [*zip(view.object_masks, [item.name for item in scene.objects], _bright(scene), strict=True)]
    masks.append((view.goal_mask, "goal region", tuple(round(255 * c) for c in GOAL_COLOUR)))
    columns = math.ceil(len(masks) / 2)
    small = (side - head) // 2
    first = GAP + side + 8 + bar + scale
    picture = Image.new("RGB", (first + columns * (small + GAP), head + side + GAP), PAPER)
    draw = ImageDraw.Draw(picture)
    pixels = f"{view.depth.shape[1]} x {view.depth.shape[0]}"
    _write(draw, (GAP, head // 2), f"depth seen from above, {pixels}", 18, side)
    picture.paste(_enlarge(colours, side), (GAP, head))
    left = GAP + side + 8
    picture.paste(_enlarge(_depth_colours(np.linspace(0.0, 1.0, side))[:, None], bar, side), (left, head))
    for depth, sign in [(nearest, "< "), *((depth, "") for depth in _ticks(nearest, farthest))]:
        y = head + round((depth - nearest) / (farthest - nearest) * (side - 1))
        draw.line((left + bar, y, left + bar + 5, y), fill=INK)
        _write(draw, (left + bar + 9, y), f"{sign}{depth:.2f} m", 14, scale)
    for index, (mask, name, colour) in enumerate(masks):
        x = first + index % columns * (small + GAP)
        y = index // columns * (small + head)
        _write(draw, (x, y + head // 2), name, 18, small)
        painted = np.where(mask[..., None], np.array(colour), np.array((40, 42, 48))).astype(np.uint8)
        picture.paste(_enlarge(painted, small), (x, y + head))
    picture.save(path, "PNG", optimize=True)


def _render(model: mujoco.MjModel, states: NDArray[np.float64], width: int, height: int) -> list[Image.Image]:
    """The states (n, nq) as pictures."""

    def render(qpos: NDArray[np.float64]) -> Image.Image:
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        return Image.fromarray(render_picture(model, data, width, height))

    # MuJoCo casts rays without holding Python's lock.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(render, states))


def _columns(panels: int) -> int:
    """Panels in a row: at most four, and as few rows and empty places as that allows."""
    return math.ceil(panels / math.ceil(panels / 4))


def _depth_colours(shares: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (..., 3) of depths (...) given as shares of the range, 0 near and 1 far."""
    steps = np.linspace(0.0, 1.0, len(DEPTH_COLOURS))
    channels = [np.interp(shares, steps, DEPTH_COLOURS[:, channel]) for channel in range(3)]
    return np.asarray(np.stack(channels, axis=-1).round(), dtype=np.uint8)


def _ticks(nearest: float, farthest: float) -> list[float]:
    """Round depths (m) in the range, not more than about six, none close to its near end."""
    step = next((step for step in (0.05, 0.1, 0.2, 0.5) if (farthest - nearest) / step <= 6), 1.0)
    return [step * i for i in range(math.ceil(nearest / step + 0.4), math.floor(farthest / step + 1e-6) + 1)]


def _enlarge(colours: NDArray[np.uint8], width: int, height: int | None = None) -> Image.Image:
    """An image (H, W, 3) with every pixel as a block."""
    return Image.fromarray(colours).resize((width, height or width), Image.Resampling.NEAREST)


def _bright(scene: Scene) -> list[tuple[int, ...]]:
    """The objects' colours, light enough to be seen on black."""
    return [tuple(min(255, round(255 * (0.25 + 0.85 * c))) for c in colour) for colour in object_colours(scene)]


def _tell_colours(scene: Scene) -> str:
    """Which colour each object has, unless its name says so."""
    words = {colour: name for name, colour in PALETTE.items()}
    pairs = [(item.name, words[colour]) for item, colour in zip(scene.objects, object_colours(scene), strict=True)]
    return ", ".join(f"{name} is {colour}" for name, colour in pairs if name != colour)


def _write(
    draw: ImageDraw.ImageDraw,
    middle_left: tuple[int, int],
    text: str,
    size: int,
    width: int,
    ink: tuple[int, int, int] = INK,
) -> int:
    """One line of text, centred on a height, smaller or shortened where it would not fit; returns its width, pixels."""
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    font = ImageFont.load_default(size)
    while size > 12 and draw.textlength(text, font=font) > width:
        size -= 1
        font = ImageFont.load_default(size)
    shown = text
    while text and draw.textlength(shown, font=font) > width:
        text = text[:-1]
        shown = text.rstrip() + "..."
    draw.text(middle_left, shown if text else "", fill=ink, font=font, anchor="lm")
    return math.ceil(draw.textlength(shown, font=font)) if text else 0
