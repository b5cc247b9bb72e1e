"""Messages: one line, no character that commands a terminal, never longer than a screen."""

import pytest

from dvr_jax.errors import LONGEST_MESSAGE, DvrError, SceneError, describe_os_error, fit_for_screen


def test_control_characters_are_written_as_numbers() -> None:
    assert str(SceneError("the name is \x1b[31mred\x07\u202e.")) == (
        "the name is \\x1b[31mred\\x07\\u202e."
    )
    assert str(DvrError("two\nlines")) == "two lines"
    assert str(DvrError("Größe \u00b5m")) == "Größe µm"


def test_a_long_message_keeps_its_ends() -> None:
    message = str(DvrError("begin " + "x" * 10_000_000 + " end."))
    assert len(message) <= LONGEST_MESSAGE
    assert message.startswith("begin xxx") and message.endswith("xxx end.") and " ... " in message


@pytest.mark.parametrize("filename", [3, None])
def test_a_descriptor_is_no_file_name(filename: object) -> None:
    error = OSError(28, "No space left on device")
    error.filename = filename
    assert describe_os_error(error) == "the operating system refused: No space left on device."


def test_what_fits_stays() -> None:
    assert fit_for_screen("x" * LONGEST_MESSAGE) == "x" * LONGEST_MESSAGE
