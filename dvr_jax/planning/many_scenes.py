"""Plan many scenes at a time, on the cores of this machine or on a Ray cluster.

import dvr_jax as dvr

if __name__ == "__main__":  # worker processes import this file
    scenes = dvr.load_scenes("scenes.jsonl")
    for result in dvr.plan_scenes(scenes, workers=4):
        print(result.index, result.plan or result.failure)
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from dvr_jax.errors import OptionError
from dvr_jax.model.predictor import load_network
from dvr_jax.planning.arguments import (
    describe_value,
    require_integer,
    require_number,
    require_positive,
    require_scene,
)
from dvr_jax.planning.path_quality import TERMINATIONS
from dvr_jax.planning.scene_tasks import (
    PlanSettings,
    ScenePlan,
    SceneTask,
    plan_scene_task,
    prepare_worker,
)
from dvr_jax.runtime.ray_cluster import run_tasks_on_ray
from dvr_jax.runtime.task_pool import EventKind, TaskEvent, run_tasks
from dvr_jax.scene.types import Scene
from dvr_jax.search.searches import GUIDED, SEARCHES
from dvr_jax.workcell.clearances import LARGEST_FACTOR


def plan_scenes(
    scenes: Iterable[Scene],
    search: str = "dvr",
    k_max: int | None = None,
    seed: int = 0,
    time_limit: float = 300.0,
    network: str | os.PathLike[str] | None = None,
    clearance: float = 1.0,
    termination: str = "optimal",
    shortest: bool = False,
    workers: int | None = None,
    ray: str | None = None,
) -> Iterator[ScenePlan]:
    """Plan many scenes by worker processes, and yield each plan as it is ready.

    Every plan is the one that `plan` returns for its scene. A scene that is refused, or whose worker dies, does not end
    the others. The workers end when the iterator is closed. A script that calls this function has to do so under
    ``if __name__ == "__main__":``, because the workers import it.

    Args:
        scenes: Valid scenes.
        search: Name of the search, as in `plan`.
        k_max: Largest number of actions, as in `plan`.
        seed: Seed of all sampling, from 0.
        time_limit: Time after which the search of each scene gives up [s].
        network: File or folder of a trained network of the search's kind; None for the shipped one.
        clearance: Factor of the workcell's clearances, from 0 to 3.
        termination: "optimal" or "feasible", as in `plan`.
        shortest: Whether plans have the least number of actions.
        workers: Number of processes, which plan one scene each at a time; None for one on each core.
        ray: Address of a Ray cluster whose CPUs take the workers' place; "auto" means the one of this machine.

    Returns:
        An iterator over the results in the order in which they are ready; `ScenePlan.index` counts the scenes.

    Raises:
        OptionError: An argument has a wrong type or value.
        NetworkError: The file holds no network of the search's kind.
    """
    settings = require_settings(
        PlanSettings(
            search=search,
            k_max=None if k_max is None else require_integer("k_max", k_max, least=1),
            seed=require_integer("the seed", seed, least=0),
            time_limit=require_positive("the time limit", time_limit, "s"),
            network=None if network is None else Path(network),
            clearance=require_number("the clearance", clearance),
            termination=termination,
            shortest=shortest,
        )
    )
    tasks = [SceneTask(index, require_scene(scene), settings) for index, scene in enumerate(scenes)]
    count = None if workers is None else require_integer("the number of workers", workers, least=1)
    return run_scene_tasks(tasks, count, ray)


def require_settings(settings: PlanSettings) -> PlanSettings:
    """Return settings that `plan` would accept for some scene, and refuse all others before any worker starts.

    Raises:
        OptionError: A setting has a wrong value.
        NetworkError: The file holds no network of the search's kind.
    """
    if settings.search not in SEARCHES:
        raise OptionError(f"there is no search {settings.search!r}; valid: {', '.join(SEARCHES)}.")
    if settings.termination not in TERMINATIONS:
        found = describe_value(settings.termination)
        raise OptionError(f"the termination is {found}; valid: {', '.join(TERMINATIONS)}.")
    if not 0 <= settings.clearance <= LARGEST_FACTOR:
        raise OptionError(
            f"the clearance is {settings.clearance:g}; valid is 0 to {LARGEST_FACTOR:g}."
        )

    if settings.network is not None:
        if settings.search not in GUIDED:
            raise OptionError(
                f"the search {settings.search!r} takes no network; valid with one: {', '.join(GUIDED)}."
            )
        load_network(settings.search, settings.network)
    return settings


def run_scene_tasks(
    tasks: Sequence[SceneTask], workers: int | None = None, ray: str | None = None
) -> Iterator[ScenePlan]:
    """Plan the scenes of tasks, and yield one result for each of them.

    Args:
        tasks: The scenes.
        workers: Number of processes; None for one on each core.
        ray: Address of a Ray cluster that takes the processes' place.

    Yields:
        The results in the order in which they are ready.
    """
    for event in _run(tasks, workers, ray):
        if event.kind is EventKind.ITEM:
            yield event.value
        elif event.kind is EventKind.FAILED:
            reason = f"{type(event.value).__name__}: {event.value}"
            yield ScenePlan(tasks[event.task].index, None, reason)


def _run(tasks: Sequence[SceneTask], workers: int | None, ray: str | None) -> Iterator[TaskEvent]:
    """Run the tasks where they are to run."""
    if ray is not None:
        return run_tasks_on_ray(plan_scene_task, tasks, ray)

    number = workers if workers is not None else len(_own_cores())
    return run_tasks(plan_scene_task, tasks, number, prepare_worker)


def _own_cores() -> range | set[int]:
    """Return the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return range(os.cpu_count() or 1)
