"""A pool of lanes solves a list of NLPs; the lanes are iterated together, and a lane that ends gets the next NLP.

A *lane* is one entry of the solver's batch and holds one NLP at a time. This module is the interface between the
search, which works on lists of Python objects, and compiled code, which works on stacked arrays. The result of one NLP
does not depend on the other NLPs in the list, except for the last digits of the augmented Lagrangian's value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from dvr_jax.errors import DvrError
from dvr_jax.nlp.evaluation import relative_violation
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import to_device
from dvr_jax.runtime.threads import linear_algebra_on_one_thread
from dvr_jax.solver import iteration, sequential_iteration
from dvr_jax.solver.continuous_collision import (
    BETWEEN_TOLERANCE,
    EXCHANGES,
    PenetrationSamples,
    exchange_samples,
    raised_clearance,
    sample_penetration,
)
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk
from dvr_jax.solver.padding import missing_phases, pad_keyframes
from dvr_jax.solver.sequential import LaneState, SequentialSettings
from dvr_jax.solver.state import Settings, SolverState, SolverStatus
from dvr_jax.workcell.model import WorkcellModel

REFILL_FRACTION = 0.25
"""Ended lanes get new NLPs as soon as they make up this fraction of all lanes."""

EXCHANGED = ("sample_fraction", "sample_offset", "clearance")
"""Fields of `Problem` that change where samples of a lane are moved."""

FOUND = (SolverStatus.FEASIBLE, SolverStatus.OPTIMAL)
"""Statuses of lanes that have ended at a feasible point."""


AnySettings = Settings | SequentialSettings
"""Settings of a method. Their type tells which method solves an NLP: the augmented Lagrangian method leads to a
feasible point, sequential quadratic programming from a feasible path to an optimal one."""

AnyState = SolverState | LaneState
"""States of all lanes."""


@dataclass(frozen=True, slots=True)
class NlpSolution:
    """Result of one NLP."""

    feasible: bool
    """Whether all violations are within their tolerances (for a path, also between its samples)."""

    relative_violation: float
    """Largest violation as a multiple of its tolerance."""

    violations: dict[str, float]
    """Largest violation of each measure of the constraint blocks [m or rad], by the measure's name."""

    q: Float[np.ndarray, "slices joints"]
    """Joint angles [rad]."""

    m: Float[np.ndarray, "phases 4"]
    """Mode parameters of each action [m or rad]."""

    kkt_residual: float
    """KKT residual (`dvr_jax.solver.sequential`); infinite if it is not known."""

    iterations: int
    """Number of iterations."""

    status: SolverStatus
    """Why the iterations ended."""


class NlpTask(NamedTuple):
    """One NLP and the point from which it is solved."""

    problem: Problem
    """The NLP, without batch axes."""

    start: Variables
    """The starting point."""


@dataclass(slots=True)
class _LaneRecord:
    """Data about one lane that is not part of the solver's state."""

    task: int | None
    """Index of the NLP that the lane solves; None for an idle lane."""

    exchanges: int = 0
    """Number of times that samples of the NLP were moved (`dvr_jax.solver.continuous_collision`)."""

    earlier_iterations: int = 0
    """Number of iterations before the samples were moved for the last time."""

    is_cleared: bool = False
    """Whether the motion between the samples of the solution was examined and found free of collisions."""


