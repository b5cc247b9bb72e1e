"""Batched calls of particles and solver for lists of prefixes: padding to a few lane counts, so that little is
compiled.

The interface between search (lists of Python objects) and the compiled code (stacked arrays). Each function's result
for one prefix does not depend on what else is in the list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import PchipInterpolator

from dvr_jax.komo.particles import Extension, Particles, case_of, extend, no_particles
from dvr_jax.komo.problem import HELD_LEFT, Problem, Variables
from dvr_jax.komo.solver import FEASIBLE, RUNNING, Settings, iterate, start
from dvr_jax.robot.inverse_kinematics import shift_gripper

EXTENSION_LANES = (16, 64)
"""Numbers of prefixes that the extension of particles is compiled for."""
KEYFRAME_LANES = (16, 64)
"""Numbers of lanes that the solver of keyframes is compiled for."""
PATH_LANES = (1,)
"""Numbers of lanes that the solver of paths is compiled for."""

CHUNK = 10
"""Iterations between two looks at which lanes have ended."""

NEAR_SWITCH = 0.3
"""Share of a phase next to a switch in which the path is drawn to its start."""
NEAR_ATTRACTION, FAR_ATTRACTION = 0.3, 1e-2
"""Weights of that pull there and elsewhere [1/rad^2]."""

CLEARANCE = 0.08
"""How far a gripper's clear pose is from its switch [m]."""

STEPS_PER_PHASE = 10
"""Slices of a path per phase."""


@dataclass(frozen=True, slots=True)
class Solved:
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


def _lanes(number: int, sizes: tuple[int, ...]) -> int:
    return next((size for size in sizes if size >= number), sizes[-1])


def _chunks(number: int, sizes: tuple[int, ...]) -> list[tuple[list[int], int]]:
    """Indices cut into pieces of at most the largest lane count, each with its lane count."""
    pieces = [list(range(i, min(i + sizes[-1], number))) for i in range(0, number, sizes[-1])]
    return [(piece, _lanes(len(piece), sizes)) for piece in pieces]


def empty_prefix(number_of_objects: int, k_max: int) -> Particles:
    """Particles of the empty prefix, without the batch axis."""
    batch = no_particles(1, number_of_objects, k_max, np.dtype(np.float32))
    return jax.tree.map(lambda leaf: np.asarray(leaf[0]), batch)


def _extension(problem: Problem, k: int) -> Extension:
    """Arrays of action k of a problem."""
    item = int(problem.switched_object[k])
    before, after = int(problem.attachment[k, item]), int(problem.attachment[k + 1, item])
    arm = (after if problem.is_grasp[k] > 0 else before) - HELD_LEFT

    def number(value: Any) -> np.ndarray:
        return np.asarray(value, np.float32)

    return Extension(
        half=number(problem.half), initial_pose=number(problem.initial_pose), home=number(problem.home),
        opening=number(np.maximum(problem.opening[k], problem.opening[k + 1])), depth=np.int32(k), arm=np.int32(arm),
        item=np.int32(item),
        new_kind=np.int32(after), face_yaw=number(problem.face_yaw[k]), lower=number(problem.lower[k]),
        upper=number(problem.upper[k]), support=number(problem.support[k]),
    )  # fmt: skip


def extend_prefixes(parents: Sequence[Particles], problems: Sequence[Problem], seed: int) -> list[Particles]:
    """Particles of prefixes, each one action longer than its parent's; ``problems`` are those of the longer
    prefixes."""
    children: list[Particles | None] = [None] * len(parents)
    groups: dict[tuple[str, int], list[int]] = {}
    for index, problem in enumerate(problems):
        k = len(problem.is_grasp) - 1
        kind = int(problem.attachment[k, problem.switched_object[k]])
        groups.setdefault((case_of(kind, bool(problem.is_grasp[k] > 0)), k), []).append(index)
    for (case, k), members in groups.items():
        key = jax.random.fold_in(jax.random.key(seed), k)
        for piece, lanes in _chunks(len(members), EXTENSION_LANES):
            indices = [members[i] for i in piece]
            padded = indices + [indices[0]] * (lanes - len(indices))
            steps = stack([_extension(problems[i], k) for i in padded])
            batch = extend(stack([parents[i] for i in padded]), steps, key, case)
            arrays = jax.tree.map(np.asarray, batch)
            for lane, index in enumerate(indices):
                children[index] = jax.tree.map(lambda leaf, lane=lane: leaf[lane], arrays)
    return children  # type: ignore[return-value]


