"""One iteration of the augmented Lagrangian method on a batch of NLPs of the same shape, with one lane for each NLP.

Every lane has a status. A lane that has ended no longer changes, and no exceptions are raised in compiled code. An
iteration consists of two compiled programs:

- `measure_chunk` computes the geometry. Its compilation is expensive, so the slices of all lanes are concatenated and
  cut into *chunks* of a few sizes, for which it is compiled. It serves all problems with the same number of objects.
- `step` does everything else: it judges the trial points, assembles and solves the Gauss-Newton systems, and returns
  the slices of the next trial points. It is compiled for each combination of numbers of slices, phases and samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks import COLLISION, Horizon
from dvr_jax.nlp.cost import cost
from dvr_jax.nlp.evaluation import (
    EQUALITIES,
    TOLERANCES,
    Evaluations,
    FlatResiduals,
    Violations,
    evaluate_constraints,
    flatten,
    gauss_newton_system,
    horizon_of,
    number_of_flat_rows,
    relative_violation,
    row_scales,
    unflatten,
    violations_of,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import NormalEquations, SliceGeometry, Slices, measure, reduce_slices
from dvr_jax.nlp.system import BorderedSystem
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import Program
from dvr_jax.solver.augmented_lagrangian import judge_trial, next_trial, trial_point
from dvr_jax.solver.banded import solve_bordered
from dvr_jax.solver.state import RestorationPhase, Settings, SolverState, SolverStatus, TrialUpdate
from dvr_jax.workcell.model import WorkcellModel

RESTARTED = (
    "step",
    "damping",
    "value",
    "report",
    "updated_violation",
    "best_violation",
    "inner_iterations",
    "updates_without_progress",
    "iterations",
    "restoration",
    "status",
)
"""Fields of `SolverState` that change when a lane is restarted or ends at the limit of its restarts."""


class TrialEvaluation(NamedTuple):
    """Results of `evaluate_trials` for all lanes' trial points, which `advance` needs."""

    update: TrialUpdate
    """Whether each trial point is accepted, and the multipliers after it."""

    jacobians: dict[str, Any]
    """Derivatives of each block's rows, by block name."""

    violations: Violations
    """Largest violation of each measure at each trial point."""


class ActiveCollisions(NamedTuple):
    """Multiplier estimates and active penalties of the P distances of each of the L slices of one chunk."""

    multiplier_estimate: Array
    """Derivative of the augmented Lagrangian by each row -distance (L, P)."""

    active_penalty: Array
    """Penalty of each row where it is active, else 0 (L, P)."""


def initial_states(
    model: WorkcellModel, problems: Problem, x: Variables, settings: Settings
) -> SolverState:
    """Return the states of lanes before their first iteration, as NumPy arrays.

    The systems are placeholders, because the first trial point (the start itself) is always accepted and its system
    replaces them.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        x: Starting points of the problems.
        settings: Settings of the method.
    """
    B, T, D = x.q.shape
    dtype = x.q.dtype
    horizon = horizon_of(model, problems, x)
    M = PARAMETERS * horizon.phases

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((B, *shape), dtype)

    infinity = np.full(B, np.inf, dtype)
    count = np.zeros(B, np.int32)
    return SolverState(
        x=x,
        step=Variables(np.zeros_like(x.q), np.zeros_like(x.m)),
        multipliers=tuple(zeros(*shape) for shape in number_of_flat_rows(horizon)),
        penalty=np.full(B, settings.penalty, dtype),
        damping=np.full(B, settings.damping, dtype),
        value=infinity,
        system=BorderedSystem(
            diagonal=zeros(T, D, D),
            coupling=zeros(T, D, D) if horizon.is_path else None,
            far_coupling=zeros(T, D) if horizon.is_path else None,
            border=zeros(T, D, M),
            corner=zeros(M, M),
            gradient_q=zeros(T, D),
            gradient_m=zeros(M),
        ),
        report=dict.fromkeys(TOLERANCES, infinity),
        updated_violation=infinity,
        best_violation=infinity,
        inner_iterations=count,
        updates_without_progress=count,
        iterations=count,
        restoration=count.copy(),
        status=count.copy(),
    )


