"""The errors of the package, and how a command line ends: a message, an exit code, no traceback.

Every error that a caller can cause is a `DvrError`. Its subclasses say which kind of input was refused. The message is
one sentence that names the culprit, its value and what would be valid.

Exit codes of the command lines: 0 and 1 belong to the command itself, 2 is bad input (a file, an option or a value),
130 is an interruption by the user.
"""

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

EXIT_BAD_INPUT = 2
"""Exit code for input that was refused."""

EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""


LONGEST_MESSAGE = 1_000
"""Characters of the longest message, which is less than a screen."""


class DvrError(Exception):
    """Base class of all errors that bad input causes; raised where the input enters the package.

    A message may quote what was read, so it is made fit for a screen: see `fit_for_screen`.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(fit_for_screen(str(message)))


class SceneError(DvrError):
    """Raised for a scene, a scene file or a distribution of scenes that breaks a rule."""


class NetworkError(DvrError):
    """Raised for a network file, or for images or states that do not fit the network or the scene."""


class MotionError(DvrError):
    """Raised for a motion, or a motion file, that is broken or does not fit its scene or its actions."""


class DataError(DvrError):
    """Raised for label files or training data that are broken or contradict each other."""


class OptionError(DvrError):
    """Raised for an argument of the public functions, or an option of a command, of a wrong type or value."""


def fit_for_screen(message: str) -> str:
    """Return a message on one line, without characters that cannot be printed, and without the middle of a long one."""
    line = "".join(map(_printable, message))
    if len(line) <= LONGEST_MESSAGE:
        return line

    half = LONGEST_MESSAGE // 2 - 3
    return f"{line[:half]} ... {line[-half:]}"


def _printable(character: str) -> str:
    """Return a character that can be printed, or its number, as in "\\x1b"."""
    if character.isprintable():
        return character
    if character == "\n":
        return " "
    return character.encode("unicode_escape").decode("ascii")


def describe_os_error(error: OSError) -> str:
    """Describe a file that is missing, unreadable or unwritable in one sentence that names it where possible."""
    reason = error.strerror or str(error) or type(error).__name__
    if not isinstance(error.filename, (str, bytes, os.PathLike)):
        return f"the operating system refused: {reason}."
    return f"cannot use the file {os.fspath(error.filename)!r}: {reason}."


def run_command(main: Callable[[], int | None], at_once: bool = False) -> NoReturn:
    """Run a command line's `main` and end the process with its exit code.

    A `DvrError` or a file's `OSError` becomes one line on standard error and exit code 2; Ctrl-C becomes 130.
    Any other exception is a defect of this package and keeps its traceback.

    Args:
        main: Function that carries out the command and returns its exit code; None counts as 0.
        at_once: Whether the process ends without waiting for its other threads and without any cleanup.

    Raises:
        SystemExit: Always, unless `at_once` is set, in which case the process ends here.
    """
    exit_code = _run(main)

    if at_once:
        # The flush may meet a full disk or a closed pipe; the exit code is already decided.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, AttributeError):
                stream.flush()
        os._exit(exit_code)

    sys.exit(exit_code)


def _run(main: Callable[[], int | None]) -> int:
    """Run a command and return its exit code; print what went wrong to standard error."""
    try:
        exit_code = main()
        # A process without standard output has none of its streams.
        if sys.stdout is not None:
            sys.stdout.flush()
    except DvrError as error:
        return _refuse(str(error))
    except BrokenPipeError:
        # The reader of the output has gone (`... | head`), which is not bad input. Python flushes standard output
        # once more at exit, so it needs a place to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _refuse(describe_os_error(error))
    except MemoryError:
        return _refuse("the memory of this machine does not suffice.")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED

    return exit_code or 0


def _refuse(sentence: str) -> int:
    """Print why the input was refused, and return the exit code."""
    print(f"error: {fit_for_screen(sentence)}", file=sys.stderr)
    return EXIT_BAD_INPUT
