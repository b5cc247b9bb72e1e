"""Execution of a motion in MuJoCo MJX: many copies under different conditions, as one batch.

One compiled program simulates `CHUNK_STEPS` time steps of all copies (`jax.lax.scan` over the steps, `jax.vmap` over
the copies) and returns, for each step, the states and the pairs of bodies that touch. The host keeps the states at the
motion's samples and collects the touches between them, so that the report of each copy comes from the same records as
that of MuJoCo C (`dvr_jax.execution.task`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Bool, Float

from dvr_jax.checker.operators import CHECKS, OperatorCheck
from dvr_jax.errors import OptionError
from dvr_jax.execution.commands import servo_commands
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.mjx_model import (
    FrictionBatch,
    build_mjx_model,
    contact_limit,
    first_data,
    put_on_device,
    stack_friction,
    step_copies,
)
from dvr_jax.execution.mjx_records import NO_CONTACT, BatchRecorder, StepRecords
from dvr_jax.execution.task import Execution, first_state, judge, prepare_task
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.runtime.compilation import CPU_OPTIONS
from dvr_jax.scene.types import Scene

CHUNK_STEPS = 250
"""Time steps that one call of the program simulates; between calls, progress is reported."""

ReportProgress = Callable[[str], None]
"""Function that shows a line of progress to the user."""


def ignore_progress(line: str) -> None:
    """Show nothing."""


def execute_batch(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    conditions: Sequence[ExecutionConditions],
    operators: Sequence[OperatorCheck] = CHECKS,
    report_progress: ReportProgress = ignore_progress,
) -> list[Execution]:
    """Execute a motion once under each of several conditions, open loop, as one batch in MJX.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        conditions: The conditions of each execution; all with the same grip force.
        operators: The check's operators; every action has to be of one of them.
        report_progress: Shows a line of progress.

    Returns:
        The executions, in the order of the conditions.

    Raises:
        MotionError: The motion's arrays do not fit the scene, or an action does not apply where it stands.
        OptionError: MJX cannot simulate the scene, there are no conditions, or the grip forces differ.
    """
    forces = sorted({each.grip_force for each in conditions})
    if len(forces) != 1:
        raise OptionError(
            f"the grip forces of the batch are {forces} N; valid is one force for all its executions."
        )
    task = prepare_task(scene, actions, motion, operators)
    model = build_mjx_model(scene, conditions[0])
    commands = servo_commands(model, scene, motion, task.grips, conditions[0], task.duration)
    states = np.stack([first_state(task, each) for each in conditions])

    # Double precision: in single precision the solver of the stiff contacts of the pads does not converge, takes
    # several times as long, and objects slip out of grippers that hold them in MuJoCo C.
    with jax.enable_x64(True):
        simulation = _Simulation(model, scene, conditions, states, report_progress)
        recorder = BatchRecorder(task, model, len(conditions))
        _run(simulation, recorder, commands.targets, report_progress)

    _report_crowding(recorder.is_crowded, contact_limit(scene), report_progress)
    return [judge(task, model, recorder.simulated(copy)) for copy in range(len(conditions))]


class _Simulation:
    """The compiled program, and the data of all copies after the latest chunk."""

    def __init__(
        self,
        model: mujoco.MjModel,
        scene: Scene,
        conditions: Sequence[ExecutionConditions],
        states: Float[np.ndarray, "copies nq"],
        report_progress: ReportProgress,
    ) -> None:
        """Put everything on the device, and compile the program.

        Args:
            model: The model of the scene.
            scene: The scene.
            conditions: The conditions of each copy.
            states: First state of each copy.
            report_progress: Shows a line of progress.
        """
        self._model = put_on_device(model)
        self._friction = stack_friction(scene, conditions)
        self._data = first_data(self._model, states)
        targets = jnp.zeros((CHUNK_STEPS, model.nu))

        report_progress(
            f"compiling the simulation for {len(states)} copies, up to a minute on a CPU"
        )
        begin = time.perf_counter()
        # Like the solver's programs, this one consists of many small kernels. With these options it compiles in half
        # the time, and a step takes two thirds of the time.
        options = CPU_OPTIONS if jax.default_backend() == "cpu" else {}
        program = jax.jit(_simulate_chunk, compiler_options=options)
        arguments = (self._model, self._friction, self._data, targets)
        self._program = program.lower(*arguments).compile()
        report_progress(f"compiled in {time.perf_counter() - begin:.1f} s")

    def advance(self, targets: Float[np.ndarray, "steps nu"]) -> StepRecords:
        """Simulate the next chunk.

        Args:
            targets: Targets of the servos in each of its steps.

        Returns:
            The records on the host, with a leading axis of steps.
        """
        self._data, records = self._program(
            self._model, self._friction, self._data, jnp.asarray(targets)
        )
        return StepRecords(*map(np.asarray, records))


def _simulate_chunk(
    model: Any, friction: FrictionBatch, data: Any, targets: Float[Array, "steps nu"]
) -> tuple[Any, StepRecords]:
    """Simulate one chunk; what is compiled.

    Args:
        model: The model of MJX.
        friction: Coefficients of friction of each copy.
        data: The data of all copies.
        targets: Targets of the servos in each step.

    Returns:
        The data after the chunk, and the records of its steps.
    """

    def step(data: Any, targets: Float[Array, " nu"]) -> tuple[Any, StepRecords]:
        after = step_copies(model, friction, data, targets)
        return after, _record(model, data.qpos, after)

    return jax.lax.scan(step, data, targets)


def _record(model: Any, qpos: Float[Array, "copies nq"], after: Any) -> StepRecords:
    """Return the record of one step.

    Args:
        model: The model of MJX.
        qpos: States before the step.
        after: The data after the step.
    """
    contact = after._impl.contact
    is_active = contact.dist < 0
    bodies = jnp.asarray(model.geom_bodyid)
    codes = bodies[contact.geom1] * model.nbody + bodies[contact.geom2]

    numbers = jnp.concatenate([after.qpos, after.qvel, after.qacc], axis=1)
    return StepRecords(
        qpos=qpos,
        touching=jnp.where(is_active, codes, NO_CONTACT),
        # A comparison with a number that is not finite is false.
        is_stable=jnp.all(jnp.abs(numbers) < mujoco.mjMAXVAL, axis=1),
        is_crowded=jnp.all(is_active, axis=1),
    )


def _run(
    simulation: _Simulation,
    recorder: BatchRecorder,
    targets: Float[np.ndarray, "steps nu"],
    report_progress: ReportProgress,
) -> None:
    """Simulate all steps, chunk by chunk.

    Args:
        simulation: The compiled program.
        recorder: Takes the records.
        targets: Targets of the servos in each step.
        report_progress: Shows a line of progress after each tenth of the steps.
    """
    steps = len(targets)
    shown = 0
    begin = time.perf_counter()
    for first in range(0, steps, CHUNK_STEPS):
        chunk = targets[first : first + CHUNK_STEPS]
        number = len(chunk)
        # The program takes whole chunks; what the last one simulates after its end is dropped.
        chunk = np.pad(chunk, ((0, CHUNK_STEPS - number), (0, 0)), mode="edge")
        records = simulation.advance(chunk)
        recorder.add(first, StepRecords(*(each[:number] for each in records)))

        tenths = 10 * (first + number) // steps
        if tenths > shown:
            shown = tenths
            elapsed = time.perf_counter() - begin
            report_progress(f"simulated {10 * tenths} % of the steps in {elapsed:.0f} s")


def _report_crowding(
    is_crowded: Bool[np.ndarray, " copies"], limit: int, report_progress: ReportProgress
) -> None:
    """Say in which executions contacts may have been left out."""
    for copy in np.flatnonzero(is_crowded):
        report_progress(
            f"execution {copy} had {limit} or more contacts at once, of which {limit} were simulated; "
            "the backend mujoco simulates all"
        )
