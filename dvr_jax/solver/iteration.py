"""The augmented-Lagrangian method on many NLPs of the same shape at once, one lane each.

Every lane carries a status; nothing is raised under jit, and a lane that has ended no longer changes. An iteration is
two compiled programs: `measure_chunk` does the geometry, whose compilation is dear, for chunks of few sizes, of slices
of any problem with the same number of objects; `step` does the rest and is compiled for each horizon."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.vectors import materialize
from dvr_jax.nlp.collision_rows import number_of_rows
from dvr_jax.nlp.constraints import Jacobians, collect, lay_out
from dvr_jax.nlp.lagrangian import (
    EQUALITIES,
    WEIGHTS,
    FlatResiduals,
    cost,
    gauss_newton_system,
    pack,
    residuals,
    scales,
    unpack,
)
from dvr_jax.nlp.problem import PARAMETERS, Problem, Variables
from dvr_jax.nlp.slices import NormalEquations, SliceGeometry, Slices, measure, reduce_slices
from dvr_jax.nlp.tolerances import Violations, measure_violations
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.compilation import Program
from dvr_jax.solver import augmented_lagrangian as augmented
from dvr_jax.solver.augmented_lagrangian import DURING, RUNNING, Settings, SolverState, TrialUpdate, trial_point
from dvr_jax.solver.banded import BorderedSystem, solve_bordered


class TrialEvaluation(NamedTuple):
    """What is known of a trial point between `judge` and `advance`."""

    judged: TrialUpdate
    slopes: Jacobians
    violations: Violations


def start(problems: Problem, x: Variables, settings: Settings) -> SolverState:
    """NumPy lanes of a batch of NLPs before their first iteration; systems are placeholders, replaced because the
    first trial point is accepted."""
    B, T, D = x.q.shape
    K, N, dtype = x.m.shape[1], problems.half.shape[1], x.q.dtype
    M, is_path = PARAMETERS * K, T > K

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros((B, *shape), dtype)

    infinity, count = np.full(B, np.inf, dtype), np.zeros(B, np.int32)
    return SolverState(
        x=x,
        step=Variables(np.zeros_like(x.q), np.zeros_like(x.m)),
        multipliers=(
            zeros(T * problems.share.shape[2], number_of_rows(N)), zeros(K * (6 + D)),
            zeros(2 * T * D + K * (2 * PARAMETERS + 4)),
        ),
        penalty=np.full(B, settings.penalty, dtype),
        damping=np.full(B, settings.damping, dtype),
        value=infinity,
        system=BorderedSystem(
            diagonal=zeros(T, D, D), coupling=zeros(T, D, D) if is_path else None,
            far_coupling=zeros(T, D) if is_path else None, border=zeros(T, D, M), corner=zeros(M, M),
            gradient_q=zeros(T, D), gradient_m=zeros(M),
        ),
        report=Violations(*(infinity,) * len(Violations._fields)),
        updated_ratio=infinity,
        best_ratio=infinity,
        inner=count,
        stale=count,
        iterations=count,
        restoration=count.copy(),
        status=count.copy(),
    )  # fmt: skip


def _chunk_size(L: int) -> int:
    """Size of the chunks that L slices are cut into: a multiple of the smallest, so that few are compiled."""
    chunk = batch_sizes().chunk
    pieces = -(-L // batch_sizes().largest_chunk)
    return chunk * -(-L // (pieces * chunk))


def cut_into_chunks(slices: Slices) -> tuple[Slices, ...]:
    """Slices in pieces of one size, the last one filled up with copies."""
    L = slices.q.shape[-1]
    size = _chunk_size(L)
    fill = [(0, -L % size)]
    padded = jax.tree.map(lambda v: jnp.pad(v, [(0, 0)] * (v.ndim - 1) + fill, mode="edge"), slices)
    return tuple(jax.tree.map(lambda v, i=i: v[..., i : i + size], padded) for i in range(0, L, size))


def _joined(chunks: Sequence[Array], L: int, axis: int) -> Array:
    return jax.lax.slice_in_dim(jnp.concatenate(chunks, axis=axis), 0, L, axis=axis)


measure_chunk = Program(measure)


def _lay_out_chunks(problems: Problem, x: Variables) -> tuple[Slices, ...]:
    """Slices of a point of all problems, in chunks."""
    return cut_into_chunks(lay_out(problems, x))


lay_out_chunks = Program(_lay_out_chunks)


def _identity(tree: Any) -> Any:
    return tree


to_device: Callable[[Any], Any] = Program(_identity)
"""A tree of NumPy arrays as JAX arrays: a compiled program takes a third of the time of `jax.device_put`."""


def judge(
    problems: Problem, settings: Settings, lanes: SolverState, chunks: tuple[SliceGeometry, ...]
) -> tuple[TrialEvaluation, tuple[tuple[Array, Array], ...]]:
    """Verdicts on all lanes' trial points, and forces and curvatures (L, P) of the distances of each chunk."""
    trial = trial_point(lanes)
    B, T = lanes.multipliers[0].shape[:2]
    distance = _joined([chunk.distance for chunk in chunks], B * T, 0)
    hand_R, hand_p, screws = (
        _joined([getattr(chunk, name) for chunk in chunks], B * T, -1) for name in ("hand_R", "hand_p", "screws")
    )
    rows, slopes = materialize(collect(problems, trial, distance, hand_R, hand_p, screws))
    violations = jax.vmap(measure_violations)(problems, trial, rows)
    c = jax.vmap(lambda *of_lane: pack(residuals(*of_lane)))(problems, trial, rows)
    costs = jax.vmap(cost, in_axes=(0, 0, None))(problems, trial, WEIGHTS)
    relative = scales(WEIGHTS, trial.q.shape[1], trial.m.shape[1], trial.q.dtype)

    def judge_lane(lane: SolverState, cost: Array, c: FlatResiduals, ratio: Array) -> TrialUpdate:
        return augmented.judge(settings, lane, cost, c, relative, EQUALITIES, ratio)

    judged = jax.vmap(judge_lane)(lanes, costs, c, violations.ratio())
    pieces = []
    for value in (judged.force[0], judged.curvature[0]):
        padded = jnp.pad(value.reshape(B * T, -1), [(0, -(B * T) % _chunk_size(B * T)), (0, 0)])
        pieces.append(jnp.split(padded, len(chunks)))
    return TrialEvaluation(judged, slopes, violations), tuple(zip(*pieces, strict=True))


