"""Tasks on the machines of a Ray cluster on which this package is installed."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from dvr_jax.errors import OptionError
from dvr_jax.runtime.task_pool import EventKind, TaskEvent, WorkerDied

CONNECTION_TIMEOUT = 10.0
"""Longest wait for a cluster's address to answer [s]; Ray itself tries for minutes."""

RETRIES = 3
"""Number of times that a task is given to another machine after its machine or its process was lost."""


def run_tasks_on_ray(
    function: Callable[[Any], Iterable[Any]], tasks: Sequence[Any], address: str
) -> Iterator[TaskEvent]:
    """Run tasks on a Ray cluster, one on each CPU at a time.

    Args:
        function: Function of one task that returns or yields the task's results; it must be importable by name.
        tasks: The tasks, which are pickled.
        address: Address of a running cluster; "auto" means the one that runs on this machine.

    Yields:
        What the tasks report, as they report it. Every task ends with one event DONE or FAILED.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
    """
    ray = _connect(address)

    try:
        remote = ray.remote(num_cpus=1, max_retries=RETRIES, num_returns="streaming")(_stream)
        streams = {remote.remote(function, task): index for index, task in enumerate(tasks)}

        while streams:
            (ready,), _ = ray.wait(list(streams), num_returns=1)
            event = _next_event(ray, ready, streams[ready])
            if event.kind is not EventKind.ITEM:
                del streams[ready]
            yield event
    finally:
        ray.shutdown()


def _stream(function: Callable[[Any], Iterable[Any]], task: Any) -> Iterator[Any]:
    """Yield the results of one task; a machine of the cluster runs this."""
    # Ray sends values into the generator, which `yield from` would pass on to iterators that take none.
    for item in function(task):  # noqa: UP028
        yield item


def _next_event(ray: Any, stream: Any, task: int) -> TaskEvent:
    """Return what a task reports next."""
    try:
        return TaskEvent(task, EventKind.ITEM, ray.get(next(stream)))
    except StopIteration:
        return TaskEvent(task, EventKind.DONE)
    except ray.exceptions.RayTaskError as error:
        cause = error.cause if isinstance(error.cause, Exception) else error
        return TaskEvent(task, EventKind.FAILED, cause)
    except ray.exceptions.RayError as error:
        reason = str(error).splitlines()[0].rstrip(".")
        lost = WorkerDied(f"its processes on the cluster were lost: {reason}.")
        return TaskEvent(task, EventKind.FAILED, lost)


def _connect(address: str) -> Any:
    """Connect to a cluster and return the module `ray`."""
    try:
        import ray
    except ImportError:
        raise OptionError(
            "--ray needs Ray, which is not installed; `pip install '.[ray]'` in the repository installs it."
        ) from None

    try:
        _require_answer(address)
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise OptionError(
            f"--ray {address}: {reason}; valid is the address of a running cluster, or auto."
        ) from None
    return ray


def _require_answer(address: str) -> None:
    """Raise OSError or ValueError unless something listens at an address HOST:PORT; "auto" has no host."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host:
        socket.create_connection((host, int(port)), timeout=CONNECTION_TIMEOUT).close()
