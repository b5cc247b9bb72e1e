"""A picture of what the network sees of a scene: the depth image with its scale, and all masks."""

import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw

from dvr_jax.drawing.lettering import GAP, INK, PAPER, Ink, Line, write_line
from dvr_jax.goals import OnRegion
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.camera import FARTHEST_DEPTH, DepthImage, render_depth
from dvr_jax.scene.colors import GOAL_COLOR, object_colors
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import Scene

DEPTH_PIXELS = 256
"""Rays along either axis: the shipped networks see means of 4 x 4 of them."""

TILE = 2
"""Pixels of the picture for each ray, along either axis."""

HEAD_HEIGHT = 40
"""Height of the text above each image [pixels]."""

BAR_WIDTH = 18
"""Width of the bar that shows the scale [pixels]."""

SCALE_WIDTH = 70
"""Width of the numbers beside the bar [pixels]."""

DEPTH_COLORS = np.array(
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
"""Near to far, in even steps of viridis (S. van der Walt, N. Smith): lightness falls evenly, so that color-blind
readers can tell them apart too."""

NOTHING_COLOR: Ink = (214, 216, 220)
"""Color of a pixel of the depth image whose ray meets nothing."""

UNMASKED_COLOR: Ink = (40, 42, 48)
"""Color of a pixel outside a mask."""

ROOM_ABOVE = 0.05
"""The scale begins this much above the highest object or fixed body [m]."""

LARGEST_HEIGHT = 0.5
"""The scale begins no higher above the table than this [m]; a tall wall would take the colors from the objects."""

TICK_STEPS = (0.05, 0.1, 0.2, 0.5, 1.0)
"""Distances between the marks of the scale; the first one that gives no more than `MOST_TICKS` is taken [m]."""

MOST_TICKS = 6
"""Most marks of the scale."""


@dataclass(frozen=True, slots=True)
class _Scale:
    """Depths that the colors are spread over. The arms reach far above it, and all above has the first color."""

    nearest: float
    farthest: float

    def fraction(self, depth: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """0 at the near end and 1 at the far end."""
        return np.asarray((depth - self.nearest) / (self.farthest - self.nearest))

    def ticks(self) -> list[float]:
        """Round depths [m], none close to the near end."""
        length = self.farthest - self.nearest
        step = next((step for step in TICK_STEPS if length / step <= MOST_TICKS), TICK_STEPS[-1])
        first = math.ceil(self.nearest / step + 0.4)
        last = math.floor(self.farthest / step + 1e-6)

        return [step * i for i in range(first, last + 1)]


@dataclass(frozen=True, slots=True)
class _Mask:
    """One mask, with its name and color."""

    pixels: Bool[np.ndarray, "height width"]
    name: str
    color: Ink


def save_depth_picture(path: str | Path, scene: Scene) -> None:
    """Write what the camera sees of a scene as a PNG, whole or not at all.

    Args:
        path: File to write.
        scene: The scene.
    """
    write_whole(Path(path), encode_depth_picture(scene))


def encode_depth_picture(scene: Scene) -> bytes:
    """Return the content of the PNG that `save_depth_picture` writes."""
    view = render_depth(scene, DEPTH_PIXELS, DEPTH_PIXELS)
    scale = _scale_of(scene)
    masks = _masks_of(scene, view)

    side = TILE * DEPTH_PIXELS
    small = (side - HEAD_HEIGHT) // 2
    columns = math.ceil(len(masks) / 2)
    first = GAP + side + 8 + BAR_WIDTH + SCALE_WIDTH
    picture = Image.new("RGB", (first + columns * (small + GAP), HEAD_HEIGHT + side + GAP), PAPER)
    draw = ImageDraw.Draw(picture)

    title = f"depth seen from above, {DEPTH_PIXELS} x {DEPTH_PIXELS}"
    write_line(draw, (GAP, HEAD_HEIGHT // 2), Line(title, 18, side))
    picture.paste(_enlarge(_colors_of(view, scale), side, side), (GAP, HEAD_HEIGHT))
    _draw_scale(picture, draw, GAP + side + 8, scale)

    for index, mask in enumerate(masks):
        x = first + index % columns * (small + GAP)
        y = index // columns * (small + HEAD_HEIGHT)
        write_line(draw, (x, y + HEAD_HEIGHT // 2), Line(mask.name, 18, small))
        painted = np.where(mask.pixels[..., None], np.array(mask.color), np.array(UNMASKED_COLOR))
        picture.paste(_enlarge(painted.astype(np.uint8), small, small), (x, y + HEAD_HEIGHT))

    content = io.BytesIO()
    picture.save(content, "PNG", optimize=True)
    return content.getvalue()


def _scale_of(scene: Scene) -> _Scale:
    tops = [item.height for item in scene.objects] + [
        min(body.top, LARGEST_HEIGHT) for body in scene.fixed
    ]
    farthest = SCENE_CAMERA.position[2]

    return _Scale(farthest - max(tops) - ROOM_ABOVE, farthest)


def _masks_of(scene: Scene, view: DepthImage) -> list[_Mask]:
    """All masks, the goal's last, in colors that are light enough to be seen on black."""
    masks = []
    for pixels, name, color in zip(
        view.object_masks, scene.object_names, object_colors(scene), strict=True
    ):
        bright = tuple(min(255, round(255 * (0.25 + 0.85 * channel))) for channel in color)
        masks.append(_Mask(pixels, name, bright))

    goal_color = tuple(round(255 * channel) for channel in GOAL_COLOR)

    title = "goal region" if isinstance(scene.goal, OnRegion) else "regions"

    return [*masks, _Mask(view.goal_mask, title, goal_color)]


def _colors_of(view: DepthImage, scale: _Scale) -> UInt8[np.ndarray, "height width 3"]:
    """The depth image in colors."""
    colors = _depth_colors(scale.fraction(view.depth))
    colors[view.depth >= FARTHEST_DEPTH - 1e-6] = NOTHING_COLOR

    return colors


def _draw_scale(picture: Image.Image, draw: ImageDraw.ImageDraw, left: int, scale: _Scale) -> None:
    """The bar of all colors, and its marks."""
    side = TILE * DEPTH_PIXELS
    bar = _depth_colors(np.linspace(0.0, 1.0, side))[:, None]
    picture.paste(_enlarge(bar, BAR_WIDTH, side), (left, HEAD_HEIGHT))

    right = left + BAR_WIDTH
    marks = [(scale.nearest, "< "), *((depth, "") for depth in scale.ticks())]

    for depth, sign in marks:
        y = HEAD_HEIGHT + round(float(scale.fraction(np.array(depth))) * (side - 1))
        draw.line((right, y, right + 5, y), fill=INK)
        write_line(draw, (right + 9, y), Line(f"{sign}{depth:.2f} m", 14, SCALE_WIDTH))


def _depth_colors(
    fractions: Float[np.ndarray, "*pixels"],
) -> UInt8[np.ndarray, "*pixels 3"]:
    """Colors of depths that are given as fractions of the scale."""
    steps = np.linspace(0.0, 1.0, len(DEPTH_COLORS))
    channels = [np.interp(fractions, steps, DEPTH_COLORS[:, channel]) for channel in range(3)]

    return np.asarray(np.stack(channels, axis=-1).round(), dtype=np.uint8)


def _enlarge(colors: UInt8[np.ndarray, "rows columns 3"], width: int, height: int) -> Image.Image:
    """An image in which every pixel is a block."""
    return Image.fromarray(colors).resize((width, height), Image.Resampling.NEAREST)
