"""What "feasible" means: each kind of violation on both sides of its tolerance, NaN, and half a turn at a switch."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from nlp_cases import FACING, SCENE, grasp, place, stack

from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS
from dvr_jax.nlp.blocks.straight_motion import CORRIDOR, LIFT_CORRIDOR
from dvr_jax.nlp.evaluation import (
    TOLERANCES,
    Violations,
    evaluate_constraints,
    relative_violation,
    violations_of,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import SliceGeometry, measure
from dvr_jax.nlp.transcription import transcribe
from dvr_jax.runtime.compilation import Program
from dvr_jax.workcell.model import WorkcellModel

EXPECTED = {
    "penetration": 1e-3,
    "position": 1e-3,
    "rotation": 1e-2,
    "rest": 3e-3,
    "joint_limit": 1e-3,
    "parameter_bound": 1e-3,
    "footprint": 1e-3,
    "kept_clear": 1e-3,
    "on_top": 1e-3,
    "sideways": 2e-3,
    "turn": 2e-2,
    "approach": 2e-3,
    "corridor": 1e-3,
}
"""Tolerances [m or rad], as the paper's successor has them (rest, bounds and footprints: their own)."""

STEPS = 3
SAMPLES = 2
"""Of each interval: one in its middle, and one at its slice."""

SHORT = 1e-10
"""Length of a straight motion that every motion has [m]."""

ROOM = 0.1
"""How far the placed object's footprint is from the border of its support, and from a region that stays clear [m]."""

REGION = 0.05
"""Half the width of that region [m]."""

lay_out_program = Program(lay_out)
measure_program = Program(measure)
constraints_program = Program(evaluate_constraints)


def measure_all(model: WorkcellModel, problems: Problem, x: Variables) -> SliceGeometry:
    return measure_program(model, lay_out_program(problems, x))


def judge(
    model: WorkcellModel, problems: Problem, x: Variables, geometry: SliceGeometry
) -> Violations:
    return violations_of(constraints_program(model, problems, x, geometry))


@dataclass(frozen=True)
class Point:
    """A path of a grasp and a placement, and what is changed of its geometry."""

    model: WorkcellModel
    problem: Problem
    x: Variables
    clearance: tuple[tuple[int, int, float], ...] = ()
    """Distances [m] of some samples and rows; all others are 0.2."""

    broken: str = ""
    """What is not a number: one of "hand" and "distance"."""

    def violations(self) -> Violations:
        problems, x = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (self.problem, self.x))
        geometry: SliceGeometry = jax.tree.map(np.array, measure_all(self.model, problems, x))
        geometry.distance[:] = 0.2
        for sample, row, value in self.clearance:
            geometry.distance[sample, row] = value
        if self.broken == "distance":
            geometry.distance[1, 5] = np.nan
        if self.broken == "hand":
            geometry.hands.position[0, 0, 1] = np.nan
        return jax.tree.map(
            lambda value: np.asarray(value)[0], judge(self.model, problems, x, geometry)
        )

    def with_problem(self, **changes: np.ndarray) -> "Point":
        return replace(self, problem=self.problem._replace(**changes))


@pytest.fixture(scope="module")
def good() -> Point:
    """Both arms at home, where the hands point straight down, and the box put so that its grasp with parameters zero
    fits exactly; it is placed where it is, as if the table were there."""
    problem = transcribe(SCENE, [grasp("left", "+x", "yellow"), place("left", "yellow", "goal")])
    K = 2
    x = Variables(np.tile(problem.home, (K * STEPS, 1)), np.zeros((K, 4)))
    path = problem._replace(
        regularization_target=x.q,
        regularization_weight=np.ones_like(x.q),
        sample_fraction=np.tile([0.5, 1.0], (K * STEPS, 1)),
        sample_offset=np.zeros((K * STEPS, SAMPLES, x.q.shape[1])),
        clearance=np.repeat(problem.clearance, STEPS, axis=0),
        straight_distance=np.where(problem.straight_distance > 0, SHORT, 0),
    )
    geometry = measure_all(FACING.model, stack([path]), jax.tree.map(lambda leaf: leaf[None], x))
    R = np.asarray(geometry.hands.rotation)[:, :, 0, 0].T
    center = np.asarray(geometry.hands.position)[:, 0, 0]
    np.testing.assert_allclose(R[:, 2], [0, 0, -1], atol=1e-12)

    # At face +x the fingers close along the box's own x.
    yaw = float(np.arctan2(R[1, 1], R[0, 1]))
    pose, prism, support, m = (
        path.initial_pose.copy(),
        path.prism.copy(),
        path.support.copy(),
        x.m.copy(),
    )
    pose[0] = [*center, yaw]
    prism[0, 2] = center[2]
    m[1, :3] = [center[0], center[1], yaw]
    support[1] = [center[0], center[1], yaw, prism[0, 0] + ROOM, prism[0, 1] + ROOM]
    path = path._replace(initial_pose=pose, prism=prism, support=support)
    path = path._replace(kept_clear=clear_region(path, -ROOM), **lower_object(path, m, -ROOM))
    return Point(FACING.model, path, x._replace(m=m))