def advance(
    problems: Problem,
    settings: Settings,
    lanes: SolverState,
    seen: TrialEvaluation,
    chunks: tuple[NormalEquations, ...],
) -> tuple[SolverState, tuple[Slices, ...]]:
    """Lanes after one iteration, and the slices of their trial points."""
    B, T = lanes.multipliers[0].shape[:2]
    distances = jax.tree.map(lambda *leaves: _joined(leaves, B * T, 0).reshape(B, T, *leaves[0].shape[1:]), *chunks)

    sizes = lanes.x.q.shape[1], lanes.x.m.shape[1]

    def advance_lane(
        problem: Problem, lane: SolverState, seen: TrialEvaluation, distances: NormalEquations
    ) -> SolverState:
        judged = seen.judged
        force, curvature = (unpack(FlatResiduals(*rows), *sizes) for rows in (judged.force, judged.curvature))
        drive = jnp.where(judged.restoration == DURING, 0.0, 1.0).astype(lane.x.q.dtype)
        system = gauss_newton_system(
            problem, trial_point(lane), distances, seen.slopes, force, curvature, WEIGHTS, drive
        )
        return augmented.advance(settings, lane, judged, system, seen.violations, _solve)

    new = jax.vmap(advance_lane)(problems, lanes, seen, distances)
    running = lanes.status == RUNNING

    def choose(new: Array, old: Array) -> Array:
        return jnp.where(running.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    lanes = materialize(jax.tree.map(choose, new, lanes))
    return lanes, _lay_out_chunks(problems, trial_point(lanes))


def _solve(system: BorderedSystem, damping: Array) -> Variables:
    dq, dm = solve_bordered(system, damping)
    return Variables(dq, dm.reshape(-1, PARAMETERS))


@Program
def step(
    problems: Problem, settings: Settings, lanes: SolverState, chunks: tuple[SliceGeometry, ...]
) -> tuple[SolverState, tuple[Slices, ...]]:
    """What follows the measuring of all chunks: the rest of an iteration in one program."""
    seen, pushes = materialize(judge(problems, settings, lanes, chunks))
    reduced = materialize(tuple(reduce_slices(chunk, *push) for chunk, push in zip(chunks, pushes, strict=True)))
    return advance(problems, settings, lanes, seen, reduced)


def iterate(
    problems: Problem, settings: Settings, lanes: SolverState, chunks: tuple[Slices, ...]
) -> tuple[SolverState, tuple[Slices, ...]]:
    """One iteration of a batch: compiled programs, called one after the other.

    Args:
        chunks: slices of the trial points (`lay_out_chunks`).
    """
    return step(problems, settings, lanes, tuple(measure_chunk(chunk) for chunk in chunks))
