"""Solving lists of NLPs: a pool of lanes that are iterated together and filled again as they end.

The interface between search (lists of Python objects) and compiled code (stacked arrays). The result for one problem
does not depend on what else is in the list, but for the last digits of the augmented Lagrangian's value.
"""

from __future__ import annotations

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
from dvr_jax.runtime.threads import linear_algebra_on_one_thread
from dvr_jax.solver.augmented_lagrangian import Settings, SolverState, SolverStatus
from dvr_jax.solver.continuous_collision import (
    BETWEEN_TOLERANCE,
    EXCHANGES,
    PenetrationSamples,
    exchange_samples,
    sample_penetration,
)
from dvr_jax.solver.iteration import initial_states, iterate, lay_out_chunks, to_device
from dvr_jax.workcell.model import WorkcellModel

REFILL_FRACTION = 0.25
"""Fraction of a pool's lanes that have ended when new problems take their places."""


@dataclass(frozen=True, slots=True)
class NlpSolution:
    """Result of one NLP."""

    feasible: bool
    """Whether all violations are within their tolerances."""

    relative_violation: float
    """Largest violation as a multiple of its tolerance."""

    violations: dict[str, float]
    """Largest violation of each measure [m or rad]."""

    q: Float[np.ndarray, "slices joints"]
    """Joint angles [rad]."""

    m: Float[np.ndarray, "phases 4"]
    """Mode parameters."""

    iterations: int
    status: SolverStatus


class NlpTask(NamedTuple):
    """One NLP with its start."""

    problem: Problem
    start: Variables


@dataclass(slots=True)
class _LaneRecord:
    """What the host knows of one lane."""

    task: int | None
    """Number of the NLP that the lane solves; None for an idle lane."""

    exchanges: int = 0
    """How often its samples were moved."""

    earlier_iterations: int = 0
    """Iterations before the last exchange."""

    is_cleared: bool = False
    """Whether the motion between the samples of its solution was looked at and found free of collisions."""


