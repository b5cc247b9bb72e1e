"""Execution of a motion in MuJoCo, open loop, and the comparison with what the plan wants."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.operators import CHECKS, OperatorCheck
from dvr_jax.checker.replay import validate_fit
from dvr_jax.checker.timeline import attachment_timeline
from dvr_jax.execution.commands import ServoCommands, grip_intervals, servo_commands
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.diagnosis import ExecutedMotion, differences, find_deviation
from dvr_jax.execution.goal import goal_holds
from dvr_jax.execution.physics_model import build_execution_model
from dvr_jax.execution.report import ExecutionReport, ObjectResult
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import Layout, qpos_layout
from dvr_jax.scene.types import Scene

SETTLING = 1.5
"""Time for which the scene is left alone after the motion [s]."""

DIVERGENCE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
"""Warnings of MuJoCo after which a simulation means nothing."""

NOMINAL = ExecutionConditions()
"""Conditions without noise."""


@dataclass(frozen=True, slots=True)
class Execution:
    """An executed motion."""

    report: ExecutionReport
    """What became of the plan."""

    time: Float[np.ndarray, " records"]
    """Times of the recorded states [s]."""

    qpos: Float[np.ndarray, "records nq"]
    """Recorded states: at the samples of the motion, and as often while the scene settles."""


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
    validate_fit(scene, actions, motion)
    layout = qpos_layout(scene)
    timeline = attachment_timeline(scene, actions, motion, operators)
    grips = grip_intervals(motion, timeline, layout)

    model = build_execution_model(scene, conditions)
    time = motion.step * np.arange(len(motion.time) + math.ceil(SETTLING / motion.step))
    commands = servo_commands(model, scene, motion, grips, conditions, float(time[-1]))
    # Without a handler, MuJoCo writes its warnings into a file in the working folder; here they end up in the report.
    mujoco.set_mju_user_warning(lambda warning: None)
    try:
        simulated = _simulate(model, commands, _first_state(motion, layout, conditions), time)
    finally:
        mujoco.set_mju_user_warning(None)

    states = simulated.states
    executed = ExecutedMotion(scene, motion, timeline, grips, layout, states, simulated.touches)
    report = ExecutionReport(
        succeeded=simulated.is_stable and goal_holds(scene, timeline, states[-1]),
        is_stable=simulated.is_stable,
        objects=_results(scene, layout, motion.qpos[-1], states[-1]),
        deviation=find_deviation(model, executed) if simulated.is_stable else None,
        duration=float(time[-1]),
    )
    return Execution(report, time, states)


@dataclass(frozen=True, slots=True)
class _Simulated:
    """What a simulation has recorded."""

    states: Float[np.ndarray, "records nq"]
    """The states at the wanted times."""

    touches: list[frozenset[tuple[int, int]]]
    """Pairs of bodies that touched since the record before, for each record."""

    is_stable: bool
    """False if the numbers diverged, upon which MuJoCo starts again from its own initial state."""


def _first_state(
    motion: Motion, layout: Layout, conditions: ExecutionConditions
) -> Float[np.ndarray, " nq"]:
    """Return the first state of a motion, with its objects displaced at random."""
    state = motion.qpos[0].copy()
    generator = np.random.default_rng(conditions.seed)
    noise = generator.normal(0.0, 1.0, (len(layout.objects), 2))
    state[layout.objects[:, :2]] += conditions.object_noise * noise
    return state


def _simulate(
    model: mujoco.MjModel,
    commands: ServoCommands,
    first_state: Float[np.ndarray, " nq"],
    time: Float[np.ndarray, " records"],
) -> _Simulated:
    """Simulate all steps.

    Args:
        model: The model.
        commands: Targets of the servos in each step.
        first_state: State at the first step.
        time: Times at which the state is recorded [s].
    """
    data = mujoco.MjData(model)
    data.qpos[:] = first_state
    record_steps = np.rint(time / model.opt.timestep).astype(int).tolist()
    states = np.empty((len(time), model.nq))
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
    return _Simulated(states, touches, not any(data.warning[kind].number for kind in DIVERGENCE))


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


def _results(
    scene: Scene,
    layout: Layout,
    planned: Float[np.ndarray, " nq"],
    reached: Float[np.ndarray, " nq"],
) -> tuple[ObjectResult, ...]:
    """Compare the objects at the end with the plan."""
    results = []
    for item, columns in zip(scene.objects, layout.objects, strict=True):
        distance, turn = differences(planned[None, columns], reached[None, columns])
        results.append(ObjectResult(item.name, float(distance[0]), float(turn[0])))
    return tuple(results)
