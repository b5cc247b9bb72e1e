"""Executables that are loaded by another thread while a process still imports its modules.

A command knows from its last run which programs it is going to need. Loading the twenty programs of a plan takes more
than a second, as long as importing the package does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Thread
from typing import Any

_loading: dict[Path, Future[Any]] = {}
"""Executables that are being loaded or are loaded, by file; each can be taken once."""


def load_in_background(
    paths: Sequence[Path], load: Callable[[Path], Callable[..., Any] | None]
) -> None:
    """Begin to load executables, one after the other.

    Args:
        paths: Their files, in the order in which they will be needed.
        load: Function that loads one of them.
    """
    futures: dict[Path, Future[Any]] = {path: Future() for path in paths}
    _loading.update(futures)

    def work() -> None:
        """Load one executable after the other; what has been taken back meanwhile is left out."""
        for path, future in futures.items():
            if future.set_running_or_notify_cancel():
                future.set_result(load(path))

    Thread(target=work, daemon=True).start()


def take_loaded(path: Path) -> Callable[..., Any] | None:
    """Return an executable that is loaded or being loaded.

    Args:
        path: Its file.

    Returns:
        The executable; None if it was not asked for, its turn has not come yet, or its file is of no use.
    """
    future = _loading.pop(path, None)
    if future is None or future.cancel():
        return None
    executable: Callable[..., Any] | None = future.result()
    return executable
