"""A lock that one process of the machine holds at a time, so that processes that need the same thing make it once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def only_process(path: Path) -> Iterator[None]:
    """Wait until no other process is in the block with this file, and keep others out while the block runs.

    The operating system frees the lock when its process ends, however it ends. Where files cannot be locked (on
    Windows, or in a folder that cannot be written to), nobody waits: two processes do the same work, which is no error.

    Args:
        path: File of the lock, in a folder that exists. It is made, and removed at the end. A process that arrives in
            this moment may have to do without the lock, so what the block makes has to be written in one step.
    """
    try:
        import fcntl

        file = path.open("wb")
    except (ImportError, OSError):
        yield
        return

    with file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            with suppress(OSError):
                path.unlink()
