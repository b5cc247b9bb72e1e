"""What "feasible" means: each kind of violation on both sides of its tolerance, NaN, and half a turn at a switch."""

import jax
import numpy as np
import pytest
from komo_cases import SCENE, Floats, grasp, place

from dvr_jax.nlp.constraints import ConstraintValues
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.tolerances import Violations, measure_violations
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.workcell.kinematics import load_arm

K, ROWS = 2, 5


def is_feasible(violations: Violations) -> np.ndarray:
    """As solvers judge."""
    return np.asarray(violations.ratio() <= 1)


TOLERANCES = {
    "position": 1e-3,
    "rotation": 1e-2,
    "penetration": 1e-3,
    "joint_limit": 1e-3,
    "parameter": 1e-3,
    "rest": 3e-3,
}
"""As design.md has them (rest and parameters: the module's own)."""


@pytest.fixture
def problem() -> Problem:
    return transcribe(SCENE, [grasp("left", "+x", "yellow"), place("left", "yellow", "goal")])


def good_point(problem: Problem, steps: int = 2) -> tuple[Variables, ConstraintValues]:
    """Variables and rows without any violation."""
    x = Variables(np.tile(problem.home, (K * steps, 1)), np.zeros((K, 4)))
    rows = ConstraintValues(np.full((K * steps, ROWS), 0.2), np.zeros((K, 6)), np.zeros(K), np.full((K, 4), -0.1))
    return x, rows


def violate(kind: str, amount: float, x: Variables, rows: ConstraintValues) -> tuple[Variables, ConstraintValues]:
    """One violation of this kind and size."""
    q, m = np.array(x.q), np.array(x.m)
    distance, switch, angle, footprint = (np.array(value) for value in rows)
    if kind == "position":
        switch[1, :3] = np.array([2, -1, 2]) / 3 * amount
    elif kind == "rotation":
        angle[0] = amount
    elif kind == "penetration":
        distance[2, 3] = -amount
    elif kind == "joint_limit":
        q[:, 10] = load_arm().joint_limits[0, 3] - amount
    elif kind == "parameter":
        m[0, 1] = 0.04 + amount
    elif kind == "footprint":
        footprint[1, 2] = amount
    else:
        q[1:, 2] += amount
    return Variables(q, m), ConstraintValues(distance, switch, angle, footprint)


def test_no_violation(problem: Problem) -> None:
    violations = measure_violations(problem, *good_point(problem))
    assert all(float(value) == 0 for value in violations)
    assert is_feasible(violations)


@pytest.mark.parametrize("kind", [*TOLERANCES, "footprint"])
def test_both_sides_of_each_tolerance(problem: Problem, kind: str) -> None:
    field = "parameter" if kind == "footprint" else kind
    for factor, feasible in ((0.99, True), (1.01, False)):
        violations = measure_violations(problem, *violate(kind, factor * TOLERANCES[field], *good_point(problem)))
        for name, value in violations._asdict().items():
            assert float(value) == pytest.approx(factor * TOLERANCES[name] if name == field else 0, rel=1e-6)
        assert bool(is_feasible(violations)) is feasible
        assert float(violations.ratio()) == pytest.approx(factor, rel=1e-6)


def test_an_arm_that_takes_no_part_need_not_rest(problem: Problem) -> None:
    x, rows = good_point(problem)
    x.q[1:, 9] += 0.2
    assert is_feasible(measure_violations(problem, x, rows))


def test_keyframes_need_not_rest(problem: Problem) -> None:
    x, rows = good_point(problem, steps=1)
    x.q[1:, 2] += 0.2
    assert is_feasible(measure_violations(problem, x, rows))


@pytest.mark.parametrize("where", ["q", "m", *ConstraintValues._fields])
def test_nan_is_infeasible(problem: Problem, where: str) -> None:
    x, rows = good_point(problem)
    place_of = x if where in Variables._fields else rows
    getattr(place_of, where).flat[0] = np.nan
    assert not is_feasible(measure_violations(problem, x, rows))
    assert measure_violations(problem, x, rows).ratio() == np.inf


def test_infinity_is_infeasible() -> None:
    assert not is_feasible(Violations(*[np.zeros(())] * 5, np.array(np.inf)))


@pytest.fixture
def gripped_upright(keyframes) -> tuple[Problem, Variables, Floats]:
    """The keyframe problems with both arms at home, where the hands point straight down, and objects put so that the
    first action's grasp with parameters zero fits its object exactly."""
    case = keyframes.case
    B, number = case.problems.switched_object.shape
    x = Variables(np.tile(case.problems.home[:, None], (1, number, 1)), np.zeros((B, number, 4)))
    rows, _, _ = keyframes.of(case.problems, x)
    # The switch residual is the object's position minus where the grasp would have it; its angle tells the yaw.
    first = case.problems.switched_object[:, 0]
    initial = np.array(case.problems.initial_pose)
    lanes = np.arange(B)
    initial[lanes, first, :3] -= rows.switch[:, 0, :3]
    initial[lanes, first, 3] -= 2 * np.arctan2(rows.switch[:, 0, 5] / 2, np.cos(rows.switch_angle[:, 0] / 2))
    return case.problems._replace(initial_pose=initial), x, first


def first_switch(keyframes, problems: Problem, x: Variables) -> tuple[Violations, Floats]:
    """Violations of the first switch alone, and its residual."""
    rows, _, _ = keyframes.of(problems, x)
    alone = ConstraintValues(
        np.ones_like(rows.distance), *(np.array(value) for value in rows[1:3]), -np.ones_like(rows.footprint)
    )
    alone.switch[:, 1:], alone.switch_angle[:, 1:] = 0, 0
    return jax.vmap(measure_violations)(problems, x, alone), rows.switch[:, 0]


def test_an_exact_grasp_is_feasible(keyframes, gripped_upright) -> None:
    problems, x, _ = gripped_upright
    violations, _ = first_switch(keyframes, problems, x)
    assert np.asarray(violations.position).max() < 1e-9
    assert np.asarray(violations.rotation).max() < 1e-9
    assert is_feasible(violations).all()


def test_half_a_turn_at_a_switch_is_infeasible(keyframes, gripped_upright) -> None:
    """The object turned by pi about z: the residual's rotation rows vanish there, the verdict does not."""
    problems, x, first = gripped_upright
    initial = np.array(problems.initial_pose)
    initial[np.arange(len(first)), first, 3] += np.pi
    violations, residual = first_switch(keyframes, problems._replace(initial_pose=initial), x)
    np.testing.assert_allclose(residual, 0, atol=1e-9)
    np.testing.assert_allclose(violations.rotation, np.pi, atol=1e-6)
    assert not is_feasible(violations).any()