def solve(problems: Sequence[Problem], starts: Sequence[Variables], settings: Settings) -> list[Solved]:
    """Solve NLPs of one shape from one start each."""
    results: list[Solved] = []
    is_path = bool(starts) and starts[0].q.shape[0] > starts[0].m.shape[0]
    sizes = PATH_LANES if is_path else KEYFRAME_LANES
    for piece, lanes in _chunks(len(problems), sizes):
        results += _solve_lanes([problems[i] for i in piece], [starts[i] for i in piece], settings, lanes, sizes)
    return results


def _solve_lanes(
    problems: list[Problem], starts: list[Variables], settings: Settings, lanes: int, sizes: tuple[int, ...]
) -> list[Solved]:
    results: list[Solved | None] = [None] * len(problems)
    alive = list(range(len(problems)))
    padded = alive + [0] * (lanes - len(alive))
    batch: Problem = jax.tree.map(jnp.asarray, stack([problems[i] for i in padded]))
    x = jax.tree.map(jnp.asarray, stack([starts[i] for i in padded]))
    settings = jax.tree.map(
        lambda value: np.asarray(value, x.q.dtype if isinstance(value, float) else np.int32), settings
    )
    states = start(batch, x, settings)
    if lanes > len(alive):
        # Padding lanes have ended from the beginning.
        ended = jnp.arange(lanes) >= len(alive)
        states = states._replace(status=jnp.where(ended, FEASIBLE, states.status))
    while True:
        states = iterate(batch, settings, states, np.int32(CHUNK))
        status = np.asarray(states.status)
        done = [lane for lane in range(len(alive)) if status[lane] != RUNNING]
        if done:
            _collect(states, alive, done, results)
        keep = [lane for lane in range(len(alive)) if status[lane] == RUNNING]
        if not keep:
            return results  # type: ignore[return-value]
        fewer = _lanes(len(keep), sizes)
        if fewer < lanes:
            # Most lanes of a batch are infeasible and slow: go on in a smaller program without the ended ones.
            index = np.array(keep + [keep[0]] * (fewer - len(keep)))
            states, batch = jax.tree.map(lambda leaf, index=index: leaf[index], (states, batch))
            ended = jnp.arange(fewer) >= len(keep)
            states = states._replace(status=jnp.where(ended, FEASIBLE, states.status))
            alive, lanes = [alive[lane] for lane in keep], fewer


def _collect(states: Any, alive: list[int], done: list[int], results: list[Solved | None]) -> None:
    x, violations = jax.tree.map(np.asarray, (states.x, states.violations))
    ratio = np.asarray(states.violations.ratio())
    for lane in done:
        if results[alive[lane]] is not None:
            continue
        status = int(states.status[lane])
        results[alive[lane]] = Solved(
            feasible=status == FEASIBLE,
            ratio=float(ratio[lane]),
            violations={name: float(value[lane]) for name, value in violations._asdict().items()},
            q=x.q[lane],
            m=x.m[lane],
            iterations=int(states.iterations[lane]),
            status=status,
        )


def keyframe_start(prefix: Particles, rank: int, K: int) -> Variables:
    """The particle of this rank (0: least violation) as a start of the keyframe NLP."""
    index = int(np.argsort(prefix.violation, kind="stable")[rank])
    return Variables(prefix.q[index, :K].astype(float), prefix.m[index, :K].astype(float))


