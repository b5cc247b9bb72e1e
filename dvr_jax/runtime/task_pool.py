"""Tasks on worker processes of which any may die: the other tasks go on, and a task that was lost is tried once more.

`concurrent.futures.ProcessPoolExecutor` gives up all tasks when one worker dies, and does not say which task it had.
Here every worker has a pipe of its own, so that the task of a worker that dies is known. Results are passed on one by
one, so that a long task can report what it has so far.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from traceback import format_exception
from typing import Any

from dvr_jax.runtime.processes import prepare_worker

ATTEMPTS = 2
"""Number of workers that a task is given to before it counts as the cause of their deaths."""


class EventKind(Enum):
    """What a task reports."""

    ITEM = "item"
    """The task has produced one more result."""
    DONE = "done"
    """The task has produced all of its results."""
    FAILED = "failed"
    """The task raised an exception, or its workers died."""


@dataclass(frozen=True, slots=True)
class TaskEvent:
    """One report of one task."""

    task: int
    """Index of the task."""
    kind: EventKind
    """What is reported."""
    value: Any = None
    """The result for ITEM, or the exception for FAILED. After the death of a worker the task starts again, so that
    results can come twice."""


class WorkerDied(RuntimeError):
    """All worker processes that a task was given to have died."""


@dataclass(slots=True)
class _Worker:
    """One worker process and the task that it has."""

    process: BaseProcess
    connection: Connection
    task: int | None = None
    """Index of the task; None while the worker waits for one."""


class _Pool:
    """The workers of one call of `run_tasks`, and the tasks that wait for one."""

    def __init__(
        self,
        function: Callable[[Any], Iterable[Any]],
        tasks: Sequence[Any],
        prepare: Callable[..., object] | None,
        arguments: tuple[object, ...],
    ) -> None:
        """Line the tasks up; no worker is started yet."""
        self.function = function
        self.tasks = tasks
        self.preparation = (prepare, arguments)
        self.waiting = deque(range(len(tasks)))
        self.attempts = [0] * len(tasks)
        self.workers: dict[int, _Worker] = {}
        """Workers by slot; the worker of a slot is bound to the slot's core."""

    def fill(self, slot: int) -> None:
        """Give the next task to the worker of a slot, which is started if there is none."""
        if not self.waiting:
            return
        if slot not in self.workers:
            self.workers[slot] = self._start(slot)

        worker = self.workers[slot]
        worker.task = self.waiting.popleft()
        self.attempts[worker.task] += 1
        # If the worker has died while it waited, `receive` notices it and puts the task back.
        with suppress(OSError):
            worker.connection.send(self.tasks[worker.task])

    def receive(self, slot: int) -> TaskEvent | None:
        """Return the next report of a slot's worker; None if its worker died and its task is tried once more."""
        worker = self.workers[slot]
        assert worker.task is not None
        try:
            kind, value = worker.connection.recv()
        except (EOFError, OSError):
            return self._bury(slot)

        event = TaskEvent(worker.task, kind, value)
        if kind is not EventKind.ITEM:
            worker.task = None
        return event

    def busy(self) -> dict[Connection, int]:
        """Return the slots of the workers that have a task, by their pipes."""
        return {
            worker.connection: slot
            for slot, worker in self.workers.items()
            if worker.task is not None
        }

    def close(self) -> None:
        """End all workers, whether they have a task or not."""
        for worker in self.workers.values():
            worker.process.terminate()
        for worker in self.workers.values():
            worker.process.join()
            worker.connection.close()

    def _start(self, slot: int) -> _Worker:
        """Start the worker of a slot."""
        # Forked processes would share the parent's XLA threads, which do not survive a fork.
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_work,
            args=(os.getpid(), _core_of(slot), self.preparation, self.function, theirs),
            daemon=True,
        )

        # A new process inherits that Ctrl-C is blocked, until it comes to ignore it (`prepare_worker`). The other
        # threads of this process take it meanwhile.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        return _Worker(process, ours)

    def _bury(self, slot: int) -> TaskEvent | None:
        """Remove a worker that died; its task waits again, or has failed if this was its last attempt."""
        worker = self.workers.pop(slot)
        worker.process.join()
        worker.connection.close()
        assert worker.task is not None

        if self.attempts[worker.task] < ATTEMPTS:
            self.waiting.append(worker.task)
            return None
        error = WorkerDied(_describe_death(worker.process.exitcode))
        return TaskEvent(worker.task, EventKind.FAILED, error)


def run_tasks(
    function: Callable[[Any], Iterable[Any]],
    tasks: Sequence[Any],
    workers: int,
    prepare: Callable[..., object] | None = None,
    *arguments: object,
) -> Iterator[TaskEvent]:
    """Run tasks on processes of this machine, each of which is bound to one core and ends with this process.

    Args:
        function: Function of one task that returns or yields the task's results; it must be importable by name.
        tasks: The tasks, which are pickled.
        workers: Number of processes, which have one task each at a time.
        prepare: Function that each process calls first; it must be importable by name.
        arguments: Arguments of `prepare`.

    Yields:
        What the tasks report, as they report it. Every task ends with one event DONE or FAILED.
    """
    pool = _Pool(function, tasks, prepare, arguments)
    try:
        for slot in range(min(workers, len(tasks))):
            pool.fill(slot)

        while busy := pool.busy():
            for connection in wait(list(busy)):
                slot = busy[connection]  # type: ignore[index]
                event = pool.receive(slot)
                if slot not in pool.workers or pool.workers[slot].task is None:
                    pool.fill(slot)
                if event is not None:
                    yield event
    finally:
        pool.close()


def _work(
    parent: int,
    core: int | None,
    preparation: tuple[Callable[..., object] | None, tuple[object, ...]],
    function: Callable[[Any], Iterable[Any]],
    connection: Connection,
) -> None:
    """Carry out the tasks that come through a pipe, until the other end is closed."""
    prepare_worker(parent, core)
    prepare, arguments = preparation
    if prepare is not None:
        prepare(*arguments)

    while True:
        try:
            task = connection.recv()
        except EOFError:
            return

        try:
            for item in function(task):
                connection.send((EventKind.ITEM, item))
        except Exception as error:
            error.add_note("".join(format_exception(error)))
            connection.send((EventKind.FAILED, _picklable(error)))
        else:
            connection.send((EventKind.DONE, None))


def _picklable(error: Exception) -> Exception:
    """Return an exception that survives pickling: the exception itself, or one with its text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _core_of(slot: int) -> int | None:
    """Return the core of a slot's worker, where the cores are handed out in turn; None where none can be chosen."""
    if not hasattr(os, "sched_getaffinity"):
        return None

    cores = sorted(os.sched_getaffinity(0))
    return cores[slot % len(cores)]


def _describe_death(exit_code: int | None) -> str:
    """Describe in one sentence how a worker ended."""
    if exit_code is not None and exit_code < 0:
        how = f"was ended by the signal {signal.Signals(-exit_code).name}"
    else:
        how = f"ended with the exit code {exit_code}"
    return f"each of the {ATTEMPTS} worker processes that it was given to {how}."
