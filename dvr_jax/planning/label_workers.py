"""Who labels the shards of a sweep: processes of this machine, or the machines of a Ray cluster."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import jax

from dvr_jax.dataset.labelling import LabelOptions, label_scene
from dvr_jax.dataset.labels import Label
from dvr_jax.planning.feasibility import passes_check
from dvr_jax.runtime.ray_cluster import run_tasks_on_ray
from dvr_jax.runtime.task_pool import EventKind, TaskEvent, run_tasks
from dvr_jax.scene.types import Scene
from dvr_jax.search.work import run_together


@dataclass(frozen=True, slots=True)
class LabelTask:
    """Scenes of one shard, and how they are labeled."""

    scenes: Mapping[int, Scene]
    """Scenes by their indices in the sweep's file."""
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

    Returns:
        An iterator over the indices of the scenes and their labels.

    Raises:
        DvrError: The arms are in collision in a scene's initial state.
    """
    return label_task(LabelTask(dict(enumerate(scenes, start=first)), options, width))


def label_task(task: LabelTask) -> Iterator[tuple[int, list[Label]]]:
    """Yield the index of each scene of a task, and its labels, as it is done; a worker runs this.

    Raises:
        DvrError: The arms are in collision in a scene's initial state.
    """
    indices = list(task.scenes)
    with jax.enable_x64(True):
        computations = (
            label_scene(scene, index, task.options, passes_check)
            for index, scene in task.scenes.items()
        )
        for number, labels in run_together(computations, task.width):
            yield indices[number], labels


def label_on_workers(
    tasks: Sequence[LabelTask], workers: int, ray: str | None
) -> Iterator[tuple[int, list[Label]]]:
    """Label tasks by processes of this machine, or by the machines of a Ray cluster.

    A task whose process is lost is given to another one, so that scenes can come twice.

    Args:
        tasks: Tasks to label.
        workers: Number of processes of this machine, which label one task each at a time.
        ray: Address of a Ray cluster whose CPUs take their place; None without one.

    Yields:
        Index of a scene, and its labels, as it is done.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
        DvrError: The arms are in collision in a scene's initial state.
        WorkerDied: A task was lost repeatedly.
    """
    for event in _run(tasks, workers, ray):
        if event.kind is EventKind.ITEM:
            yield event.value
        elif event.kind is EventKind.FAILED:
            raise event.value


def _run(tasks: Sequence[LabelTask], workers: int, ray: str | None) -> Iterator[TaskEvent]:
    """Run tasks where they are to run."""
    if ray is not None:
        return run_tasks_on_ray(label_task, tasks, ray)
    return run_tasks(label_task, tasks, workers)
