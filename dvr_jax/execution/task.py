"""What an execution starts from, what a simulator records, and how the records are judged.

A simulator turns an `ExecutionTask` into `SimulatedStates`, and `judge` turns these into an `Execution`. Both
simulators (`dvr_jax.execution.executor` and `dvr_jax.execution.mjx_batch`) share this module.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.operators import OperatorCheck
from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.checker.replay import validate_fit
from dvr_jax.checker.timeline import attachment_timeline
from dvr_jax.execution.commands import GripInterval, grip_intervals
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.diagnosis import ExecutedMotion, differences, find_deviation
from dvr_jax.execution.goal import goal_holds
from dvr_jax.execution.report import ExecutionReport, ObjectResult
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import Layout, qpos_layout
from dvr_jax.scene.types import Scene

SETTLING = 1.5
"""Time for which the scene is left alone after the motion [s]."""


@dataclass(frozen=True, slots=True)
class Execution:
    """An executed motion."""

    report: ExecutionReport
    """What became of the plan."""

    time: Float[np.ndarray, " records"]
    """Times of the recorded states [s]."""

    qpos: Float[np.ndarray, "records nq"]
    """Recorded states: at the samples of the motion, and as often while the scene settles."""


@dataclass(frozen=True, slots=True)
class ExecutionTask:
    """A motion that shall be executed, and what is known about it before."""

    scene: Scene
    """The scene that the motion starts in."""

    motion: Motion
    """The motion."""

    timeline: Timeline
    """Intervals in which objects keep their attachments."""

    grips: tuple[GripInterval, ...]
    """When each gripper is closed on an object."""

    layout: Layout
    """Where each quantity lies in a state."""

    time: Float[np.ndarray, " records"]
    """Times at which the state is recorded: those of the motion's samples, and as often while the scene settles [s]."""

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return float(self.time[-1])

    def record_steps(self, time_step: float) -> list[int]:
        """Return the number of the simulation step at each recorded time; several records may share a step.

        Args:
            time_step: Time step of the simulation [s].
        """
        return np.rint(self.time / time_step).astype(int).tolist()


@dataclass(frozen=True, slots=True)
class SimulatedStates:
    """What a simulation has recorded."""

    states: Float[np.ndarray, "records nq"]
    """The states at the times of the task."""

    touches: Sequence[frozenset[tuple[int, int]]]
    """Pairs of bodies that touched since the record before, for each record."""

    is_stable: bool
    """False if the numbers diverged; then the states mean nothing from some record on."""


def prepare_task(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    operators: Sequence[OperatorCheck],
) -> ExecutionTask:
    """Validate a motion against its scene, and collect what its execution needs.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        operators: The check's operators; every action has to be of one of them.

    Returns:
        The task.

    Raises:
        MotionError: The motion's arrays do not fit the scene, or an action does not apply where it stands.
    """
    validate_fit(scene, actions, motion)
    layout = qpos_layout(scene)
    timeline = attachment_timeline(scene, actions, motion, operators)
    grips = grip_intervals(motion, timeline, layout)
    time = motion.step * np.arange(len(motion.time) + math.ceil(SETTLING / motion.step))
    return ExecutionTask(scene, motion, timeline, grips, layout, time)


def first_state(task: ExecutionTask, conditions: ExecutionConditions) -> Float[np.ndarray, " nq"]:
    """Return the first state of a motion, with its objects displaced at random.

    Args:
        task: The motion.
        conditions: Size and seed of the displacements.
    """
    state = task.motion.qpos[0].copy()
    generator = np.random.default_rng(conditions.seed)
    noise = generator.normal(0.0, 1.0, (len(task.layout.objects), 2))
    state[task.layout.objects[:, :2]] += conditions.object_noise * noise
    return state


def judge(task: ExecutionTask, model: mujoco.MjModel, simulated: SimulatedStates) -> Execution:
    """Compare what a simulation has recorded with what the plan wants.

    Args:
        task: The motion that was executed.
        model: The model in which it was executed; it names the bodies.
        simulated: What was recorded.

    Returns:
        The executed motion with its report.
    """
    states = simulated.states
    executed = ExecutedMotion(
        task.scene, task.motion, task.timeline, task.grips, task.layout, states, simulated.touches
    )
    is_stable = simulated.is_stable
    report = ExecutionReport(
        succeeded=is_stable and goal_holds(task.scene, task.timeline, states[-1]),
        is_stable=is_stable,
        objects=_results(task, states[-1]),
        deviation=find_deviation(model, executed) if is_stable else None,
        duration=task.duration,
    )
    return Execution(report, task.time, states)


def _results(task: ExecutionTask, reached: Float[np.ndarray, " nq"]) -> tuple[ObjectResult, ...]:
    """Compare the objects at the end with the plan."""
    planned = task.motion.qpos[-1]
    results = []
    for item, columns in zip(task.scene.objects, task.layout.objects, strict=True):
        distance, turn = differences(planned[None, columns], reached[None, columns])
        results.append(ObjectResult(item.name, float(distance[0]), float(turn[0])))
    return tuple(results)
