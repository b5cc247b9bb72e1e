"""The film strip of a plan: one picture of the start and one of each mode switch, with the action in words."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from dvr_jax.drawing.lettering import BAND, GAP, PAPER, SOFT_INK, Line, write_line
from dvr_jax.drawing.picture import render_states
from dvr_jax.errors import DvrError
from dvr_jax.goals import OnRegion
from dvr_jax.motion.motion import Motion
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.colors import SPELLINGS, object_color_names, region_color_names
from dvr_jax.scene.mjcf import build_model
from dvr_jax.scene.types import Scene

PANEL_WIDTH = 440
"""Width of one picture [pixels]."""

PANEL_HEIGHT = 275
"""Height of one picture [pixels]."""

TITLE_HEIGHT = 44
"""Height of the title above all pictures [pixels]."""

CAPTION_HEIGHT = 34
"""Height of the caption below each picture [pixels]."""

MOST_COLUMNS = 4
"""Pictures in a row."""


def save_film(
    path: str | Path,
    scene: Scene,
    action_descriptions: Sequence[str],
    motion: Motion,
) -> None:
    """Write the initial state and the state at each mode switch as one PNG, whole or not at all.

    Args:
        path: File to write.
        scene: The scene.
        action_descriptions: Each action in words, as `Plan.action_descriptions` has them.
        motion: The motion that carries out the actions.

    Raises:
        DvrError: The motion has more or fewer switches than there are actions.
        OSError: The file cannot be written.
    """
    write_whole(Path(path), encode_film(scene, action_descriptions, motion))


def encode_film(scene: Scene, action_descriptions: Sequence[str], motion: Motion) -> bytes:
    """Return the content of the PNG that `save_film` writes.

    Args:
        scene: The scene.
        action_descriptions: Each action in words, as `Plan.action_descriptions` has them.
        motion: The motion that carries out the actions.

    Raises:
        DvrError: The motion has more or fewer switches than there are actions.
    """
    if len(action_descriptions) != len(motion.switch):
        raise DvrError(
            f"the motion has {len(motion.switch)} switches; valid are {len(action_descriptions)}, one for each action."
        )

    captions = [
        "start",
        *(f"{number}  {words}" for number, words in enumerate(action_descriptions, start=1)),
    ]
    states = motion.qpos[[0, *motion.switch.tolist()]]
    pictures = render_states(build_model(scene), states, PANEL_WIDTH, PANEL_HEIGHT)

    columns = _columns(len(pictures))
    rows = math.ceil(len(pictures) / columns)
    width = GAP + columns * (PANEL_WIDTH + GAP)
    height = GAP + TITLE_HEIGHT + rows * (PANEL_HEIGHT + CAPTION_HEIGHT + GAP)
    film = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(film)
    _write_title(draw, scene, width)

    for index, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        left = GAP + index % columns * (PANEL_WIDTH + GAP)
        top = GAP + TITLE_HEIGHT + index // columns * (PANEL_HEIGHT + CAPTION_HEIGHT + GAP)
        film.paste(Image.fromarray(picture), (left, top))
        _write_caption(draw, left, top + PANEL_HEIGHT, caption)

    content = io.BytesIO()
    film.save(content, "PNG", optimize=True)
    return content.getvalue()


def _write_title(draw: ImageDraw.ImageDraw, scene: Scene, width: int) -> None:
    """The goal, and beside it the color of each region and of each object whose name is not its color."""
    middle = GAP + TITLE_HEIGHT // 2 - 4
    room = width - 2 * GAP
    end = write_line(draw, (GAP, middle), Line(f"goal: {scene.goal.sentence()}", 25, room))

    pairs = [*zip(scene.object_names, object_color_names(scene), strict=True)]
    if not isinstance(scene.goal, OnRegion):
        pairs = [*zip(scene.region_names, region_color_names(scene), strict=True), *pairs]
    legend = ", ".join(
        f"{name} is {color}" for name, color in pairs if SPELLINGS.get(name, name) != color
    )
    write_line(draw, (GAP + end + 24, middle), Line(legend, 18, room - end - 24, SOFT_INK))


def _write_caption(draw: ImageDraw.ImageDraw, left: int, top: int, caption: str) -> None:
    bottom = top + CAPTION_HEIGHT - 1
    draw.rectangle((left, top, left + PANEL_WIDTH - 1, bottom), fill=BAND)
    write_line(
        draw,
        (left + 10, top + CAPTION_HEIGHT // 2),
        Line(caption, 18, PANEL_WIDTH - 20),
    )


def _columns(panels: int) -> int:
    """Panels in a row: as few rows as possible, and then as few empty places."""
    return math.ceil(panels / math.ceil(panels / MOST_COLUMNS))
