"""Augmented-Lagrangian Gauss-Newton: many NLPs of the same shape at once, one lane each.

One iteration measures the trial point, accepts it if the augmented Lagrangian fell (else the damping grows), and
solves the banded Gauss-Newton system for the next trial point. When the steps of a subproblem have become small,
multipliers are updated and the penalty grows if the violation did not fall enough. Every lane carries a status;
nothing is raised under jit, and a lane that has ended no longer changes.

An iteration is four compiled programs: `measure_chunk` and `reduce_chunk` do the geometry, whose compilation is dear,
for `CHUNK` slices of any problem with the same number of objects; `judge` and `advance` are small and compiled for
each horizon."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.compilation import Program
from dvr_jax.geometry.vectors import Rotation, Vector, materialize
from dvr_jax.komo.banded import BorderedSystem, solve_bordered
from dvr_jax.komo.constraints import Rows, Slopes, collect, lay_out, samples_of
from dvr_jax.komo.contacts import number_of_rows
from dvr_jax.komo.lagrangian import (
    Multipliers,
    Residuals,
    Weights,
    augmented_value,
    forces,
    gauss_newton_system,
    penalties,
    residuals,
    update_multipliers,
)
from dvr_jax.komo.problem import PARAMETERS, Problem, Variables
from dvr_jax.komo.slices import Measured, Reduced, Slices, measure, reduce_slices
from dvr_jax.komo.verdict import Violations, measure_violations

CHUNK = 60
"""Slices that one call measures: keyframes of 1 to 6 actions and paths of 2, 4 and 6 fill it without a rest."""

RUNNING, FEASIBLE, STAGNATED, ITERATION_LIMIT, NUMERICAL_FAILURE = 0, 1, 2, 3, 4
"""Status of a lane. Only FEASIBLE says that the verdict's tolerances hold."""

STATUS_WORDS = {
    RUNNING: "running",
    FEASIBLE: "feasible",
    STAGNATED: "infeasible: violation stagnated",
    ITERATION_LIMIT: "infeasible: iteration limit",
    NUMERICAL_FAILURE: "infeasible: numerical failure",
}


class Settings(NamedTuple):
    """Settings of the solver; numbers, so that changing one needs no new compilation."""

    weights: Weights = Weights()
    penalty: float = 1e4
    """Initial penalty [1/m^2]."""
    penalty_growth: float = 5.0
    """Factor of the penalty where the violation did not fall to `sufficient_decrease` of its last value."""
    penalty_limit: float = 1e7
    sufficient_decrease: float = 0.5
    step_limit: float = 0.3
    """Largest change of one joint in one iteration [rad]; the whole step is scaled."""
    step_tolerance: float = 1e-2
    """A subproblem has ended when no joint moved more than this [rad] ..."""
    inner_limit: int = 6
    """... or after so many iterations."""
    damping: float = 1e-3
    """Initial damping, added to the diagonal."""
    damping_limit: float = 1e4
    final_step: float = 1e-1
    """A feasible lane ends when its last accepted step was no longer than this [rad]."""
    iteration_limit: int = 30
    patience: int = 5
    """A lane stagnates after so many multiplier updates in a row without a violation 10 % below the best."""


class State(NamedTuple):
    """One lane of the solver."""

    x: Variables
    """Last accepted point."""
    step: Variables
    """Step to the trial point."""
    multipliers: Multipliers
    penalty: Array
    damping: Array
    value: Array
    """Augmented Lagrangian at `x` under the present multipliers and penalty."""
    system: BorderedSystem
    """Gauss-Newton system at `x`, likewise."""
    violations: Violations
    """At `x`."""
    updated_ratio: Array
    """Violation ratio at the last multiplier update."""
    best_ratio: Array
    """Least violation ratio so far."""
    inner: Array
    """Iterations since the last multiplier update."""
    stale: Array
    """Multiplier updates in a row without progress."""
    iterations: Array
    status: Array


class Judged(NamedTuple):
    """The verdict on a lane's trial point, between `judge` and `advance`."""

    accepted: Array
    """True where the trial point becomes the lane's point."""
    feasible: Array
    ended: Array
    """True where a subproblem ended and multipliers were updated."""
    multipliers: Multipliers
    penalty: Array
    value: Array
    """At the trial point, under the new multipliers and penalty."""
    violations: Violations
    slopes: Slopes
    force: Residuals
    curvature: Residuals
    stale: Array


class Geometry(NamedTuple):
    """What `judge` needs of a chunk of measured slices."""

    distance: Array
    hand_R: Rotation
    hand_p: Vector
    screws: Array


