"""BLAS and LAPACK on one thread while the solver runs, so that results do not depend on the number of cores."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from threading import Lock
from typing import Any

# On a CPU, XLA's calls to LAPACK go to SciPy's library. It is imported here so that threadpoolctl finds it loaded.
import scipy.linalg.cython_lapack  # noqa: F401
from threadpoolctl import OpenBLASController, ThreadpoolController


class _Limit:
    """The limit that all open blocks of the process share, and the number of these blocks."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.open_blocks = 0
        self.active: Any = None
        """What threadpoolctl's `limit` returned for the first open block."""

    def enter(self) -> None:
        """Open a block; the first one sets the limit."""
        with self.lock:
            if self.open_blocks == 0:
                _release_control()
                self.active = _controller().limit(limits=1, user_api="blas")
            self.open_blocks += 1

    def leave(self) -> None:
        """Close a block; the last one restores the number of threads from before the first one."""
        with self.lock:
            self.open_blocks -= 1
            if self.open_blocks == 0:
                _release_control()
                self.active.restore_original_limits()
                _release_control()


_LIMIT = _Limit()


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    """Return the controller of the libraries that are loaded; finding them takes milliseconds."""
    return ThreadpoolController()


@contextmanager
def linear_algebra_on_one_thread() -> Iterator[None]:
    """Keep BLAS and LAPACK on the thread that calls them, in the whole process, while the block runs.

    This covers the libraries that threadpoolctl knows: OpenBLAS and MKL, which SciPy's packages bring along, but not
    Apple's Accelerate. A library that divides the factorization of 28 x 28 matrices among threads takes a third longer
    for it, and its rounding depends on the number of cores; then the solver's result would depend on the machine.

    Blocks may overlap, also in several threads. The last block to end restores the number of threads.
    """
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()


def _release_control() -> None:
    """Let whichever thread sets OpenBLAS's limit next be obeyed.

    The limit belongs to the whole process. For threadpoolctl it belongs to the first thread that ever set it, as long
    as that thread lives; requests of other threads are silently ignored.
    """
    OpenBLASController.clear_controlling_thread(force=True)
