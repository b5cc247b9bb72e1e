"""The one base error of the package, and how a command line ends: message, exit code, no traceback.

A message is one sentence that names the culprit, its value and what would be valid.
Exit codes: 0 to 1 are the command's own, 2 bad input (file, option, value), 130 interrupted by the user.
"""

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


class DvrError(Exception):
    """Bad input, refused at the edge: one sentence with the culprit, its value and what would be valid."""


class SceneError(DvrError):
    """A scene that cannot be: its file, its objects, its goal or its workcell."""


def describe_os_error(error: OSError) -> str:
    """One sentence for a file that is missing, unreadable or unwritable, naming the file where it is known."""
    reason = error.strerror or str(error) or type(error).__name__
    if error.filename is None:
        return f"the operating system refused: {reason}."
    return f"cannot use the file {os.fspath(error.filename)!r}: {reason}."


def run_command(main: Callable[[], int | None], at_once: bool = False) -> NoReturn:
    """Run a command line's `main` and end the process with its exit code (None counts as 0).

    A `DvrError` or a file's `OSError` becomes one line on stderr and exit code 2; Ctrl-C becomes 130.
    Any other exception is a defect of this package and keeps its traceback.

    Args:
        main: what the command does.
        at_once: then wait for no thread and tidy up nothing.
    """
    code = _run(main)
    if at_once:
        with suppress(OSError):  # what was printed before an error or Ctrl-C
            sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _run(main: Callable[[], int | None]) -> int:
    """Exit code of a command."""
    try:
        code = main()
        sys.stdout.flush()
    except DvrError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except BrokenPipeError:  # the reader of our output has gone (`... | head`): that is not bad input
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"error: {describe_os_error(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    return code or 0