def start(problems: Problem, x: Variables, settings: Settings) -> State:
    """NumPy states of a batch of NLPs before their first iteration; systems are placeholders, replaced because the
    first trial point is accepted."""
    B, T, D = x.q.shape
    K, N, dtype = x.m.shape[1], problems.half.shape[1], x.q.dtype
    M, is_path = PARAMETERS * K, T > K

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((B, *shape), dtype)

    infinity, count = np.full(B, np.inf, dtype), np.zeros(B, np.int32)
    return State(
        x=x,
        step=Variables(np.zeros_like(x.q), np.zeros_like(x.m)),
        multipliers=Multipliers(
            distance=zeros(T * samples_of(T, K), number_of_rows(N)), switch=zeros(K, 6), rest=zeros(K, D),
            limit=zeros(2, T, D), bound=zeros(2, K, PARAMETERS), footprint=zeros(K, 4),
        ),
        penalty=np.full(B, settings.penalty, dtype),
        damping=np.full(B, settings.damping, dtype),
        value=infinity,
        system=BorderedSystem(
            diagonal=zeros(T, D, D), coupling=zeros(T, D, D) if is_path else None,
            far_coupling=zeros(T, D) if is_path else None, border=zeros(T, D, M), corner=zeros(M, M),
            gradient_q=zeros(T, D), gradient_m=zeros(M),
        ),
        violations=Violations(*(infinity,) * len(Violations._fields)),
        updated_ratio=infinity,
        best_ratio=infinity,
        inner=count,
        stale=count,
        iterations=count,
        status=count,
    )  # fmt: skip


def _judge(problem: Problem, settings: Settings, state: State, rows: Rows, slopes: Slopes) -> Judged:
    """Accept or refuse one lane's trial point, and update its multipliers."""
    dtype = state.x.q.dtype
    trial = jax.tree.map(jnp.add, state.x, state.step)
    c = residuals(problem, trial, rows)
    p = penalties(settings.weights, state.penalty, dtype)
    value = augmented_value(problem, trial, c, state.multipliers, p, settings.weights)
    # Equal values count as success: at convergence steps are lost in rounding. NaN does not.
    accepted = value <= state.value + 1e-9 * jnp.abs(state.value)
    moved = jnp.abs(state.step.q).max()

    violations = measure_violations(problem, trial, rows)
    ratio = violations.ratio()
    feasible = accepted & (ratio <= 1) & (moved <= settings.final_step)
    first = jnp.isinf(state.value)
    ended = accepted & ~first & ((moved <= settings.step_tolerance) | (state.inner + 1 >= settings.inner_limit))

    # Multiplier update, from the rows at hand: x has just become the trial point.
    multipliers = jax.tree.map(
        lambda new, old: jnp.where(ended, new, old), update_multipliers(state.multipliers, c, p), state.multipliers
    )
    slow = ratio > settings.sufficient_decrease * state.updated_ratio
    penalty = jnp.where(
        ended & slow, jnp.minimum(state.penalty * settings.penalty_growth, settings.penalty_limit), state.penalty
    )
    stale = jnp.where(ended, jnp.where(ratio < 0.9 * state.best_ratio, 0, state.stale + 1), state.stale)
    p = penalties(settings.weights, penalty, dtype)
    value = jnp.where(ended, augmented_value(problem, trial, c, multipliers, p, settings.weights), value)
    force, curvature, _ = forces(multipliers, c, p)
    return Judged(accepted, feasible, ended, multipliers, penalty, value, violations, slopes, force, curvature, stale)


def _advance(problem: Problem, settings: Settings, state: State, judged: Judged, distances: Reduced) -> State:
    """Move one lane to its trial point if that was accepted, and find the next trial point."""
    accepted, first = judged.accepted, jnp.isinf(state.value)
    trial = jax.tree.map(jnp.add, state.x, state.step)
    system = gauss_newton_system(
        problem, trial, distances, judged.slopes, judged.force, judged.curvature, settings.weights
    )
    damping = jnp.where(accepted, jnp.maximum(state.damping / 4, 1e-6), jnp.maximum(state.damping, 1e-4) * 8)
    x, value, system, violations = jax.tree.map(
        lambda new, old: jnp.where(accepted, new, old),
        (trial, judged.value, system, judged.violations),
        (state.x, state.value, state.system, state.violations),
    )
    x, value, system, damping = materialize((x, value, system, damping))
    dq, dm = materialize(solve_bordered(system, damping))
    # One factor for joints and parameters; parameters may move 0.3 m or rad as well.
    length = jnp.maximum(jnp.abs(dq).max(), jnp.abs(dm).max())
    scale = jnp.minimum(1, settings.step_limit / jnp.maximum(length, 1e-12))
    broken = ~jnp.isfinite(length)
    # No step helps any more: return to x and take the multiplier update there.
    stuck = damping > settings.damping_limit
    factor = jnp.where(stuck | broken, 0, scale)
    step = Variables(jnp.where(factor > 0, factor * dq, 0), jnp.where(factor > 0, factor * dm.reshape(x.m.shape), 0))
    damping = jnp.where(stuck, settings.damping, jnp.where(broken, damping * 100, damping))
    iterations = state.iterations + 1
    ratio = judged.violations.ratio()
    status = jnp.where(iterations >= settings.iteration_limit, ITERATION_LIMIT, RUNNING)
    status = jnp.where(judged.stale >= settings.patience, STAGNATED, status)
    status = jnp.where(first & ~jnp.isfinite(value), NUMERICAL_FAILURE, status)
    status = jnp.where(judged.feasible, FEASIBLE, status)
    return State(
        x=x,
        step=step,
        multipliers=judged.multipliers,
        penalty=judged.penalty,
        damping=damping,
        value=jnp.where(stuck | (broken & ~first), jnp.inf, value),
        system=system,
        violations=violations,
        updated_ratio=jnp.where(judged.ended, ratio, state.updated_ratio),
        best_ratio=jnp.where(accepted, jnp.minimum(ratio, state.best_ratio), state.best_ratio),
        inner=jnp.where(judged.ended, 0, state.inner + 1),
        stale=judged.stale,
        iterations=iterations,
        status=status.astype(state.status.dtype),
    )


