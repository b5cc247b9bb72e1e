"""Ctrl-C ends a command at once, at whatever it is: one line on standard error, exit code 130. SIGTERM does so too.

An exception such as Python's `KeyboardInterrupt` will not do: callbacks of JAX and imports swallow it or turn it into
another one, and it waits for the end of what runs outside of Python, such as a compilation. So a thread waits for the
signal, and ends the process itself. That loses nothing, because every file is written whole or not at all.

This module is imported before all others of a command, so it imports only what takes no time.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

MESSAGES = {signal.SIGINT: b"interrupted\n", signal.SIGTERM: b"terminated\n"}
"""Signals that end a command, and all that is said about each."""

EXIT_OF_SIGNAL = 128
"""Exit code after a signal, as shells have it, is this and the number of the signal: 130 after Ctrl-C."""

WORKERS_TIME = 1.0
"""Time that worker processes have to remove what they are writing [s]."""

PATIENCE = 5.0
"""Longest time that removing files and ending worker processes may take [s]."""

_undoing: list[bytes] = []
"""What has to be written to standard error before the message."""

_temporary_files: set[str] = set()
"""Files that are being written and have no value before they are renamed."""


def end_on_interrupt() -> None:
    """End this process from now on when it is interrupted or terminated; called once, by the main thread of a command.

    A process that was started to ignore interruptions, as shells start jobs in the background, goes on ignoring them.
    """
    taken = [number for number in MESSAGES if signal.getsignal(number) is not signal.SIG_IGN]

    # Until the thread runs, the main thread handles the signals itself.
    for number in taken:
        signal.signal(number, _end)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    threading.Thread(target=_wait_and_end, args=(reader,), daemon=True).start()

    # The interpreter writes the number of a signal into the pipe the moment that it comes. A signal that comes between
    # these lines is handled by the main thread alone, later: two would both say that they end.
    for number in taken:
        signal.signal(number, _leave_to_the_thread)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)


def ignore_interrupts() -> None:
    """Ignore these signals from now on: the command has done its work, and its exit code is decided."""
    for number in MESSAGES:
        if signal.getsignal(number) in (_end, _leave_to_the_thread):
            signal.signal(number, signal.SIG_IGN)


def end_worker_on_termination() -> None:
    """Let this process, a worker, end without a word when it is terminated, and ignore interruptions, its parent's."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end_worker)


@contextmanager
def undone_at_interrupt(text: bytes) -> Iterator[None]:
    """Write a text to standard error where a signal ends the process while the block runs.

    Args:
        text: What brings the terminal back into its usual state.
    """
    _undoing.append(text)
    try:
        yield
    finally:
        _undoing.remove(text)


def remember_temporary(path: str) -> None:
    """Remember a file that an interruption shall remove."""
    _temporary_files.add(path)


def forget_temporary(path: str) -> None:
    """Forget a file that has been renamed or removed."""
    _temporary_files.discard(path)


def remove_temporaries() -> None:
    """Remove the files that are being written."""
    for path in list(_temporary_files):
        with suppress(OSError):
            os.unlink(path)


def _wait_and_end(reader: int) -> None:
    """Read the numbers of signals from a pipe, and end the process at the first one that shall end it."""
    while True:
        for number in os.read(reader, 64):
            if number in MESSAGES:
                _end(number)


def _leave_to_the_thread(number: int, _: Any) -> None:
    """Handle a signal in the main thread: stand still, so that nothing is printed while the process ends."""
    time.sleep(PATIENCE)
    _say_and_exit(number)


def _end(number: int, _: Any = None) -> NoReturn:
    """Remove what is half done, and end this process."""
    with suppress(Exception):
        end_workers()
    remove_temporaries()
    _say_and_exit(number)


def _end_worker(number: int, _: Any) -> NoReturn:
    """Remove what is half done, and end this worker process without a word."""
    remove_temporaries()
    os._exit(EXIT_OF_SIGNAL + number)


def _say_and_exit(number: int) -> NoReturn:
    """Write the message of a signal, and end this process without any cleanup."""
    with suppress(OSError):
        os.write(2, b"".join(_undoing) + MESSAGES[signal.Signals(number)])
    os._exit(EXIT_OF_SIGNAL + number)


def end_workers() -> None:
    """End the worker processes, and give their semaphores back, which the standard library would else complain of."""
    multiprocessing = sys.modules.get("multiprocessing")
    util = sys.modules.get("multiprocessing.util")
    if multiprocessing is None or util is None:
        return

    # A worker removes what it is writing before it ends; one that is busy outside of Python is not waited for.
    children = multiprocessing.active_children()
    for child in children:
        child.terminate()
    deadline = time.monotonic() + WORKERS_TIME
    for child in children:
        child.join(max(0.0, deadline - time.monotonic()))
        child.kill()
    # What the interpreter calls at its own end; it has no public name.
    util._run_finalizers(0)