def lower_object(problem: Problem, m: np.ndarray, beyond: float) -> dict[str, np.ndarray]:
    """The second action puts its object on another one, beyond the side +x of the allowed area by a length [m]."""
    pose = problem.initial_pose.copy()
    turn = 0.3
    away = REGION + ROOM + beyond
    pose[1, :2] = m[1, :2] - away * np.array([np.cos(turn), np.sin(turn)])
    pose[1, 3] = turn
    half = np.zeros((2, 1, 2))
    half[1] = REGION + ROOM
    return {"initial_pose": pose, "top_object": np.array([[0], [1]], np.int32), "top_half": half}


def clear_region(problem: Problem, covered: float) -> np.ndarray:
    """A region beside the placed object, along its x axis, that the object covers by a depth [m]."""
    x, y, yaw = problem.support[1, :3]
    away = problem.prism[0, 0] + REGION - covered
    region = [x + away * np.cos(yaw), y + away * np.sin(yaw), yaw, REGION, REGION]
    return np.array([[np.zeros(5)], [region]])


def violate(point: Point, kind: str, amount: float) -> Point:
    """One violation of this kind and size."""
    problem = point.problem
    if kind == "position":
        pose = problem.initial_pose.copy()
        pose[0, :3] += np.array([2, -1, 2]) / 3 * amount
        return point.with_problem(initial_pose=pose)
    if kind == "rotation":
        pose = problem.initial_pose.copy()
        pose[0, 3] += amount
        return point.with_problem(initial_pose=pose)
    if kind == "penetration":
        return replace(point, clearance=((2, 3, -amount),))
    if kind == "joint_limit":
        limits = point.model.joint_limits.copy()
        limits[0, 3] = problem.home[3] + amount
        return replace(point, model=replace(point.model, joint_limits=limits))
    if kind == "parameter_bound":
        lower = problem.parameter_lower.copy()
        lower[0, 1] = amount
        return point.with_problem(parameter_lower=lower)
    if kind == "footprint":
        support = problem.support.copy()
        support[1, 4] -= ROOM + amount
        return point.with_problem(support=support)
    if kind == "kept_clear":
        return point.with_problem(kept_clear=clear_region(problem, amount))
    if kind == "on_top":
        return point.with_problem(**lower_object(problem, point.x.m, amount))
    if kind == "approach":
        return point.with_problem(straight_distance=np.array([[0.0, amount], [0.0, 0.0]]))
    if kind in ("sideways", "turn"):
        # At the far slice of the first grasp the last joint turns the hand about its approach, and the first one moves
        # it aside.
        q = point.x.q.copy()
        if kind == "turn":
            q[0, 6] += amount
        else:
            q[0, 0] += 2 * np.arcsin(amount / 2 / _radius(point))
        return replace(point, x=point.x._replace(q=q))
    if kind == "corridor":
        offset = problem.sample_offset.copy()
        offset[1, 0, 0] = np.arcsin((CORRIDOR + amount) / _radius(point))
        return point.with_problem(sample_offset=offset)
    assert kind == "rest"
    # Before the first switch, which keeps its own posture.
    q = point.x.q.copy()
    q[1, 2] -= amount
    q[0, 2] -= amount
    return replace(point, x=point.x._replace(q=q))


def _radius(point: Point) -> float:
    """Distance of the left gripper from the first joint's axis [m]."""
    base = point.problem.base_position[0, :2]
    return float(np.linalg.norm(point.x.m[1, :2] - base))


def is_feasible(violations: Violations) -> bool:
    """As solvers judge."""
    return bool(relative_violation(violations) <= 1)


def test_tolerances_are_those_of_the_blocks() -> None:
    assert TOLERANCES == EXPECTED
    names = [measure.name for block in CONSTRAINT_BLOCKS for measure in block.measures]
    assert len(set(names)) == len(names)


def test_no_violation(good: Point) -> None:
    violations = good.violations()
    assert set(violations) == set(EXPECTED)
    for value in violations.values():
        assert 0 <= float(value) < 2e-9
    assert is_feasible(violations)


