"""Executions of one plan under many conditions: how robust is it?

MuJoCo C executes in parallel processes, MJX as one batch. The conditions of an execution depend on the seed and on its
number alone, so both backends execute under the same ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dvr_jax.errors import OptionError
from dvr_jax.execution.backend import PhysicsBackend
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.executor import execute
from dvr_jax.execution.report import ExecutionReport
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.runtime.processes import worker_processes
from dvr_jax.scene.types import Scene


@dataclass(frozen=True, slots=True)
class ConditionRange:
    """Conditions that vary from one execution to the next."""

    object_noise: float = 0.0
    """Standard deviation of the initial displacement of each object along x and along y [m]."""

    friction: tuple[float, float] = (1.0, 1.0)
    """Least and largest factor of the objects' friction, from which each execution draws its own."""

    seed: int = 0
    """Seed; execution i of a seed is the same whatever their number is."""

    def __post_init__(self) -> None:
        """Refuse ends that are no physics, or that are in the wrong order."""
        for friction in self.friction:
            ExecutionConditions(friction, object_noise=self.object_noise, seed=self.seed)
        if not self.friction[0] <= self.friction[1]:
            raise OptionError(
                f"the friction is {self.friction[0]:g} to {self.friction[1]:g}; valid is the smaller number first."
            )

    def conditions(self, index: int) -> ExecutionConditions:
        """Return the conditions of execution `index`."""
        generator = np.random.default_rng([self.seed, index])
        return ExecutionConditions(
            friction=float(generator.uniform(*self.friction)),
            object_noise=self.object_noise,
            seed=int(generator.integers(2**31)),
        )


def execute_repeatedly(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    variation: ConditionRange,
    number: int,
    workers: int,
    backend: PhysicsBackend = PhysicsBackend.MUJOCO,
    report_progress: Callable[[str], None] = lambda line: None,
) -> Iterator[ExecutionReport]:
    """Execute a motion several times, each time under conditions of its own.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        variation: What varies.
        number: Number of executions.
        workers: Number of processes of MuJoCo C; MJX runs in this process.
        backend: What simulates.
        report_progress: Shows a line about the progress of MJX, whose reports all come at its end.

    Yields:
        The report of each execution, in their order.

    Raises:
        OptionError: The conditions are no physics, a number is not positive, or MJX cannot simulate the scene.
    """
    for name, value in (("executions", number), ("processes", workers)):
        if value < 1:
            raise OptionError(f"the number of {name} is {value}; valid is 1 or more.")

    conditions = [variation.conditions(index) for index in range(number)]
    if backend is PhysicsBackend.MJX:
        # Imported here, because MuJoCo C does not need JAX.
        from dvr_jax.execution.mjx_batch import execute_batch

        for execution in execute_batch(
            scene, actions, motion, conditions, report_progress=report_progress
        ):
            yield execution.report
        return

    with worker_processes(min(workers, number)) as pool:
        tasks = [pool.submit(_report, scene, tuple(actions), motion, each) for each in conditions]
        for task in tasks:
            yield task.result()


def _report(
    scene: Scene, actions: tuple[Action, ...], motion: Motion, conditions: ExecutionConditions
) -> ExecutionReport:
    """Execute a motion once; what a worker process does."""
    return execute(scene, actions, motion, conditions).report
