"""A scene with sequences for tests of the solver, random starts of their NLPs, and the violations of any point."""

import math

import jax
import numpy as np
from numpy.typing import NDArray

from dvr_jax.logic import Action
from dvr_jax.modes.mode import PARAMETERS, ModeKind
from dvr_jax.nlp.evaluation import Violations, evaluate_constraints
from dvr_jax.nlp.evaluation import violations_of as largest_violations
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import measure
from dvr_jax.nlp.system import BorderedSystem
from dvr_jax.operators.grasp import PITCH_RANGE
from dvr_jax.scene.types import OnRegion, Region, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.workcell.model import WorkcellModel, workcell_model

Floats = NDArray[np.float64]

SCENE = make_scene(
    [
        SceneObject("yellow", "box", (0.05, 0.16, 0.10), (-0.15, 0.22), 0.5),
        SceneObject("can", "cylinder", (0.035, 0.14), (0.12, -0.2), 0.0),
        SceneObject("green", "box", (0.06, 0.06, 0.18), (0.05, 0.3), 0.3),
    ],
    OnRegion("yellow", Region((0.3, -0.25), 0.4, (0.22, 0.2))),
)

MODEL: WorkcellModel = workcell_model(SCENE.workcell)

NEAR_HOME = 0.5
"""Standard deviation of random postures near home [rad]."""

INNER_FRACTION = 0.8
"""Fraction of a support's half extents that random placements are drawn from."""

JOINTS = SCENE.workcell.number_of_joints


def grasp(arm: str, face: str, item: str) -> Action:
    return Action("grasp", (arm, face, item))


def place(arm: str, item: str, support: str) -> Action:
    return Action("place", (arm, item, support))


SKELETONS = (
    # Handover of a box, then its arm is free again while the other one grasps.
    (
        grasp("left", "+x", "yellow"),
        grasp("right", "+y", "yellow"),
        place("right", "yellow", "goal"),
        grasp("left", "-x", "can"),
    ),
    # A cylinder placed and grasped where it was placed.
    (
        grasp("right", "+x", "can"),
        place("right", "can", "table"),
        grasp("left", "-y", "can"),
        place("left", "can", "goal"),
    ),
    # Both arms hold; then a cylinder is handed over.
    (
        grasp("left", "+y", "green"),
        grasp("right", "+x", "can"),
        place("left", "green", "goal"),
        grasp("left", "-x", "can"),
    ),
)


def random_keyframes(problem: Problem, generator: np.random.Generator) -> Variables:
    """Joint angles near home or anywhere within the limits, and mode parameters anywhere within their bounds."""
    number = len(problem.switched_object)
    lower, upper = np.tile(MODEL.joint_limits, SCENE.workcell.number_of_arms)
    near = problem.home + generator.normal(size=(number, len(lower))) * NEAR_HOME
    anywhere = generator.uniform(
        0.9 * lower + 0.1 * upper, 0.1 * lower + 0.9 * upper, (number, len(lower))
    )
    q = np.clip(near if generator.random() < 0.5 else anywhere, lower, upper)

    m = np.zeros((number, PARAMETERS))
    for k, item in enumerate(problem.switched_object):
        is_held = problem.mode_kind[k + 1, item] == ModeKind.HELD
        m[k] = (
            _random_grasp(problem, k, generator)
            if is_held
            else _random_placement(problem, k, generator)
        )
    return Variables(q, m)


def _random_grasp(problem: Problem, k: int, generator: np.random.Generator) -> Floats:
    widest = np.array([1.0, 1.0, PITCH_RANGE, math.pi])
    lower = np.maximum(problem.parameter_lower[k], -widest)
    upper = np.minimum(problem.parameter_upper[k], widest)
    return generator.uniform(lower, upper)


def _random_placement(problem: Problem, k: int, generator: np.random.Generator) -> Floats:
    x, y, yaw, *half = problem.support[k]
    spread = (
        generator.uniform(-1, 1, 2)
        * np.minimum(half, SCENE.workcell.table.half_extents)
        * INNER_FRACTION
    )
    c = math.cos(yaw)
    s = math.sin(yaw)
    m = np.zeros(PARAMETERS)
    m[0] = x + c * spread[0] - s * spread[1]
    m[1] = y + s * spread[0] + c * spread[1]
    m[2] = generator.uniform(-math.pi, math.pi)
    return m


@jax.jit
def violations_of(model: WorkcellModel, problems: Problem, x: Variables) -> Violations:
    """Of points, whatever a solver says of them."""
    geometry = measure(model, lay_out(problems, x))
    return largest_violations(evaluate_constraints(model, problems, x, geometry))


def written_out(system: BorderedSystem) -> Floats:
    """A system's matrix as `dvr_jax.nlp.system` describes it, block by block, lower triangle first."""
    T, D, M = system.border.shape
    H = np.zeros((T * D + M, T * D + M))
    H[T * D :, T * D :] = system.corner
    for t in range(T):
        rows = slice(t * D, (t + 1) * D)
        H[rows, rows] = system.diagonal[t]
        H[T * D :, rows] = np.transpose(system.border[t])
        if system.coupling is not None and t >= 1:
            H[rows, (t - 1) * D : t * D] = system.coupling[t]
        if system.far_coupling is not None and t >= 2:
            H[rows, (t - 2) * D : (t - 1) * D] = np.diag(system.far_coupling[t])
    return np.tril(H) + np.tril(H, -1).T