def stack(trees: Sequence[Any]) -> Any:
    """Stack pytrees of NumPy arrays along a new leading axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


@linear_algebra_on_one_thread()
def solve(
    model: WorkcellModel,
    problems: Sequence[Problem],
    starts: Sequence[Variables],
    settings: AnySettings,
) -> list[NlpSolution]:
    """Solve NLPs of one shape, each from one start.

    If the motion of a feasible path penetrates between its samples, samples are moved there and the optimization
    continues (`dvr_jax.solver.continuous_collision`). Paths whose only samples are their slices are not examined.

    Args:
        model: Arms of the workcell that all problems share.
        problems: NLPs with the same numbers of phases, slices, samples, objects and fixed bodies.
        starts: A starting point for each NLP.
        settings: Settings of the method; their type decides which method is used.

    Returns:
        The solutions, in the order of the problems.

    Raises:
        DvrError: JAX uses 32-bit numbers, which are too imprecise for the tolerances and penalties.
    """
    if not problems:
        return []
    if not jax.config.read("jax_enable_x64"):
        raise DvrError("the solver needs 64-bit numbers; call it under jax.enable_x64(True).")
    tasks = [NlpTask(problem, start) for problem, start in zip(problems, starts, strict=True)]
    return LanePool(model, tasks, settings).run()


class LanePool:
    """Lanes that solve a list of NLPs of one shape.

    All lanes are iterated together by compiled programs. Lanes that have ended get new tasks as soon as they make up
    the fraction `REFILL_FRACTION` of all lanes, so that slow lanes do not delay the other tasks.
    """

    def __init__(
        self, model: WorkcellModel, tasks: Sequence[NlpTask], settings: AnySettings
    ) -> None:
        """Fill the lanes with the first tasks.

        Args:
            model: Arms of the workcell.
            tasks: NLPs of one shape with their starts.
            settings: Settings of the method.
        """
        is_path = len(tasks[0].start.q) > len(tasks[0].start.m)
        self._added_phases = 0
        if not is_path:
            # Few sizes of keyframe NLPs are compiled.
            self._added_phases = missing_phases(len(tasks[0].start.m))
            tasks = [NlpTask(*pad_keyframes(*task)) for task in tasks]

        # The pool has as many lanes as give one call of the compiled programs enough slices.
        K = len(tasks[0].start.m)
        number = batch_sizes().path_lanes if is_path else max(batch_sizes().chunk // K, 1)
        self._tasks = tasks
        self._checks_motion = is_path and tasks[0].problem.sample_fraction.shape[1] > 1
        self._settings = jax.tree.map(_as_array, settings)
        self._method = _method_of(settings)
        self._waiting = list(range(len(tasks)))[::-1]
        self._solutions: dict[int, NlpSolution] = {}
        self._lanes = [
            _LaneRecord(self._waiting.pop() if self._waiting else None) for _ in range(number)
        ]

        # Idle lanes hold a copy of the first problem, and their status keeps them from being iterated.
        filled = [tasks[lane.task or 0] for lane in self._lanes]
        self._problems: Problem = stack([task.problem for task in filled])
        self._states: AnyState = self._method.initial_states(
            model, self._problems, stack([task.start for task in filled]), self._settings
        )
        idle = [lane.task is None for lane in self._lanes]
        self._states.status[:] = np.where(
            idle, int(SolverStatus.FEASIBLE), int(SolverStatus.RUNNING)
        )
        self._model, self._on_device, self._settings = to_device(
            (model, self._problems, self._settings)
        )
        self._wanted_clearance = self._clearances_of_tasks()
        self._chunks = lay_out_chunks(self._on_device, self._states.x)

    def prepare(self) -> None:
        """Load or compile the programs of an iteration, the larger one first, without carrying one out."""
        geometry = tuple(
            measure_chunk.shapes_of_result(self._model, chunk) for chunk in self._chunks
        )
        self._method.step.prepare(
            self._model, self._on_device, self._settings, self._states, geometry
        )
        measure_chunk.prepare(self._model, self._chunks[0])

    def _clearances_of_tasks(self) -> jax.Array:
        """Return the clearances of all lanes, without those that were raised (`raised_clearance`)."""
        original = [self._tasks[lane.task or 0].problem.clearance for lane in self._lanes]
        return to_device(np.stack(original))

    def run(self) -> list[NlpSolution]:
        """Iterate until every task has a solution, and return the solutions in the order of the tasks."""
        while len(self._solutions) < len(self._tasks):
            geometry = tuple(measure_chunk(self._model, chunk) for chunk in self._chunks)
            self._states, self._chunks = self._method.step(
                self._model, self._on_device, self._settings, self._states, geometry
            )
            ended = self._ended_lanes()
            if self._checks_motion:
                ended = self._check_motions(ended)
            running = sum(lane.task is not None for lane in self._lanes) - len(ended)
            if ended and (not running or len(ended) >= REFILL_FRACTION * len(self._lanes)):
                self._collect(ended)
                self._refill(ended)
        return [self._solutions[task] for task in range(len(self._tasks))]

    def _ended_lanes(self) -> list[int]:
        """Return the indices of lanes that have a task and are no longer iterated."""
        status = np.asarray(self._states.status)
        return [
            index
            for index, lane in enumerate(self._lanes)
            if lane.task is not None and status[index] != SolverStatus.RUNNING
        ]

    def _check_motions(self, ended: list[int]) -> list[int]:
        """Examine feasible paths between their samples, and resume those that penetrate there with moved samples.

        Args:
            ended: Lanes that are no longer iterated.

        Returns:
            Those of them that are not resumed.
        """
        status = np.asarray(self._states.status)
        unchecked = [
            index for index in ended if status[index] in FOUND and not self._lanes[index].is_cleared
        ]
        if not unchecked:
            return ended

        examined = self._on_device._replace(clearance=self._wanted_clearance)
        samples = sample_penetration(self._model, examined, self._states.x)
        # JAX arrays cannot be changed in place, so what a restart changes is copied to NumPy arrays. The Gauss-Newton
        # systems, which are large, stay where they are.
        self._states = _copy_to_host(self._states, self._method.RESTARTED)
        resumed = [index for index in unchecked if self._exchange(index, samples)]
        if resumed:
            changed = {name: getattr(self._problems, name) for name in EXCHANGED}
            self._on_device = self._on_device._replace(**to_device(changed))
            self._chunks = lay_out_chunks(self._on_device, _trial_points(self._states))
        return [index for index in ended if index not in resumed]

    def _exchange(self, index: int, samples: PenetrationSamples) -> bool:
        """Move a lane's samples if its motion penetrates too deeply between them.

        After `EXCHANGES` moves the lane ends without a feasible path.

        Args:
            index: Index of the lane.
            samples: Penetration depths of the motions of all lanes.

        Returns:
            Whether the lane is iterated again.
        """
        lane = self._lanes[index]
        depth = float(samples.depth[index].max())
        lane.is_cleared = depth <= BETWEEN_TOLERANCE
        if lane.is_cleared:
            return False
        if lane.exchanges == EXCHANGES:
            self._states.report["penetration"][index] = depth
            self._states.status[index] = SolverStatus.ITERATION_LIMIT
            return False

        lane.exchanges += 1
        lane.earlier_iterations += int(self._states.iterations[index])
        problem = jax.tree.map(lambda leaf: leaf[index], self._problems)
        q = np.asarray(self._states.x.q)[index]
        placed = exchange_samples(problem, q, samples.fraction[index], samples.depth[index])
        if isinstance(self._settings, SequentialSettings):
            raised = raised_clearance(problem.clearance, samples.depth[index])
            placed = placed._replace(clearance=raised)
        for name in EXCHANGED:
            getattr(self._problems, name)[index] = getattr(placed, name)
        self._method.restart(self._states, index, self._settings)
        return True

    def _collect(self, ended: list[int]) -> None:
        """Store the solutions of lanes that have ended, and give the lanes new tasks or make them idle."""
        final = _copy_to_host(self._states, ("x", "report", "iterations", "status"))
        for index in ended:
            lane = self._lanes[index]
            assert lane.task is not None
            self._solutions[lane.task] = _solution(
                final, index, lane.earlier_iterations, self._added_phases
            )
            self._lanes[index] = _LaneRecord(self._waiting.pop() if self._waiting else None)

    def _refill(self, lanes: list[int]) -> None:
        """Copy the new tasks of lanes into the stacked arrays, and set the lanes to the tasks' starting points."""
        filled = [index for index in lanes if self._lanes[index].task is not None]
        if not filled:
            return
        tasks = [self._tasks[self._lanes[index].task or 0] for index in filled]
        problems = stack([task.problem for task in tasks])
        starts = stack([task.start for task in tasks])
        self._states = jax.tree.map(np.array, self._states)
        _assign(self._problems, filled, problems)
        states = self._method.initial_states(self._model, problems, starts, self._settings)
        _assign(self._states, filled, states)
        self._on_device = to_device(self._problems)
        self._wanted_clearance = self._clearances_of_tasks()
        self._chunks = lay_out_chunks(self._on_device, _trial_points(self._states))


