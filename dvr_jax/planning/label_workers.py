"""Who labels the shards of a sweep: processes of this machine, or the machines of a Ray cluster."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass

import jax

from dvr_jax.dataset.labelling import LabelOptions, label_scene
from dvr_jax.dataset.labels import Label
from dvr_jax.errors import OptionError
from dvr_jax.planning.feasibility import passes_check
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.types import Scene
from dvr_jax.search.work import run_together

CONNECTION_TIMEOUT = 10.0
"""Longest wait for a cluster's address to answer [s]; Ray itself tries for minutes."""


@dataclass(frozen=True, slots=True)
class LabelTask:
    """The scenes of one shard, and how they are labeled."""

    scenes: Sequence[Scene]
    """Scenes of the shard."""
    first: int
    """Index of the first scene in the sweep's file."""
    options: LabelOptions
    """What the labels depend on."""
    width: int
    """Number of scenes whose solves share a batch."""


def label_scenes(
    scenes: Sequence[Scene],
    first: int,
    options: LabelOptions,
    width: int,
) -> Iterator[tuple[int, list[Label]]]:
    """Label scenes and yield the labels of each scene as it is done.

    Args:
        scenes: Scenes with the indices `first`, `first + 1`, ...
        first: Index of the first scene.
        options: What the labels depend on.
        width: Number of scenes whose solves share a batch; the labels do not depend on it.

    Yields:
        Index of a scene, and its labels.

    Raises:
        DvrError: The arms are in collision in a scene's initial state.
    """
    with jax.enable_x64(True):
        computations = (
            label_scene(scene, first + offset, options, passes_check)
            for offset, scene in enumerate(scenes)
        )
        for offset, labels in run_together(computations, width):
            yield first + offset, labels


def label_task(task: LabelTask) -> list[Label]:
    """Return the labels of all scenes of a task; a worker runs this."""
    labels: list[Label] = []
    for _, found in label_scenes(task.scenes, task.first, task.options, task.width):
        labels.extend(found)

    return labels


def label_on_processes(
    tasks: Sequence[LabelTask], workers: int
) -> Iterator[tuple[LabelTask, list[Label]]]:
    """Label tasks by processes of this machine.

    Args:
        tasks: Tasks to label.
        workers: Number of processes, which label one task each at a time.

    Yields:
        Each task with its labels, as it is done.
    """
    with worker_processes(workers) as pool:
        futures = {pool.submit(label_task, task): task for task in tasks}
        for future in as_completed(futures):
            yield futures.pop(future), future.result()


def label_on_ray(
    tasks: Sequence[LabelTask], address: str
) -> Iterator[tuple[LabelTask, list[Label]]]:
    """Label tasks by a Ray cluster; tasks of a machine that is lost are given to another one.

    Args:
        tasks: Tasks to label.
        address: Address of a running cluster; "auto" means the one that runs on this machine.

    Yields:
        Each task with its labels, as it is done.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
    """
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

    try:
        remote_label = ray.remote(num_cpus=1, max_retries=-1)(label_task)
        waiting = {remote_label.remote(task): task for task in tasks}
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done), ray.get(done)
    finally:
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Raise OSError or ValueError unless something listens at an address HOST:PORT; "auto" has no host."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host:
        socket.create_connection((host, int(port)), timeout=CONNECTION_TIMEOUT).close()
