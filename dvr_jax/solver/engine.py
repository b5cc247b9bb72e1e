"""Batched calls of particles and solver for lists of prefixes: padding to one lane count each, so that little is
compiled.

The interface between search (lists of Python objects) and the compiled code (stacked arrays). Each function's result
for one prefix does not depend on what else is in the lists, but for the last digits of `augmented.forces`' total."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from dvr_jax.errors import DvrError
from dvr_jax.nlp.problem import HELD_LEFT, Problem, Variables
from dvr_jax.nlp.tolerances import Violations
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.runtime.threads import linear_algebra_on_one_thread
from dvr_jax.seeds.keyframe_beam import RANDOM_SHAPE, SIBLING_PENALTY, KeyframeBeam, case_of, extend
from dvr_jax.seeds.proposals import BeamStep
from dvr_jax.solver.augmented_lagrangian import FEASIBLE, ITERATION_LIMIT, RUNNING, Settings, SolverState
from dvr_jax.solver.continuous_collision import (
    BETWEEN_TOLERANCE,
    EXCHANGES,
    exchange_samples,
    sample_penetration,
)
from dvr_jax.solver.iteration import iterate, lay_out_chunks, start, to_device
from dvr_jax.workcell.constants import BASE_POSITIONS

REFILLED = 0.25
"""Share of a batch's lanes that have ended when new problems take their places."""

RESTARTED = (
    "step", "damping", "value", "report", "updated_ratio", "best_ratio", "inner", "stale", "iterations", "restoration",
    "status",
)  # fmt: skip
"""Of a `SolverState`, what changes when its solution penetrates between its samples."""


@dataclass(frozen=True, slots=True)
class NlpSolution:
    """Result of one NLP."""

    feasible: bool
    ratio: float
    """Largest violation as a multiple of its tolerance."""
    violations: dict[str, float]
    """Largest violation of each kind [m or rad]."""
    q: np.ndarray
    """(T, 14) joint angles [rad]."""
    m: np.ndarray
    """(K, 4) mode parameters."""
    iterations: int
    status: int


