"""Worker processes, each on a core of its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import cycle
from multiprocessing.queues import SimpleQueue
from types import TracebackType


class WorkerPool(ProcessPoolExecutor):
    """A pool that ends at once, with all that it has begun, where its block ends with an error or is interrupted."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> bool | None:
        """Wait for what is left to do, or end it."""
        if kind is not None:
            self.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
        return super().__exit__(kind, error, at)


def worker_processes(workers: int, prepare: Callable[..., object] | None = None, *arguments: object) -> WorkerPool:
    """A pool of processes, each of which calls ``prepare(*arguments)`` first.

    A process keeps to one core, in turn. With more of them XLA's threads pass the small kernels of a solver to and fro,
    which takes a third more of CPU time than one thread does."""
    # Forked processes would share the parent's XLA threads, which do not survive a fork.
    context = multiprocessing.get_context("spawn")
    cores: SimpleQueue[int] = context.SimpleQueue()
    if hasattr(os, "sched_getaffinity"):
        for core, _ in zip(cycle(os.sched_getaffinity(0)), range(workers), strict=False):
            cores.put(core)
    return WorkerPool(workers, context, _get_ready, (os.getpid(), cores, prepare, arguments))


def _get_ready(
    parent: int, cores: SimpleQueue[int], prepare: Callable[..., object] | None, arguments: tuple[object, ...]
) -> None:
    # Ctrl-C goes to all processes of a terminal; it is the parent that ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if not cores.empty():
        os.sched_setaffinity(0, {cores.get()})
    if prepare is not None:
        prepare(*arguments)


def _end_with(parent: int) -> None:
    """End this process once its parent is gone: a killed one cannot say so."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)
