"""Execution of a motion in MuJoCo C, open loop, and the comparison with what the plan wants."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.operators import CHECKS, OperatorCheck
from dvr_jax.execution.commands import ServoCommands, servo_commands
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.physics_model import build_execution_model
from dvr_jax.execution.task import (
    Execution,
    ExecutionTask,
    SimulatedStates,
    first_state,
    judge,
    prepare_task,
)
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.types import Scene

DIVERGENCE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
"""Warnings of MuJoCo after which a simulation means nothing."""

NOMINAL = ExecutionConditions()
"""Conditions without noise."""


def execute(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    conditions: ExecutionConditions = NOMINAL,
    operators: Sequence[OperatorCheck] = CHECKS,
) -> Execution:
    """Execute a motion in physics, open loop.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        conditions: Friction, density, grip force and noise.
        operators: The check's operators; every action has to be of one of them.

    Returns:
        The executed motion with its report.

    Raises:
        MotionError: The motion's arrays do not fit the scene, or an action does not apply where it stands.
    """
    task = prepare_task(scene, actions, motion, operators)
    model = build_execution_model(scene, conditions)
    commands = servo_commands(model, scene, motion, task.grips, conditions, task.duration)
    # Without a handler, MuJoCo writes its warnings into a file in the working folder; here they end up in the report.
    mujoco.set_mju_user_warning(lambda warning: None)
    try:
        simulated = _simulate(model, commands, first_state(task, conditions), task)
    finally:
        mujoco.set_mju_user_warning(None)
    return judge(task, model, simulated)


def _simulate(
    model: mujoco.MjModel,
    commands: ServoCommands,
    start: Float[np.ndarray, " nq"],
    task: ExecutionTask,
) -> SimulatedStates:
    """Simulate all steps.

    Args:
        model: The model.
        commands: Targets of the servos in each step.
        start: State at the first step.
        task: The motion, which says when the state is recorded.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = start
    record_steps = task.record_steps(model.opt.timestep)
    states = np.empty((len(record_steps), model.nq))
    touches: list[frozenset[tuple[int, int]]] = []
    watch = _TouchWatch(model)

    # MuJoCo keeps its arrays, and looking them up in every step would take as long as filling them.
    qpos = data.qpos
    control = data.ctrl
    for step, targets in enumerate(commands.targets):
        while len(touches) < len(record_steps) and step == record_steps[len(touches)]:
            states[len(touches)] = qpos
            touches.append(watch.take())
        control[:] = targets
        mujoco.mj_step(model, data)
        watch.look(data)
    # After one of these warnings, MuJoCo starts again from its own initial state.
    is_stable = not any(data.warning[kind].number for kind in DIVERGENCE)
    return SimulatedStates(states, touches, is_stable)


class _TouchWatch:
    """Collects the pairs of bodies that touch each other, step by step."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._body_of_geom = np.array(model.geom_bodyid)
        self._pairs: set[tuple[int, int]] = set()
        self._latest = b""

    def look(self, data: mujoco.MjData) -> None:
        """Add the pairs that touch now; most steps have the same contacts as the one before."""
        geoms = data.contact.geom
        content = geoms.tobytes()
        if content != self._latest:
            self._latest = content
            self._pairs.update(map(tuple, self._body_of_geom[geoms].tolist()))

    def take(self) -> frozenset[tuple[int, int]]:
        """Return the pairs since the last call."""
        pairs = frozenset(self._pairs)
        # Contacts that last are those of the next record, too.
        self._pairs.clear()
        self._latest = b""
        return pairs
