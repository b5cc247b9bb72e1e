"""An oracle of many random starts: it decides, at great expense, whether a sequence is feasible.

It is patient where a search is quick, and its starts know nothing of the search's proposals. `keyframes` problems are
prefixes whose parent the oracle found feasible, and one more action: this is what a search asks. `path` problems are
sequences with feasible keyframes that reach the goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.logic import Action
from dvr_jax.nlp.problem import Problem, Variables, number_of_phases
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.operators.grasp import PITCH_RANGE
from dvr_jax.scene.types import Scene
from dvr_jax.seeds.initial_paths import initial_path, path_problem
from dvr_jax.solver.lane_pool import NlpSolution, solve
from dvr_jax.solver.state import Settings
from dvr_jax.workcell.model import WorkcellModel, workcell_model
from dvr_jax.workcell.workcell import Table

STARTS = 64
"""Starts of the oracle."""

STARTS_TOGETHER = 16
"""Starts of keyframes that are solved together; the oracle stops after any such group."""

ORACLE = Settings(iteration_limit=100, patience=8, course_ratio=math.inf)
"""The oracle's settings: more patient than those of a search."""

NEAR_HOME = 0.5
"""Standard deviation of the oracle's postures near home [rad]."""

DETOUR = 0.4
"""Size of the random detour of the oracle's paths [rad]."""

SUPPORT_FRACTION = 0.8
"""Share of a support's half extents that random placements are drawn from."""

Floats = NDArray[np.float64]


def random_keyframes(
    model: WorkcellModel, problem: Problem, generator: np.random.Generator
) -> Variables:
    """Draw joint angles near home or anywhere within the limits, and mode parameters anywhere within their bounds.

    Args:
        model: arms of the workcell.
        problem: the keyframe problem.
        generator: of the draw.

    Returns:
        Joint angles (K, joints) [rad] and mode parameters (K, 4).
    """
    K = number_of_phases(problem)
    lower, upper = np.tile(model.joint_limits, model.structure.number_of_arms)

    # Half of the starts are near home, since most solutions are; the others keep 10 % away from the joint limits.
    near = problem.home + generator.normal(size=(K, len(lower))) * NEAR_HOME
    anywhere = generator.uniform(
        0.9 * lower + 0.1 * upper, 0.1 * lower + 0.9 * upper, (K, len(lower))
    )
    q = np.clip(near if generator.random() < 0.5 else anywhere, lower, upper)

    m = np.zeros((K, 4))
    for k in range(K):
        if problem.on_support[k] > 0:
            m[k] = _random_placement(problem, k, generator)
        else:
            m[k] = _random_grasp(problem, k, generator)
    return Variables(jnp.asarray(q), jnp.asarray(m))


def _random_grasp(problem: Problem, k: int, generator: np.random.Generator) -> Floats:
    """Mode parameters of a grasp, anywhere within their bounds."""
    widest = np.array([1.0, 1.0, PITCH_RANGE, math.pi])
    lower = np.maximum(problem.parameter_lower[k], -widest)
    upper = np.minimum(problem.parameter_upper[k], widest)
    return generator.uniform(lower, upper)


def _random_placement(problem: Problem, k: int, generator: np.random.Generator) -> Floats:
    """Mode parameters of a placement, anywhere on the inner part of its support and at any yaw."""
    half_x, half_y = Table().half_extents
    x, y, yaw, side, front = problem.support[k]
    spread = (
        generator.uniform(-1, 1, 2) * (min(side, half_x), min(front, half_y)) * SUPPORT_FRACTION
    )
    c = math.cos(yaw)
    s = math.sin(yaw)

    m = np.zeros(4)
    m[0] = x + c * spread[0] - s * spread[1]
    m[1] = y + s * spread[0] + c * spread[1]
    m[2] = generator.uniform(-math.pi, math.pi)
    return m


def oracle_keyframes(
    scene: Scene,
    actions: Sequence[Action],
    generator: np.random.Generator,
    enough: int = 1,
) -> list[NlpSolution]:
    """Find feasible keyframes from random starts.

    Args:
        scene: the scene.
        actions: the sequence.
        generator: of the starts.
        enough: number of feasible keyframes at which the oracle stops.

    Returns:
        The feasible keyframes, none where no start leads to any.
    """
    model = workcell_model(scene.workcell)
    problem = transcribe(scene, actions)
    found: list[NlpSolution] = []
    for _ in range(STARTS // STARTS_TOGETHER):
        starts = [random_keyframes(model, problem, generator) for _ in range(STARTS_TOGETHER)]
        results = solve(model, [problem] * STARTS_TOGETHER, starts, ORACLE)
        found += [result for result in results if result.feasible]
        if len(found) >= enough:
            break
    return found


def oracle_path(
    model: WorkcellModel,
    problem: Problem,
    keyframes: Sequence[NlpSolution],
    generator: np.random.Generator,
    accept: Callable[[NlpSolution], bool] = lambda path: True,
) -> bool:
    """Decide whether any of many paths through feasible keyframes can be made feasible.

    The first path through each of the keyframes is the search's initial path; all others have a random detour in every
    phase.

    Args:
        model: arms of the workcell.
        problem: the problem of the keyframes.
        keyframes: feasible keyframes, taken in turn.
        generator: of the detours.
        accept: says whether a feasible path counts.

    Returns:
        Whether some path is feasible and accepted.
    """
    for number in range(STARTS):
        chosen = keyframes[number % len(keyframes)]
        start = initial_path(
            model, problem, Variables(jnp.asarray(chosen.q), jnp.asarray(chosen.m))
        )
        start = _add_detour(start, DETOUR * (number >= len(keyframes)), generator)
        (path,) = solve(model, [path_problem(problem, start)], [start], ORACLE)
        if path.feasible and accept(path):
            return True
    return False


def _add_detour(start: Variables, size: float, generator: np.random.Generator) -> Variables:
    """Add to each phase of an initial path a detour in a random direction, size sin^2(pi tau) at its share tau."""
    K = len(start.m)
    T = len(start.q)
    steps = T // K
    tau = (np.arange(T) % steps + 1) / steps
    directions = np.repeat(generator.normal(size=(K, start.q.shape[1])) * size, steps, axis=0)
    return start._replace(q=start.q + directions * np.sin(np.pi * tau)[:, None] ** 2)