def path_start(problem: Problem, keyframes: Variables, steps: int = STEPS_PER_PHASE) -> Variables:
    """A path through keyframes, at rest at each; an arm that takes part in a switch comes and goes through a clear
    pose beside it."""
    K = keyframes.q.shape[0]
    before = np.concatenate([problem.home[None], keyframes.q[:-1]])
    coming, going = _clear_postures(problem, keyframes.q)
    leaving = np.concatenate([before[:1], going[:-1]])
    tau = np.arange(1, steps + 1) / steps
    q = np.empty((K, steps, keyframes.q.shape[1]))
    for k in range(K):
        knots = np.stack([before[k], leaving[k], coming[k], keyframes.q[k]])
        # At rest at both ends: time runs as a cubic, and the joints as a monotone curve of it.
        curve = PchipInterpolator([0.0, 0.25, 0.75, 1.0], knots, axis=0)
        q[k] = curve(tau * tau * (3 - 2 * tau))
    return Variables(q.reshape(K * steps, -1), keyframes.m)


def path_problem(problem: Problem, start: Variables) -> Problem:
    """The path NLP of a sequence from its keyframe NLP: drawn to its start, and more so close to a switch, for the
    arms that take part.

    Without it the shortest motion sweeps sideways into a grasp, and hops over the object's edge between two slices.
    """
    T, K = len(start.q), len(problem.is_grasp)
    S = T // K
    near = round(NEAR_SWITCH * S)
    attraction = np.full(start.q.shape, FAR_ATTRACTION)
    for k, resting in enumerate(problem.resting):
        weight = np.where(np.repeat(resting, 7) > 0, NEAR_ATTRACTION, FAR_ATTRACTION)
        part = slice((k + 1) * S - 1 - near, (k + 1) * S + near)
        attraction[part] = np.maximum(attraction[part], weight)
    return problem._replace(reference=start.q, attraction=attraction * (STEPS_PER_PHASE / S))


def _clear_postures(problem: Problem, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (K, 14) shortly before and after each switch: a gripper that comes to grasp or has let go is
    `CLEARANCE` back along its approach, one that holds something that stands before or after the switch is as much
    higher."""
    K = len(q)
    coming, going = q.copy(), q.copy()
    tasks: list[tuple[np.ndarray, int, int, bool]] = []
    for k in range(K):
        item = problem.switched_object[k]
        old, new = int(problem.attachment[k, item]), int(problem.attachment[k + 1, item])
        for arm in range(2):
            gives, takes = old == HELD_LEFT + arm, new == HELD_LEFT + arm
            if takes:
                tasks += [(coming, k, arm, False), (going, k, arm, old < HELD_LEFT)]
            elif gives:
                tasks += [(going, k, arm, False)]
                if new < HELD_LEFT:
                    tasks += [(coming, k, arm, True)]
    lanes = len(tasks) + (-len(tasks)) % 16
    angles, arms, up = np.zeros((lanes, 7)), np.zeros(lanes, np.int32), np.zeros(lanes, bool)
    for lane, (target, k, arm, rises) in enumerate(tasks):
        angles[lane], arms[lane], up[lane] = target[k, 7 * arm : 7 * arm + 7], arm, rises
    shifted = np.asarray(shift_gripper(angles, arms, up, CLEARANCE))
    for lane, (target, k, arm, _) in enumerate(tasks):
        target[k, 7 * arm : 7 * arm + 7] = shifted[lane]
    return coming, going


def refined_start(problem: Problem, solution: Solved) -> Variables:
    """A solved path with twice the slices: penetrations between two slices show up there and can be optimised away."""
    T = len(solution.q)
    knots = np.concatenate([problem.home[None], solution.q])
    doubled = PchipInterpolator(np.arange(T + 1), knots, axis=0)(np.arange(1, 2 * T + 1) / 2)
    return Variables(doubled, solution.m)


def adopt(prefix: Particles, problem: Problem, solution: Solved) -> Particles:
    """Particles with a solution of the keyframe NLP in the place of the worst one."""
    K = solution.m.shape[0]
    index = int(np.argmax(prefix.violation))
    q, m, violation, parameters = (x.copy() for x in (prefix.q, prefix.m, prefix.violation, prefix.parameters))
    q[index, :K], m[index, :K], violation[index] = solution.q, solution.m, 0
    for n, action in enumerate(problem.attached_by[K]):
        parameters[index, n] = solution.m[action]
    return prefix._replace(q=q, m=m, violation=violation, parameters=parameters)
