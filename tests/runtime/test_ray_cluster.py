"""Tasks on a Ray cluster report what tasks on this machine's processes report."""

import os
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest
from ray.cluster_utils import Cluster

from dvr_jax.runtime.ray_cluster import run_tasks_on_ray
from dvr_jax.runtime.task_pool import EventKind, TaskEvent, WorkerDied


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    yield cluster.address
    cluster.shutdown()


def run(
    function: Callable[[Any], Iterable[Any]], tasks: list[Any], address: str
) -> list[TaskEvent]:
    return list(run_tasks_on_ray(function, tasks, address))


def test_results_come_one_by_one_and_a_defect_ends_its_own_task(address: str) -> None:
    # The function of a task is `range`, which has no text as a limit.
    events = run(range, [2, "no number", 3], address)
    of_task = {task: [event for event in events if event.task == task] for task in range(3)}
    assert [event.value for event in of_task[0]] == [0, 1, None]
    assert [event.value for event in of_task[2]] == [0, 1, 2, None]
    assert all(of_task[task][-1].kind is EventKind.DONE for task in (0, 2))
    (failed,) = of_task[1]
    assert failed.kind is EventKind.FAILED and isinstance(failed.value, TypeError)


@pytest.mark.slow
def test_a_task_that_ends_its_process_fails(address: str) -> None:
    (event,) = run(os._exit, [3], address)
    assert event.kind is EventKind.FAILED and isinstance(event.value, WorkerDied)
    assert "were lost" in str(event.value)
