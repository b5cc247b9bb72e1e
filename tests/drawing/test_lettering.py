"""Text in pictures: as much as fits, in a time that does not grow with the square of its length."""

import time

import pytest
from PIL import Image, ImageDraw, ImageFont

from dvr_jax.drawing.lettering import SMALLEST_FONT, Line, write_line


@pytest.fixture
def draw() -> ImageDraw.ImageDraw:
    return ImageDraw.Draw(Image.new("RGB", (500, 40)))


def written(draw: ImageDraw.ImageDraw, line: Line, monkeypatch: pytest.MonkeyPatch) -> str:
    texts: list[str] = []
    monkeypatch.setattr(draw, "text", lambda place, text, **_: texts.append(text))
    write_line(draw, (0, 20), line)
    (text,) = texts
    return text


@pytest.mark.parametrize("text", ["W" * 300, "i" * 300, "grasp the yellow box " * 20])
def test_the_longest_beginning_that_fits(
    text: str, draw: ImageDraw.ImageDraw, monkeypatch: pytest.MonkeyPatch
) -> None:
    font = ImageFont.load_default(SMALLEST_FONT)
    shown = written(draw, Line(text, 18, 200), monkeypatch)
    assert shown.endswith("...")
    length = len(shown.removesuffix("..."))
    longest = max(
        n for n in range(300) if draw.textlength(text[:n].rstrip() + "...", font=font) <= 200
    )
    assert text[:length].rstrip() == text[:longest].rstrip()


def test_a_text_that_fits_is_whole(
    draw: ImageDraw.ImageDraw, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert written(draw, Line("left places yellow", 18, 300), monkeypatch) == "left places yellow"


@pytest.mark.parametrize("width", [-5, 0, 3])
def test_without_room_nothing_is_written(width: int, draw: ImageDraw.ImageDraw) -> None:
    assert write_line(draw, (0, 20), Line("text", 18, width)) == 0


def test_a_million_letters_take_no_time(draw: ImageDraw.ImageDraw) -> None:
    begin = time.monotonic()
    write_line(draw, (0, 20), Line("m" * 1_000_000, 18, 400))
    assert time.monotonic() - begin < 1.0
