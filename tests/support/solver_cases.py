"""Random starts of keyframe NLPs for the tests of the solver, in the scene of `nlp_cases`."""

import math

import numpy as np
from nlp_cases import SCENE, Floats

from dvr_jax.modes.mode import PARAMETERS, ModeKind
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.operators.grasp import PITCH_RANGE
from dvr_jax.workcell.model import WorkcellModel, workcell_model

MODEL: WorkcellModel = workcell_model(SCENE.workcell)

NEAR_HOME = 0.5
"""Standard deviation of random postures near home [rad]."""

INNER_FRACTION = 0.8
"""Fraction of a support's half extents that random placements are drawn from."""

JOINTS = SCENE.workcell.number_of_joints


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
