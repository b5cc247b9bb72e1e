"""Tasks on processes of which some die: the other tasks are done, and every task ends with one event."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dvr_jax.runtime.task_pool import EventKind, TaskEvent, WorkerDied, run_tasks


def square(task: object) -> Iterator[object]:
    """Yield a number and its square; "die" kills the process, "fail" raises, a path counts its visitors."""
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "fail":
        raise ValueError("no number")
    if isinstance(task, Path):
        with task.open("a") as file:
            file.write("x")
        if len(task.read_text()) == 1:
            os._exit(3)
        yield task.read_text()
        return
    yield task
    yield task * task  # type: ignore[operator]


def wait_for_ever(path: Path) -> Iterator[int]:
    """Write the number of this process and wait."""
    path.write_text(str(os.getpid()))
    yield os.getpid()
    time.sleep(600)


def by_task(events: list[TaskEvent]) -> dict[int, list[TaskEvent]]:
    tasks = {event.task for event in events}
    return {task: [event for event in events if event.task == task] for task in tasks}


def test_results_come_one_by_one_and_every_task_ends_once() -> None:
    events = by_task(list(run_tasks(square, [2, 3, 4], 2)))
    assert sorted(events) == [0, 1, 2]
    for index, number in enumerate([2, 3, 4]):
        *items, last = events[index]
        assert [event.value for event in items] == [number, number**2]
        assert last == TaskEvent(index, EventKind.DONE)


def test_a_task_that_kills_its_workers_fails_and_the_others_are_done(tmp_path: Path) -> None:
    tasks = [2, "die", "fail", 3, tmp_path / "visitors", 4]
    ends = {index: list_[-1] for index, list_ in by_task(list(run_tasks(square, tasks, 2))).items()}
    kinds = [ends[index].kind.value for index in range(6)]
    assert kinds == ["done", "failed", "failed", "done", "done", "done"]

    assert isinstance(ends[1].value, WorkerDied)
    assert "each of the 2 worker processes" in str(ends[1].value)
    assert "SIGKILL" in str(ends[1].value)
    assert isinstance(ends[2].value, ValueError) and str(ends[2].value) == "no number"
    # The task whose first worker died was given to a second one.
    assert (tmp_path / "visitors").read_text() == "xx"


def test_the_workers_end_when_nobody_listens_any_more(tmp_path: Path) -> None:
    events = run_tasks(wait_for_ever, [tmp_path / "a"], 1)
    process = next(events).value
    events.close()  # type: ignore[attr-defined]
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_no_task_needs_no_worker() -> None:
    assert list(run_tasks(square, [], 2)) == []
