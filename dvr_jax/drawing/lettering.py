"""Text in pictures, and the colors of paper and ink. Lettered with Pillow and its own font."""

import math
from dataclasses import dataclass

from PIL import ImageDraw, ImageFont

Ink = tuple[int, ...]
"""RGB, each from 0 to 255."""

PAPER: Ink = (255, 255, 255)
"""Color of the background."""

INK: Ink = (28, 30, 34)
"""Color of text."""

SOFT_INK: Ink = (105, 110, 118)
"""Color of text beside the matter."""

BAND: Ink = (240, 241, 243)
"""Color behind a caption."""

GAP = 12
"""Distance between panels and along the borders [pixels]."""

SMALLEST_FONT = 12
"""Text that does not fit is made smaller down to this size [pixels], and then shortened."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of text."""

    text: str
    """What is written; characters that cannot be printed become question marks."""

    size: int
    """Font size [pixels]."""

    width: int
    """Room for the line [pixels]."""

    ink: Ink = INK
    """Color of the text."""


def write_line(draw: ImageDraw.ImageDraw, middle_left: tuple[int, int], line: Line) -> int:
    """Write a line of text, smaller or shortened where it would not fit.

    Args:
        draw: The picture to write on.
        middle_left: Left end of the line, at half its height [pixels].
        line: The line.

    Returns:
        Width of what was written [pixels].
    """
    # No letter is narrower than half a pixel, so what lies behind can never be seen, and is not measured.
    seen = line.text[: 2 * max(line.width, 0) + 1]
    text = "".join(letter if letter.isprintable() else "?" for letter in seen)
    size = line.size
    font = ImageFont.load_default(size)
    while size > SMALLEST_FONT and draw.textlength(text, font=font) > line.width:
        size -= 1
        font = ImageFont.load_default(size)

    shown = text
    if draw.textlength(shown, font=font) > line.width:
        shown = _shorten(draw, text, font, line.width)

    if not shown:
        return 0

    draw.text(middle_left, shown, fill=line.ink, font=font, anchor="lm")

    return math.ceil(draw.textlength(shown, font=font))


def _shorten(
    draw: ImageDraw.ImageDraw,
    text: str,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    width: int,
) -> str:
    """Return the longest beginning of a text that fits with three dots behind it; nothing if none does.

    Halving the interval in which its length lies measures a text some ten times, and not once for each letter.
    """
    fits, too_long = 0, len(text)
    while too_long - fits > 1:
        middle = (fits + too_long) // 2
        if draw.textlength(text[:middle].rstrip() + "...", font=font) <= width:
            fits = middle
        else:
            too_long = middle

    return text[:fits].rstrip() + "..." if fits else ""
