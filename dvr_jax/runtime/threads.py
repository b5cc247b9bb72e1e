"""Linear algebra on one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from threading import Lock
from typing import Any

import scipy.linalg.cython_lapack  # noqa: F401  what XLA's LAPACK calls go to on a CPU: loaded, so that it is found
from threadpoolctl import OpenBLASController, ThreadpoolController

_lock = Lock()
_users = 0
_limit: Any = None


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def linear_algebra_on_one_thread() -> Iterator[None]:
    """Inside, BLAS and LAPACK keep to the thread that calls them, in the whole process, as far as threadpoolctl knows
    the library (OpenBLAS and MKL, which SciPy's packages come with; Apple's Accelerate it does not).

    A library that shares the factorisation of 28 x 28 matrices among threads takes a third longer for it, and rounds by
    how many cores there are: the solver's result would depend on the machine. Blocks may overlap, also in several
    threads; the last one to end restores what was."""
    global _users, _limit
    with _lock:
        if _users == 0:
            _free_control()
            _limit = _controller().limit(limits=1, user_api="blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                _free_control()
                _limit.restore_original_limits()
                _free_control()


def _free_control() -> None:
    """Let the next thread that sets OpenBLAS's limit be heard, whichever it is.

    The limit is the whole process's. To threadpoolctl it belongs to the first thread that ever set it, as long as that
    lives; all others it ignores without a word."""
    OpenBLASController.clear_controlling_thread(force=True)