def stack(trees: Sequence[Any]) -> Any:
    """Pytrees of NumPy arrays stacked along a new leading axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


@linear_algebra_on_one_thread()
def solve(
    model: WorkcellModel,
    problems: Sequence[Problem],
    starts: Sequence[Variables],
    settings: Settings,
) -> list[NlpSolution]:
    """Solve NLPs of one shape from one start each.

    A path whose motion penetrates between its samples goes on with other samples
    (`dvr_jax.solver.continuous_collision`); of one with samples at its slices alone nothing else is looked at.

    Args:
        model: Arms of the workcell that all problems share.
        problems: NLPs with the same numbers of phases, slices, samples, objects and fixed bodies.
        starts: A start for each.
        settings: Of the method.

    Raises:
        DvrError: Numbers have 32 bits, in which tolerances and penalties have no room.
    """
    if not problems:
        return []
    if not jax.config.values["jax_enable_x64"]:
        raise DvrError("the solver needs 64-bit numbers; call it under jax.enable_x64(True).")
    tasks = [NlpTask(problem, start) for problem, start in zip(problems, starts, strict=True)]
    return LanePool(model, tasks, settings).run()


class LanePool:
    """Lanes that solve a list of NLPs of one shape.

    All lanes are iterated together by compiled programs. Lanes that have ended are filled again once `REFILL_FRACTION`
    of them wait, so that slow ones hold nobody up.
    """

    def __init__(self, model: WorkcellModel, tasks: Sequence[NlpTask], settings: Settings) -> None:
        """Fill the lanes with the first tasks.

        Args:
            model: Arms of the workcell.
            tasks: NLPs of one shape with their starts.
            settings: Of the method.
        """
        T = len(tasks[0].start.q)
        K = len(tasks[0].start.m)
        is_path = T > K
        number = batch_sizes().path_lanes if is_path else max(batch_sizes().chunk // K, 1)
        self._model = model
        self._tasks = tasks
        self._checks_motion = is_path and tasks[0].problem.sample_fraction.shape[1] > 1
        self._settings = jax.tree.map(_as_array, settings)
        self._waiting = list(range(len(tasks)))[::-1]
        self._solutions: dict[int, NlpSolution] = {}
        self._lanes = [
            _LaneRecord(self._waiting.pop() if self._waiting else None) for _ in range(number)
        ]

        # Idle lanes hold a copy of the first problem and never run.
        filled = [tasks[lane.task or 0] for lane in self._lanes]
        self._problems: Problem = stack([task.problem for task in filled])
        self._states = initial_states(
            model, self._problems, stack([task.start for task in filled]), self._settings
        )
        idle = [lane.task is None for lane in self._lanes]
        self._states.status[:] = np.where(
            idle, int(SolverStatus.FEASIBLE), int(SolverStatus.RUNNING)
        )
        self._on_device, self._settings = to_device((self._problems, self._settings))
        self._chunks = lay_out_chunks(self._on_device, self._states.x)

    def run(self) -> list[NlpSolution]:
        """Iterate until every task has its solution; returns the solutions in the order of the tasks."""
        while len(self._solutions) < len(self._tasks):
            self._states, self._chunks = iterate(
                self._model, self._on_device, self._settings, self._states, self._chunks
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
        """Lanes that have a task and no longer run."""
        status = np.asarray(self._states.status)
        return [
            index
            for index, lane in enumerate(self._lanes)
            if lane.task is not None and status[index] != SolverStatus.RUNNING
        ]

    def _check_motions(self, ended: list[int]) -> list[int]:
        """Look between the samples of feasible paths, and let those that penetrate there go on with other samples.

        Args:
            ended: Lanes that no longer run.

        Returns:
            Those of them that have ended for good.
        """
        status = np.asarray(self._states.status)
        unchecked = [
            index
            for index in ended
            if status[index] == SolverStatus.FEASIBLE and not self._lanes[index].is_cleared
        ]
        if not unchecked:
            return ended

        samples = sample_penetration(self._model, self._on_device, self._states.x)
        # The arrays on the device cannot be written to.
        self._states = jax.tree.map(np.array, self._states)
        resumed = [index for index in unchecked if self._exchange(index, samples)]
        if resumed:
            moved = to_device((self._problems.sample_fraction, self._problems.sample_offset))
            self._on_device = self._on_device._replace(
                sample_fraction=moved[0], sample_offset=moved[1]
            )
            self._chunks = lay_out_chunks(self._on_device, _trial_points(self._states))
        return [index for index in ended if index not in resumed]

    def _exchange(self, index: int, samples: PenetrationSamples) -> bool:
        """Clear a lane's motion, or move its samples; returns whether the lane goes on.

        Args:
            index: The lane.
            samples: How deep all lanes' motions penetrate.
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
        self._problems.sample_fraction[index] = placed.sample_fraction
        self._problems.sample_offset[index] = placed.sample_offset
        _restart(self._states, index, float(self._settings.damping))
        return True

    def _collect(self, ended: list[int]) -> None:
        """Keep the solutions of lanes that have ended, and make the lanes idle or give them new tasks."""
        final = jax.tree.map(np.asarray, self._states)
        for index in ended:
            lane = self._lanes[index]
            assert lane.task is not None
            self._solutions[lane.task] = _solution(final, index, lane.earlier_iterations)
            self._lanes[index] = _LaneRecord(self._waiting.pop() if self._waiting else None)

    def _refill(self, lanes: list[int]) -> None:
        """Start the tasks that lanes have just been given."""
        filled = [index for index in lanes if self._lanes[index].task is not None]
        if not filled:
            return
        tasks = [self._tasks[self._lanes[index].task or 0] for index in filled]
        problems = stack([task.problem for task in tasks])
        starts = stack([task.start for task in tasks])
        self._states = jax.tree.map(np.array, self._states)
        _assign(self._problems, filled, problems)
        _assign(self._states, filled, initial_states(self._model, problems, starts, self._settings))
        self._on_device = to_device(self._problems)
        self._chunks = lay_out_chunks(self._on_device, _trial_points(self._states))


def _as_array(value: float) -> np.ndarray:
    """A setting as an array, whole numbers as such."""
    return np.asarray(value, float if isinstance(value, float) else np.int32)


def _trial_points(states: SolverState) -> Variables:
    return jax.tree.map(lambda x, step: np.asarray(x) + np.asarray(step), states.x, states.step)


def _restart(states: SolverState, index: int, damping: float) -> None:
    """Make a lane that has ended start again from its point, with its multipliers and penalty."""
    for step in states.step:
        step[index] = 0
    for value in (states.value, states.updated_violation, states.best_violation):
        value[index] = np.inf
    for count in (
        states.inner_iterations,
        states.updates_without_progress,
        states.iterations,
        states.restoration,
    ):
        count[index] = 0
    states.damping[index] = damping
    states.status[index] = SolverStatus.RUNNING


def _assign(target: Any, lanes: list[int], values: Any) -> None:
    """Overwrite some lanes of a tree of NumPy arrays."""
    for leaf, value in zip(jax.tree.leaves(target), jax.tree.leaves(values), strict=True):
        leaf[lanes] = value


def _solution(states: SolverState, index: int, earlier_iterations: int) -> NlpSolution:
    """The result of one lane."""
    violations = {name: value[index] for name, value in states.report.items()}
    return NlpSolution(
        feasible=bool(states.status[index] == SolverStatus.FEASIBLE),
        relative_violation=float(relative_violation(violations)),
        violations={name: float(value) for name, value in violations.items()},
        q=np.array(states.x.q[index]),
        m=np.array(states.x.m[index]),
        iterations=earlier_iterations + int(states.iterations[index]),
        status=SolverStatus(int(states.status[index])),
    )