@pytest.mark.parametrize("kind", EXPECTED)
def test_both_sides_of_each_tolerance(good: Point, kind: str) -> None:
    for factor, feasible in ((0.99, True), (1.01, False)):
        violations = violate(good, kind, factor * EXPECTED[kind]).violations()
        for name, value in violations.items():
            if kind == "sideways" and name in ("turn", "corridor"):
                # The joint that moves the hand aside also turns it a little, and half-way it is half as far aside.
                assert 0 <= float(value) < EXPECTED[name]
                continue
            expected = factor * EXPECTED[name] if name == kind else 0
            assert float(value) == pytest.approx(expected, rel=1e-6, abs=1e-9)
        assert is_feasible(violations) is feasible
        assert float(relative_violation(violations)) == pytest.approx(factor, rel=1e-6)


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_held_object_is_lifted_in_a_wide_corridor(good: Point, factor: float) -> None:
    """The first joint moves the object aside in the first slice after the grasp."""
    q = good.x.q.copy()
    aside = LIFT_CORRIDOR + factor * EXPECTED["corridor"]
    q[STEPS, 0] += np.arcsin(aside / _radius(good))
    violations = replace(good, x=good.x._replace(q=q)).violations()
    assert float(violations["corridor"]) == pytest.approx(factor * EXPECTED["corridor"], rel=1e-4)
    assert float(violations["sideways"]) < 2e-9 and float(violations["turn"]) < 2e-9
    assert is_feasible(violations) is (factor < 1)


@pytest.mark.parametrize("kind", EXPECTED)
def test_the_largest_ratio_counts(good: Point, kind: str) -> None:
    """Not the largest number, nor a sum."""
    other = "penetration" if kind != "penetration" else "rotation"
    point = violate(violate(good, kind, 0.7 * EXPECTED[kind]), other, 0.8 * EXPECTED[other])
    assert float(relative_violation(point.violations())) == pytest.approx(0.8, rel=1e-6)


def test_an_arm_that_takes_no_part_need_not_rest(good: Point) -> None:
    q = good.x.q.copy()
    q[1:, 9] += 0.2
    assert is_feasible(replace(good, x=good.x._replace(q=q)).violations())


def test_an_arm_need_not_rest_after_its_switch(good: Point) -> None:
    """It comes back before the next one: only the interval before a switch counts."""
    q = good.x.q.copy()
    q[0, 9] += 0.2
    assert is_feasible(replace(good, x=good.x._replace(q=q)).violations())


def test_keyframes_need_not_rest(good: Point) -> None:
    q = good.x.q[::STEPS].copy()
    q[0, 9] += 0.2
    point = replace(good, x=good.x._replace(q=q)).with_problem(
        **{
            name: getattr(good.problem, name)[::STEPS]
            for name in (
                "regularization_target",
                "regularization_weight",
                "sample_fraction",
                "sample_offset",
                "clearance",
            )
        }
    )
    violations = point.violations()
    assert float(violations["rest"]) == 0
    assert is_feasible(violations)


@pytest.mark.parametrize("where", ["q", "m", "hand", "distance"])
def test_nan_is_infeasible(good: Point, where: str) -> None:
    if where in Variables._fields:
        value = getattr(good.x, where).copy()
        value[1, 2] = np.nan
        point = replace(good, x=good.x._replace(**{where: value}))
    else:
        point = replace(good, broken=where)
    violations = point.violations()
    assert not is_feasible(violations)
    assert relative_violation(violations) == np.inf


@pytest.mark.parametrize("kind", EXPECTED)
@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_what_is_not_finite_is_infeasible(kind: str, value: float) -> None:
    """On the host and in compiled programs, in one lane among others."""
    violations = {name: np.zeros(3) for name in TOLERANCES}
    violations[kind][1] = value
    for found in (violations, jax.tree.map(jnp.asarray, violations)):
        np.testing.assert_array_equal(relative_violation(found), [0, np.inf, 0])


@pytest.mark.parametrize("turn", [np.pi, -np.pi])
def test_half_a_turn_at_a_switch_is_infeasible(good: Point, turn: float) -> None:
    """The object turned by pi about z: the rotation rows of the switch vanish there, the verdict does not."""
    point = violate(good, "rotation", turn)
    problems, x = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (point.problem, point.x))
    geometry = measure_all(point.model, problems, x)
    rows = constraints_program(point.model, problems, x, geometry)["mode_switch"].rows
    np.testing.assert_allclose(rows, 0, atol=1e-9)
    violations = point.violations()
    assert float(violations["rotation"]) == pytest.approx(np.pi, abs=1e-6)
    assert not is_feasible(violations)