def _chunk_size(slices: int) -> int:
    """Return the chunk size for a number of slices: a multiple of the smallest size, so that few are compiled."""
    sizes = batch_sizes()
    pieces = -(-slices // sizes.largest_chunk)
    return sizes.chunk * -(-slices // (pieces * sizes.chunk))


def cut_into_chunks(slices: Slices) -> tuple[Slices, ...]:
    """Cut slices into chunks of one size; the last chunk is padded with copies of the last slice."""
    L = slices.q.shape[-1]
    size = _chunk_size(L)
    fill = [(0, -L % size)]

    def pad(value: Array) -> Array:
        return jnp.pad(value, [(0, 0)] * (value.ndim - 1) + fill, mode="edge")

    padded = jax.tree.map(pad, slices)
    return tuple(
        jax.tree.map(lambda value, first=first: value[..., first : first + size], padded)
        for first in range(0, L, size)
    )


measure_chunk = Program(measure)
"""Compiled program of `dvr_jax.nlp.slices.measure`, which computes the geometry of one chunk of slices."""


def _lay_out_chunks(problems: Problem, x: Variables) -> tuple[Slices, ...]:
    """Return the slices of the points x of all problems, cut into chunks."""
    return cut_into_chunks(lay_out(problems, x))


lay_out_chunks = Program(_lay_out_chunks)
"""Compiled program that returns the slices of the points x of all problems, cut into chunks."""


def _joined(chunks: Sequence[Array], length: int, axis: int) -> Array:
    """Concatenate chunks along an axis, and remove the padding behind the given length."""
    return jax.lax.slice_in_dim(jnp.concatenate(chunks, axis=axis), 0, length, axis=axis)


def evaluate_trials(
    model: WorkcellModel,
    problems: Problem,
    settings: Settings,
    states: SolverState,
    chunks: tuple[SliceGeometry, ...],
) -> tuple[TrialEvaluation, tuple[ActiveCollisions, ...]]:
    """Evaluate constraints and costs at all lanes' trial points, and judge the trial points.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        chunks: Geometry of the slices of their trial points.

    Returns:
        The evaluation of the trial points, and the active distances of each chunk.
    """
    trial = trial_point(states)
    horizon = horizon_of(model, problems, trial)
    slices = len(trial.q) * horizon.slices * horizon.samples
    evaluations = materialize(
        evaluate_constraints(model, problems, trial, join_chunks(chunks, slices))
    )
    violations = violations_of(evaluations)
    rows = jax.vmap(flatten)({name: evaluation.rows for name, evaluation in evaluations.items()})
    costs = jax.vmap(cost)(problems, trial)
    scales = row_scales(horizon, trial.q.dtype)

    def judge_lane(
        state: SolverState, cost: Array, rows: FlatResiduals, violation: Array
    ) -> TrialUpdate:
        """Judge the trial point of one lane."""
        return judge_trial(settings, state, cost, rows, scales, EQUALITIES, violation)

    update = jax.vmap(judge_lane)(states, costs, rows, relative_violation(violations))
    jacobians = {name: evaluation.jacobian for name, evaluation in evaluations.items()}
    return TrialEvaluation(update, jacobians, violations), _cut_collisions(update, len(chunks))


def join_chunks(chunks: Sequence[SliceGeometry], slices: int) -> SliceGeometry:
    """Concatenate distances, hands and screws of all chunks; the other fields of the result must not be used.

    Args:
        chunks: Geometry of the slices, in chunks of one size.
        slices: Number of slices without the padding of the last chunk.
    """

    def join(pick: Callable[[SliceGeometry], Array], axis: int) -> Array:
        """Concatenate one field of all chunks."""
        return _joined([pick(chunk) for chunk in chunks], slices, axis)

    hands = chunks[0].hands._replace(
        rotation=join(lambda chunk: chunk.hands.rotation, -1),
        position=join(lambda chunk: chunk.hands.position, -1),
    )
    return chunks[0]._replace(
        distance=join(lambda chunk: chunk.distance, 0),
        hands=hands,
        screws=join(lambda chunk: chunk.screws, -1),
    )


def _cut_collisions(update: TrialUpdate, number: int) -> tuple[ActiveCollisions, ...]:
    """Return multiplier estimates and active penalties of the distances, cut into the same chunks as the slices."""
    # Index 0 stands for the distances (`FlatResiduals.collision`).
    pieces = []
    for value in (update.multiplier_estimate[0], update.active_penalty[0]):
        flat = value.reshape(-1, value.shape[-1])
        padded = jnp.pad(flat, [(0, -len(flat) % _chunk_size(len(flat))), (0, 0)])
        pieces.append(jnp.split(padded, number))
    return tuple(ActiveCollisions(*piece) for piece in zip(*pieces, strict=True))


def advance(
    problems: Problem,
    settings: Settings,
    states: SolverState,
    trials: TrialEvaluation,
    chunks: tuple[NormalEquations, ...],
    horizon: Horizon,
) -> tuple[SolverState, tuple[Slices, ...]]:
    """Assemble and solve the Gauss-Newton system of every running lane, which gives its next trial point.

    Args:
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        trials: Evaluation of their trial points.
        chunks: Contributions of the active distances of each chunk of slices to the systems.
        horizon: Sizes of the NLPs.

    Returns:
        The new states, and the slices of the next trial points, cut into chunks.
    """
    # The first array of the multipliers belongs to the distances (`FlatResiduals.collision`).
    B, samples = states.multipliers[0].shape[:2]

    def by_problem(*leaves: Array) -> Array:
        """Concatenate chunks of arrays and divide the result by problems: (B, samples, ...)."""
        return _joined(leaves, B * samples, 0).reshape(B, samples, *leaves[0].shape[1:])

    distances = jax.tree.map(by_problem, *chunks)

    def advance_lane(
        problem: Problem, state: SolverState, trial: TrialEvaluation, distances: NormalEquations
    ) -> SolverState:
        """Compute the next state of one lane."""
        update = trial.update
        restoring = update.restoration == RestorationPhase.DURING
        system = gauss_newton_system(
            problem,
            trial_point(state),
            {**trial.jacobians, COLLISION.name: distances},
            unflatten(FlatResiduals(*update.multiplier_estimate), horizon),
            unflatten(FlatResiduals(*update.active_penalty), horizon),
            gradient_scale=jnp.where(restoring, 0.0, 1.0),
        )
        return next_trial(settings, state, update, system, trial.violations, _solve)

    new = jax.vmap(advance_lane)(problems, states, trials, distances)
    is_running = states.status == SolverStatus.RUNNING

    def choose(new: Array, old: Array) -> Array:
        """Return the new values of running lanes and the old values of all others."""
        return jnp.where(is_running.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    states = materialize(jax.tree.map(choose, new, states))
    return states, _lay_out_chunks(problems, trial_point(states))


def _solve(system: BorderedSystem, damping: Array) -> Variables:
    """Return the step that solves a system with damping on its diagonal."""
    dq, dm = solve_bordered(system, damping)
    return Variables(dq, dm.reshape(-1, PARAMETERS))


@Program
def step(
    model: WorkcellModel,
    problems: Problem,
    settings: Settings,
    states: SolverState,
    chunks: tuple[SliceGeometry, ...],
) -> tuple[SolverState, tuple[Slices, ...]]:
    """Do the part of an iteration that follows the computation of the geometry, in one compiled program.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Settings of the method.
        states: States of the lanes.
        chunks: Geometry of the slices of their trial points.

    Returns:
        The new states, and the slices of the next trial points, cut into chunks.
    """
    trials, active = materialize(evaluate_trials(model, problems, settings, states, chunks))
    reduced = materialize(
        tuple(
            reduce_slices(model, chunk, collisions.multiplier_estimate, collisions.active_penalty)
            for chunk, collisions in zip(chunks, active, strict=True)
        )
    )
    return advance(
        problems, settings, states, trials, reduced, horizon_of(model, problems, states.x)
    )


def restart(states: SolverState, index: int, settings: Settings) -> None:
    """Start a lane that has ended again from its point; it keeps its multipliers and its penalty.

    Args:
        states: States of the lanes, of which the fields `RESTARTED` are changed in place.
        index: Index of the lane.
        settings: Settings of the method.
    """
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
    states.damping[index] = float(settings.damping)
    states.status[index] = SolverStatus.RUNNING


__all__ = [
    "RESTARTED",
    "ActiveCollisions",
    "Evaluations",
    "TrialEvaluation",
    "advance",
    "cut_into_chunks",
    "evaluate_trials",
    "initial_states",
    "join_chunks",
    "lay_out_chunks",
    "measure_chunk",
    "restart",
    "step",
]