def _method_of(settings: AnySettings) -> Any:
    """Return the module that iterates lanes with these settings."""
    return sequential_iteration if isinstance(settings, SequentialSettings) else iteration


def _as_array(value: float) -> np.ndarray:
    """Return a setting as an array: floats with 64 bits, integers with 32 bits."""
    return np.asarray(value, float if isinstance(value, float) else np.int32)


def _copy_to_host(states: AnyState, names: Sequence[str]) -> AnyState:
    """Return the states with the named fields as NumPy arrays that can be changed in place."""
    copies = {name: jax.tree.map(np.array, getattr(states, name)) for name in names}
    return states._replace(**copies)


def _trial_points(states: AnyState) -> Variables:
    """Return the trial points of all lanes, computed on the host."""
    return jax.tree.map(lambda x, step: np.asarray(x) + np.asarray(step), states.x, states.step)


def _assign(target: Any, lanes: list[int], values: Any) -> None:
    """Overwrite some lanes of a pytree of NumPy arrays, in place."""
    for leaf, value in zip(jax.tree.leaves(target), jax.tree.leaves(values), strict=True):
        leaf[lanes] = value


def _solution(
    states: AnyState, index: int, earlier_iterations: int, added_phases: int
) -> NlpSolution:
    """Return the solution of the NLP that a lane has solved.

    Args:
        states: States of all lanes.
        index: Index of the lane.
        earlier_iterations: Number of iterations before the samples were moved for the last time.
        added_phases: Number of phases that were put before those of the NLP.
    """
    violations = {name: value[index] for name, value in states.report.items()}
    residual = states.kkt_residual[index] if isinstance(states, LaneState) else math.inf
    return NlpSolution(
        feasible=bool(states.status[index] in FOUND),
        relative_violation=float(relative_violation(violations)),
        violations={name: float(value) for name, value in violations.items()},
        q=np.array(states.x.q[index][added_phases:]),
        m=np.array(states.x.m[index][added_phases:]),
        kkt_residual=float(residual),
        iterations=earlier_iterations + int(states.iterations[index]),
        status=SolverStatus(int(states.status[index])),
    )
