"""One iteration of the augmented-Lagrangian method on many NLPs of the same shape at once, one lane each.

Every lane carries a status; nothing is raised under jit, and a lane that has ended no longer changes. An iteration is
two compiled programs: `measure_chunk` does the geometry, whose compilation is expensive, for chunks of few sizes, of
slices of any problem with the same numbers of objects; `step` does the rest and is compiled for each horizon.
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
from dvr_jax.solver.augmented_lagrangian import (
    RestorationPhase,
    Settings,
    SolverState,
    SolverStatus,
    TrialUpdate,
    judge_trial,
    next_trial,
    trial_point,
)
from dvr_jax.solver.banded import solve_bordered
from dvr_jax.workcell.model import WorkcellModel


class TrialEvaluation(NamedTuple):
    """What is known of all lanes' trial points between `evaluate_trials` and `advance`."""

    update: TrialUpdate
    jacobians: dict[str, Any]
    """Derivatives of each block's rows, by block name."""

    violations: Violations


class ActiveCollisions(NamedTuple):
    """Which distances of one chunk of slices are active."""

    multiplier_estimate: Array
    """Derivative of the Lagrangian by each distance (L, P)."""

    active_penalty: Array
    """Penalty of each distance where it is active, else 0 (L, P)."""


def initial_states(
    model: WorkcellModel, problems: Problem, x: Variables, settings: Settings
) -> SolverState:
    """NumPy lanes of a batch of NLPs before their first iteration.

    Systems are placeholders: the first trial point is always accepted, and its system takes their place.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        x: Their starts.
        settings: Of the method.
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
    """Size of the chunks that so many slices are cut into: a multiple of the smallest, so that few are compiled."""
    sizes = batch_sizes()
    pieces = -(-slices // sizes.largest_chunk)
    return sizes.chunk * -(-slices // (pieces * sizes.chunk))


def cut_into_chunks(slices: Slices) -> tuple[Slices, ...]:
    """Cut slices into chunks of one size; the last one is filled up with copies."""
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


def _lay_out_chunks(problems: Problem, x: Variables) -> tuple[Slices, ...]:
    """Slices of a point of all problems, in chunks."""
    return cut_into_chunks(lay_out(problems, x))


lay_out_chunks = Program(_lay_out_chunks)


def _identity(tree: Any) -> Any:
    return tree


to_device: Callable[[Any], Any] = Program(_identity)
"""A tree of NumPy arrays as JAX arrays: a compiled program takes a third of the time of `jax.device_put`."""


def _joined(chunks: Sequence[Array], length: int, axis: int) -> Array:
    return jax.lax.slice_in_dim(jnp.concatenate(chunks, axis=axis), 0, length, axis=axis)


def evaluate_trials(
    model: WorkcellModel,
    problems: Problem,
    settings: Settings,
    states: SolverState,
    chunks: tuple[SliceGeometry, ...],
) -> tuple[TrialEvaluation, tuple[ActiveCollisions, ...]]:
    """Judge all lanes' trial points.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Of the method.
        states: The lanes.
        chunks: Geometry of the slices of their trial points.

    Returns:
        What is known of the trial points, and the active distances of each chunk.
    """
    trial = trial_point(states)
    horizon = horizon_of(model, problems, trial)
    evaluations = materialize(
        evaluate_constraints(model, problems, trial, _join_chunks(states, chunks))
    )
    violations = violations_of(evaluations)
    rows = jax.vmap(flatten)({name: evaluation.rows for name, evaluation in evaluations.items()})
    costs = jax.vmap(cost)(problems, trial)
    scales = row_scales(horizon, trial.q.dtype)

    def judge_lane(
        state: SolverState, cost: Array, rows: FlatResiduals, violation: Array
    ) -> TrialUpdate:
        return judge_trial(settings, state, cost, rows, scales, EQUALITIES, violation)

    update = jax.vmap(judge_lane)(states, costs, rows, relative_violation(violations))
    jacobians = {name: evaluation.jacobian for name, evaluation in evaluations.items()}
    return TrialEvaluation(update, jacobians, violations), _cut_collisions(update, len(chunks))


def _join_chunks(states: SolverState, chunks: tuple[SliceGeometry, ...]) -> SliceGeometry:
    """Distances, hands and screws of all slices; the other fields are those of the first chunk and not to be used."""
    L = states.multipliers[0].shape[0] * states.multipliers[0].shape[1]

    def join(pick: Callable[[SliceGeometry], Array], axis: int) -> Array:
        return _joined([pick(chunk) for chunk in chunks], L, axis)

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
    """Multiplier estimates and active penalties of the distances, in as many chunks as the slices."""
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
    """Take a step in every lane that runs.

    Args:
        problems: A batch of problems.
        settings: Of the method.
        states: The lanes.
        trials: What is known of their trial points.
        chunks: Sums of the active distances of each chunk of slices.
        horizon: Sizes of the NLPs.

    Returns:
        The lanes, and the slices of their next trial points in chunks.
    """
    B, samples = states.multipliers[0].shape[:2]

    def by_problem(*leaves: Array) -> Array:
        return _joined(leaves, B * samples, 0).reshape(B, samples, *leaves[0].shape[1:])

    distances = jax.tree.map(by_problem, *chunks)

    def advance_lane(
        problem: Problem, state: SolverState, trial: TrialEvaluation, distances: NormalEquations
    ) -> SolverState:
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
        return jnp.where(is_running.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    states = materialize(jax.tree.map(choose, new, states))
    return states, _lay_out_chunks(problems, trial_point(states))


def _solve(system: BorderedSystem, damping: Array) -> Variables:
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
    """Do what follows the measuring of all chunks: the rest of an iteration in one program.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Of the method.
        states: The lanes.
        chunks: Geometry of the slices of their trial points.
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


def iterate(
    model: WorkcellModel,
    problems: Problem,
    settings: Settings,
    states: SolverState,
    chunks: tuple[Slices, ...],
) -> tuple[SolverState, tuple[Slices, ...]]:
    """Do one iteration of a batch: compiled programs, called one after the other.

    Args:
        model: Arms of the workcell.
        problems: A batch of problems.
        settings: Of the method.
        states: The lanes.
        chunks: Slices of the trial points (`lay_out_chunks`).
    """
    return step(
        model, problems, settings, states, tuple(measure_chunk(model, chunk) for chunk in chunks)
    )


__all__ = [
    "ActiveCollisions",
    "Evaluations",
    "TrialEvaluation",
    "advance",
    "cut_into_chunks",
    "evaluate_trials",
    "initial_states",
    "iterate",
    "lay_out_chunks",
    "measure_chunk",
    "step",
    "to_device",
]