def stack(trees: Sequence[Any]) -> Any:
    """Pytrees of NumPy arrays stacked along a new leading axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def _extension(problem: Problem, k: int, case: str) -> BeamStep:
    """Arrays of action k of a problem."""
    item = int(problem.switched_object[k])
    before, after = int(problem.attachment[k, item]), int(problem.attachment[k + 1, item])
    arm = (after if problem.is_grasp[k] > 0 else before) - HELD_LEFT

    def number(value: Any) -> np.ndarray:
        return np.asarray(value, np.float32)

    return BeamStep(
        half=number(problem.half), initial_pose=number(problem.initial_pose), home=number(problem.home),
        opening=number(np.maximum(problem.opening[k], problem.opening[k + 1])), depth=np.int32(k), arm=np.int32(arm),
        base=number(BASE_POSITIONS[arm]), item=np.int32(item), new_kind=np.int32(after),
        face_yaw=number(problem.face_yaw[k]), lower=number(problem.lower[k]), upper=number(problem.upper[k]),
        support=number(problem.support[k]), share=number(SIBLING_PENALTY[case]),
    )  # fmt: skip


def _extension_kind(problem: Problem) -> tuple[str, int]:
    """What the last action of a prefix is, and how many are before it: one program serves what is equal in both."""
    k = len(problem.is_grasp) - 1
    kind = int(problem.attachment[k, problem.switched_object[k]])
    return case_of(kind, bool(problem.is_grasp[k] > 0)), k


def beam_lanes(problems: Sequence[Problem]) -> list[int]:
    """How many prefixes each of these shares a call with when they are asked for together.

    A program of other lanes may round differently, so that who asks decides, and not who else is served with it."""
    kinds = [_extension_kind(problem) for problem in problems]
    counts = Counter(kinds)
    return [1 if counts[kind] <= batch_sizes().few else batch_sizes().beam_lanes for kind in kinds]


def extend_beams(
    parents: Sequence[KeyframeBeam], problems: Sequence[Problem], seed: int, lanes: Sequence[int]
) -> list[KeyframeBeam]:
    """KeyframeBeam of prefixes, each one action longer than its parent's; ``problems`` are those of the longer
    prefixes, ``lanes`` their `beam_lanes`."""
    children: list[KeyframeBeam | None] = [None] * len(parents)
    groups: dict[tuple[tuple[str, int], int], list[int]] = {}
    for index, (problem, count) in enumerate(zip(problems, lanes, strict=True)):
        groups.setdefault((_extension_kind(problem), count), []).append(index)
    for ((case, k), count), members in groups.items():
        u = np.random.default_rng([seed, k]).random(RANDOM_SHAPE, np.float32)
        for first in range(0, len(members), count):
            indices = members[first : first + count]
            padded = indices + [indices[0]] * (count - len(indices))
            steps = stack([_extension(problems[i], k, case) for i in padded])
            batch = extend(stack([parents[i] for i in padded]), steps, u, case)
            arrays = jax.tree.map(np.asarray, batch)
            for lane, index in enumerate(indices):
                children[index] = jax.tree.map(lambda leaf, lane=lane: leaf[lane], arrays)
    return children  # type: ignore[return-value]


@linear_algebra_on_one_thread()
def solve(problems: Sequence[Problem], starts: Sequence[Variables], settings: Settings) -> list[NlpSolution]:
    """Solve NLPs of one shape from one start each.

    Lanes that have ended are filled again once `REFILLED` of them wait, so that the slow ones hold nobody up. A path
    whose motion penetrates between its samples goes on with other samples (`dvr_jax.solver.continuous_collision`); of one with samples
    at its slices alone nothing else is looked at.

    Raises:
        DvrError: without 64-bit numbers, in which tolerances and penalties have no room.
    """
    if not problems:
        return []
    if not jax.config.values["jax_enable_x64"]:
        raise DvrError("the solver needs 64-bit numbers; call it under jax.enable_x64(True).")
    T, K = len(starts[0].q), len(starts[0].m)
    is_path = T > K
    is_looked_at = is_path and problems[0].share.shape[1] > 1
    lanes = batch_sizes().path_lanes if is_path else max(batch_sizes().chunk // K, 1)
    waiting = list(range(len(problems)))[::-1]
    results: list[NlpSolution | None] = [None] * len(problems)
    exchanges, spent = np.zeros((2, lanes), int)
    accepted = np.zeros(lanes, bool)
    owner = [waiting.pop() if waiting else None for _ in range(lanes)]
    settings = jax.tree.map(lambda value: np.asarray(value, float if isinstance(value, float) else np.int32), settings)
    batch: Problem = stack([problems[i or 0] for i in owner])
    states = start(batch, stack([starts[i or 0] for i in owner]), settings)
    states.status[:] = [FEASIBLE if i is None else RUNNING for i in owner]
    batch_on_device, settings = to_device((batch, settings))
    chunks = lay_out_chunks(batch_on_device, states.x)
    while True:
        states, chunks = iterate(batch_on_device, settings, states, chunks)
        status = np.asarray(states.status)
        ended = [lane for lane, i in enumerate(owner) if i is not None and status[lane] != RUNNING]
        found = [lane for lane in ended if status[lane] == FEASIBLE and not accepted[lane]] if is_looked_at else []
        if found:
            looks = sample_penetration(batch_on_device, states.x)
            # To change; the others stay where they are.
            states = states._replace(**{name: jax.tree.map(np.array, getattr(states, name)) for name in RESTARTED})
            depths = looks.depth.max(axis=(1, 2))
            for lane in found:
                accepted[lane] = depths[lane] <= BETWEEN_TOLERANCE
                if accepted[lane]:
                    continue
                if exchanges[lane] == EXCHANGES:
                    states.report.penetration[lane], states.status[lane] = depths[lane], ITERATION_LIMIT
                    continue
                exchanges[lane] += 1
                spent[lane] += states.iterations[lane]
                problem = jax.tree.map(lambda leaf, lane=lane: leaf[lane], batch)
                placed = exchange_samples(problem, np.asarray(states.x.q)[lane], looks.share[lane], looks.depth[lane])
                batch.share[lane], batch.offset[lane] = placed.share, placed.offset
                _go_on(states, lane, settings)
            status = np.asarray(states.status)
            ended = [lane for lane in ended if status[lane] != RUNNING]
            if any(status[lane] == RUNNING for lane in found):
                moved = to_device((batch.share, batch.offset))
                batch_on_device = batch_on_device._replace(share=moved[0], offset=moved[1])
                chunks = lay_out_chunks(batch_on_device, _trial_points(states))
        running = sum(i is not None for i in owner) - len(ended)
        if not ended or (running and len(ended) < REFILLED * lanes):
            continue
        final = jax.tree.map(np.asarray, (states.x, states.report, states.iterations))
        for lane in ended:
            i = owner[lane]
            assert i is not None
            x, violations, iterations = jax.tree.map(lambda leaf, lane=lane: leaf[lane], final)
            results[i] = _solved(x, violations, spent[lane] + iterations, int(status[lane]))
            exchanges[lane] = spent[lane] = accepted[lane] = 0
            owner[lane] = waiting.pop() if waiting else None
        refilled = [lane for lane in ended if owner[lane] is not None]
        if refilled:
            states = jax.tree.map(np.array, states)
            fresh = [(problems[i], starts[i]) for i in (owner[lane] for lane in refilled) if i is not None]
            new_problems, new_starts = stack([p for p, _ in fresh]), stack([x for _, x in fresh])
            _assign(batch, refilled, new_problems)
            _assign(states, refilled, start(new_problems, new_starts, settings))
            batch_on_device = to_device(batch)
            chunks = lay_out_chunks(batch_on_device, _trial_points(states))
        elif not running:
            return results  # type: ignore[return-value]


def _trial_points(states: SolverState) -> Variables:
    return jax.tree.map(lambda x, step: np.asarray(x) + np.asarray(step), states.x, states.step)


def _go_on(states: SolverState, lane: int, settings: Settings) -> None:
    """Make a lane that has ended start again from its point, with its multipliers and penalty."""
    for step in states.step:
        step[lane] = 0
    for value in (states.value, states.updated_ratio, states.best_ratio):
        value[lane] = np.inf
    for count in (states.inner, states.stale, states.iterations, states.restoration):
        count[lane] = 0
    states.damping[lane], states.status[lane] = settings.damping, RUNNING


def _assign(target: Any, lanes: list[int], values: Any) -> None:
    """Overwrite some lanes of a tree of NumPy arrays."""
    for leaf, value in zip(jax.tree.leaves(target), jax.tree.leaves(values), strict=True):
        leaf[lanes] = value


def _solved(x: Variables, violations: Violations, iterations: np.ndarray, status: int) -> NlpSolution:
    return NlpSolution(
        feasible=status == FEASIBLE,
        ratio=float(violations.ratio()),
        violations={name: float(value) for name, value in violations._asdict().items()},
        q=np.array(x.q),
        m=np.array(x.m),
        iterations=int(iterations),
        status=status,
    )


def adopt(prefix: KeyframeBeam, problem: Problem, solution: NlpSolution) -> KeyframeBeam:
    """KeyframeBeam with a solution of the keyframe NLP in the place of the worst one."""
    K = solution.m.shape[0]
    index = int(np.argmax(prefix.violation))
    q, m, violation, parameters = (x.copy() for x in (prefix.q, prefix.m, prefix.violation, prefix.parameters))
    q[index, :K], m[index, :K], violation[index] = solution.q, solution.m, 0
    for n, action in enumerate(problem.attached_by[K]):
        parameters[index, n] = solution.m[action]
    return prefix._replace(q=q, m=m, violation=violation, parameters=parameters)
