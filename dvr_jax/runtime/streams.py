"""Standard output and standard error of a command, which nothing that happens to them can make fail.

A reader that has gone (`... | head`) is no error: what else is written goes nowhere, and the command carries on. A
character that the encoding lacks is written as its number, and so is a control character, with which a name in a file
could command the terminal.
"""

import io
import os
import sys
from contextlib import suppress

STANDARD_OUTPUT = 1
STANDARD_ERROR = 2

_CONTROLS = [
    *range(0x09),
    *range(0x0B, 0x20),
    *range(0x7F, 0xA0),
    *range(0x200E, 0x2010),
    *range(0x2028, 0x202F),
    *range(0x2066, 0x206A),
]
"""Characters that move the cursor, change colors or turn the direction of the text; tab and line feed may stay."""

_ESCAPES = {code: chr(code).encode("unicode_escape").decode("ascii") for code in _CONTROLS}
"""What is written in their place."""


def open_closed_descriptors() -> None:
    """Give each standard descriptor that is closed a place to write to; the next file would else get its number."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def secure_streams() -> None:
    """Replace `sys.stdout` and `sys.stderr` of this process by streams that do not fail."""
    sys.stdout = _stream(STANDARD_OUTPUT, sys.stdout)
    sys.stderr = _stream(STANDARD_ERROR, sys.stderr)


def escape_controls(text: str) -> str:
    """Write each control character of a text as its number, as in "\\x1b"."""
    return text.translate(_ESCAPES)


class _Descriptor(io.FileIO):
    """A descriptor to write to; once that has failed, all else is dropped."""

    failed = False

    def write(self, data: "io.ReadableBuffer") -> int:  # type: ignore[name-defined]
        """Write bytes, or drop them.

        Raises:
            OSError: They cannot be written to standard output, for another reason than that nobody reads it.
        """
        if not self.failed:
            try:
                return super().write(data)
            except BrokenPipeError:
                self.failed = True
            except OSError as error:
                self.failed = True
                if self.fileno() == STANDARD_OUTPUT:
                    error.filename = "standard output"
                    raise

        return memoryview(data).nbytes


class _Stream(io.TextIOWrapper):
    """A text stream that writes control characters as their numbers."""

    def write(self, text: str) -> int:
        """Write a text."""
        return super().write(escape_controls(text))


def _stream(descriptor: int, present: object) -> _Stream:
    """Return a stream on a descriptor, with the encoding of the present one."""
    with suppress(Exception):
        present.flush()  # type: ignore[attr-defined]

    is_error = descriptor == STANDARD_ERROR
    return _Stream(
        io.BufferedWriter(_Descriptor(descriptor, "wb", closefd=False)),
        encoding=getattr(present, "encoding", None) or "utf-8",
        errors="backslashreplace",
        line_buffering=is_error or os.isatty(descriptor),
    )
