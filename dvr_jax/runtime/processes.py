"""Worker processes: each keeps to a core of its own and ends with the process that started it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from itertools import cycle
from multiprocessing.queues import SimpleQueue
from types import TracebackType
from typing import Any


class WorkerPool(ProcessPoolExecutor):
    """A process pool whose workers are terminated when its `with` block ends with an error or is interrupted."""

    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit a task, for which a process may be started.

        Ctrl-C reaches all processes of a terminal. A new process inherits that this thread does not take it for now,
        and so does not end with a traceback before it comes to ignore it. The other threads of this process take it.

        Args:
            arguments: The function that carries out the task, and its arguments.
            named: Its arguments by name.

        Returns:
            The result that is to come.
        """
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(*arguments, **named)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> bool | None:
        """Wait for the remaining tasks; after an error, cancel them and terminate the workers.

        Args:
            kind: Class of the exception that ended the block; None without one.
            error: The exception itself.
            traceback: Where it was raised.

        Returns:
            Whether the exception is swallowed, which it never is.
        """
        if kind is not None:
            self.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()

        return super().__exit__(kind, error, traceback)


def worker_processes(
    workers: int,
    prepare: Callable[..., object] | None = None,
    *arguments: object,
) -> WorkerPool:
    """Start a pool of processes, each of which calls `prepare(*arguments)` before its first task.

    Each process is bound to one core; the cores are handed out in turn. Unbound, XLA's threads pass the small kernels
    of a solver from core to core, which takes a third more CPU time than one thread does.

    Args:
        workers: Number of processes.
        prepare: Function that each process calls first; it must be importable by name.
        arguments: Arguments of `prepare`.

    Returns:
        The pool, to be used in a `with` block.
    """
    # Forked processes would share the parent's XLA threads, which do not survive a fork.
    context = multiprocessing.get_context("spawn")

    cores: SimpleQueue[int] = context.SimpleQueue()
    if hasattr(os, "sched_getaffinity"):
        for core, _ in zip(cycle(os.sched_getaffinity(0)), range(workers), strict=False):
            cores.put(core)

    initial_arguments = (os.getpid(), cores, prepare, arguments)
    return WorkerPool(workers, context, _start_worker, initial_arguments)


def _start_worker(
    parent: int,
    cores: SimpleQueue[int],
    prepare: Callable[..., object] | None,
    arguments: tuple[object, ...],
) -> None:
    """Prepare this worker of a pool, which takes the next of the cores."""
    prepare_worker(parent, None if cores.empty() else cores.get())

    if prepare is not None:
        prepare(*arguments)


def prepare_worker(parent: int, core: int | None) -> None:
    """Bind this process, a worker, to a core, and tie its life to its parent's.

    Args:
        parent: Process that started the worker.
        core: The core; None where processes cannot be bound.
    """
    # Ctrl-C reaches all processes of a terminal. The parent alone handles it, and ends the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    watch = threading.Thread(target=_end_with_parent, args=(parent,), daemon=True)
    watch.start()

    if core is not None:
        os.sched_setaffinity(0, {core})


def _end_with_parent(parent: int) -> None:
    """End this process once its parent is gone, because a parent that was killed cannot end it."""
    while os.getppid() == parent:
        time.sleep(1)

    os._exit(1)
