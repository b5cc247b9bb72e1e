"""The planning of one scene among many, as a task that a worker process or a machine of a cluster carries out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from dvr_jax.errors import DvrError
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.types import Scene
from dvr_jax.search.compile_ahead import compile_nothing_ahead
from dvr_jax.search.searches import GUIDED


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """How scenes are planned; the fields mean what the arguments of `dvr_jax.plan` mean."""

    search: str = "dvr"
    """Name of the search."""
    k_max: int | None = None
    """Largest number of actions; None for six, and then the lower bound plus four."""
    seed: int = 0
    """Seed of all sampling, the same for every scene."""
    time_limit: float = 300.0
    """Time after which the search of a scene gives up [s]."""
    network: Path | None = None
    """File or folder of the network; None for the shipped one."""
    clearance: float = 1.0
    """Factor of the workcell's clearances."""
    termination: str = "optimal"
    """Whether paths are optimized ("optimal") or only feasible ("feasible")."""
    shortest: bool = False
    """Whether plans have the least number of actions."""


@dataclass(frozen=True, slots=True)
class PlanFiles:
    """Which files a plan is saved as."""

    folder: Path
    """Folder of the plan."""
    pictures: bool = True
    """Whether pictures are written."""
    animation: bool = True
    """Whether the animation is written, which takes some seconds."""


@dataclass(frozen=True, slots=True)
class SceneTask:
    """One scene, how it is planned, and where the plan is saved."""

    index: int
    """Number of the scene among all scenes."""
    scene: Scene
    """The scene."""
    settings: PlanSettings
    """How it is planned."""
    files: PlanFiles | None = None
    """Where the plan is saved; None if it is not."""


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """The plan of one scene among many, or the reason why there is none."""

    index: int
    """Number of the scene among all scenes, from 0."""
    plan: Plan | None
    """The plan, which says whether the scene is solved; None if the scene was refused or its planning failed."""
    failure: str = ""
    """Why there is no plan, as one sentence; empty if there is one."""
    is_refused: bool = False
    """Whether the scene was refused as bad input, which planning it again would not change."""

    @property
    def solved(self) -> bool:
        """Whether there is a motion that passes the independent check."""
        return self.plan is not None and self.plan.solved


@lru_cache(maxsize=1)
def load_settings_network(settings: PlanSettings) -> object:
    """Return the network that settings name, read once; None for the shipped one, which the planner reads itself."""
    if settings.network is None or settings.search not in GUIDED:
        return None

    # Imported here, because searches without a network need not wait for it.
    from dvr_jax.model.predictor import load_network

    return load_network(settings.search, settings.network)


def prepare_worker() -> None:
    """Prepare a process that plans one scene after the other.

    It compiles a program when it needs it. Each worker is bound to one core, on which a thread that compiles programs
    for later would only delay the plan.
    """
    compile_nothing_ahead()


def plan_scene_task(task: SceneTask) -> Iterator[ScenePlan]:
    """Plan the scene of a task, save the plan, and yield it; a worker runs this.

    Args:
        task: The scene.

    Yields:
        One result: the plan, or why the scene was refused.
    """
    settings = task.settings
    try:
        found = plan(
            task.scene,
            settings.search,
            settings.k_max,
            settings.seed,
            settings.time_limit,
            network=load_settings_network(settings),  # type: ignore[arg-type]
            clearance=settings.clearance,
            termination=settings.termination,
            shortest=settings.shortest,
        )
    except DvrError as error:
        yield ScenePlan(task.index, None, str(error), is_refused=True)
        return

    if task.files is not None:
        found.save(task.files.folder, task.files.pictures, task.files.animation)
    yield ScenePlan(task.index, found)