def _chunks(slices: Slices) -> tuple[Slices, ...]:
    """Slices in pieces of `CHUNK`, the last one filled up with copies."""
    L = slices.q.shape[-1]
    pieces = -(-L // CHUNK)
    fill = [(0, pieces * CHUNK - L)]
    padded = jax.tree.map(lambda v: jnp.pad(v, [(0, 0)] * (v.ndim - 1) + fill, mode="edge"), slices)
    return tuple(jax.tree.map(lambda v, i=i: v[..., i * CHUNK : (i + 1) * CHUNK], padded) for i in range(pieces))


def _joined(chunks: tuple[Array, ...], L: int, axis: int) -> Array:
    return jax.lax.slice_in_dim(jnp.concatenate(chunks, axis=axis), 0, L, axis=axis)


measure_chunk = Program(measure)
reduce_chunk = Program(reduce_slices)


def _lay_out_trial(problems: Problem, states: State) -> tuple[Slices, ...]:
    """Slices of all lanes' trial points, in chunks."""
    return _chunks(lay_out(problems, jax.tree.map(jnp.add, states.x, states.step)))


lay_out_trial = Program(_lay_out_trial)


@Program
def judge(
    problems: Problem, settings: Settings, states: State, chunks: tuple[Geometry, ...]
) -> tuple[Judged, tuple[tuple[Array, Array], ...]]:
    """Verdicts on all lanes' trial points, and forces and curvatures (CHUNK, P) of the distances of each chunk."""
    trial = jax.tree.map(jnp.add, states.x, states.step)
    B, T = states.multipliers.distance.shape[:2]
    distance, hand_R, hand_p, screws = (
        _joined(leaves, B * T, axis) for leaves, axis in zip(zip(*chunks, strict=True), (0, -1, -1, -1), strict=True)
    )
    rows, slopes = materialize(collect(problems, trial, distance, hand_R, hand_p, screws))
    judged = jax.vmap(_judge, in_axes=(0, None, 0, 0, 0))(problems, settings, states, rows, slopes)
    pieces = []
    for value in (judged.force.distance, judged.curvature.distance):
        flat = value.reshape(B * T, -1)
        padded = jnp.pad(flat, [(0, len(chunks) * CHUNK - B * T), (0, 0)])
        pieces.append(jnp.split(padded, len(chunks)))
    return judged, tuple(zip(*pieces, strict=True))


@Program
def advance(
    problems: Problem, settings: Settings, states: State, judged: Judged, chunks: tuple[Reduced, ...]
) -> tuple[State, tuple[Slices, ...]]:
    """States after one iteration, and the slices of their trial points."""
    B, T = states.multipliers.distance.shape[:2]
    distances = jax.tree.map(lambda *leaves: _joined(leaves, B * T, 0).reshape(B, T, *leaves[0].shape[1:]), *chunks)
    new = jax.vmap(_advance, in_axes=(0, None, 0, 0, 0))(problems, settings, states, judged, distances)
    running = states.status == RUNNING

    def choose(new: Array, old: Array) -> Array:
        return jnp.where(running.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    states = materialize(jax.tree.map(choose, new, states))
    return states, _lay_out_trial(problems, states)


def iterate(
    problems: Problem, settings: Settings, states: State, chunks: tuple[Slices, ...]
) -> tuple[State, tuple[Slices, ...]]:
    """One iteration of a batch: compiled programs, called one after the other.

    Args:
        chunks: slices of the trial points (`lay_out_trial`).
    """
    measured: list[Measured] = [measure_chunk(chunk) for chunk in chunks]
    geometry = tuple(Geometry(m.distance, m.hand_R, m.hand_p, m.screws) for m in measured)
    judged, pushes = judge(problems, settings, states, geometry)
    reduced = tuple(reduce_chunk(m, *push) for m, push in zip(measured, pushes, strict=True))
    return advance(problems, settings, states, judged, reduced)
