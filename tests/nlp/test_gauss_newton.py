"""The augmented Lagrangian, its gradient and Gauss-Newton matrix against their definitions and central differences."""

from functools import partial

import jax
import numpy as np
import pytest
from komo_cases import Floats, written_out

from dvr_jax.nlp.lagrangian import (
    EQUALITIES,
    FlatResiduals,
    Weights,
    accelerations,
    cost,
    gauss_newton_system,
    pack,
    residuals,
    scales,
    unpack,
)
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import reduce_slices
from dvr_jax.nlp.tolerances import rest_steps
from dvr_jax.solver.augmented_lagrangian import forces, update_multipliers
from dvr_jax.solver.banded import BorderedSystem
from dvr_jax.workcell.kinematics import load_arm

PENALTY = 20.0
WEIGHTS = Weights(acceleration=0.7, distance=1.1, position=0.9, rotation=0.2, limit=0.4, parameter=1.2, rest=0.5)
STEP = 1e-5
CONSTRAINTS = jax.jit(lambda problem, x, rows: pack(residuals(problem, x, rows)))
OBJECT_PAIRS = slice(-3, None)
"""ConstraintValues of objects against objects: wrenches are inexact past corners (tests/geometry), so these stay inactive here."""


class Lagrangian:
    """The augmented Lagrangian of one problem of a case, with multipliers that make half of the inequalities active."""

    def __init__(self, evaluated, b: int) -> None:
        self.evaluated, self.b = evaluated, b
        self.problem: Problem = jax.tree.map(lambda leaf: leaf[b], evaluated.case.problems)
        self.x: Variables = jax.tree.map(lambda leaf: leaf[b], evaluated.case.x)
        self.S = evaluated.case.steps
        self.T, self.K = self.x.q.shape[0], self.x.m.shape[0]
        self.p = FlatResiduals(*(PENALTY * scale for scale in scales(WEIGHTS, self.T, self.K, np.dtype(float))))
        self.c = self.constraints(self.x)
        generator = np.random.default_rng(b)
        multipliers = []
        for value, penalty, equality in zip(self.c, self.p, EQUALITIES, strict=True):
            penalty = np.broadcast_to(penalty, value.shape)
            random = generator.normal(size=value.shape)
            # An inequality is active where z + p g > 0.
            wanted = np.maximum(-penalty * value, 0) + np.abs(random)
            # Bounds that stand for none are 1e3 away: a force from there would drown all others in rounding.
            multipliers.append(random if equality else np.where((random > 0) & (value > -10), wanted, 0))
        self.multipliers = FlatResiduals(*multipliers)
        self.multipliers.distance[:, OBJECT_PAIRS] = 0

    def constraints(self, x: Variables) -> FlatResiduals:
        rows = self.rows([x])[0]
        return jax.tree.map(np.asarray, CONSTRAINTS(self.problem, x, rows))

    def rows(self, points: list[Variables]) -> list[object]:
        """ConstraintValues of this problem at points, as many at a time as the compiled batch holds."""
        B = self.evaluated.case.batch
        problems = jax.tree.map(lambda leaf: np.stack([leaf] * B), self.problem)
        results = []
        for i in range(0, len(points), B):
            chunk = points[i : i + B]
            batch = jax.tree.map(lambda *leaves: np.stack(leaves), *(chunk + chunk[:1] * (B - len(chunk))))
            rows, _, _ = self.evaluated.of(problems, batch)
            results += [jax.tree.map(lambda leaf, lane=lane: leaf[lane], rows) for lane in range(len(chunk))]
        return results

    def moves(self) -> list[Floats]:
        """Unit changes of all variables, joints slice by slice, then parameters, flattened."""
        return list(np.eye(self.x.q.size + self.x.m.size))

    def at(self, change: Floats) -> Variables:
        dq, dm = np.split(change, [self.x.q.size])
        return Variables(self.x.q + dq.reshape(self.x.q.shape), self.x.m + dm.reshape(self.x.m.shape))

    def differentiate(self, function) -> Floats:
        """Central differences, extrapolated from two steps, of a function of (variables, rows); variables first."""
        amounts = [STEP, -STEP, STEP / 2, -STEP / 2]
        points = [self.at(amount * move) for move in self.moves() for amount in amounts]
        values = np.array([function(x, rows) for x, rows in zip(points, self.rows(points), strict=True)])
        values = values.reshape(-1, 4, *values.shape[1:])
        whole = (values[:, 0] - values[:, 1]) / (2 * STEP)
        half = (values[:, 2] - values[:, 3]) / STEP
        return (4 * half - whole) / 3

    def active(self) -> FlatResiduals:
        """ConstraintValues that count: equalities, and inequalities with z + p g > 0."""
        return FlatResiduals(
            *(
                np.ones_like(value, dtype=bool) if equality else z + penalty * value > 0
                for value, z, penalty, equality in zip(self.c, self.multipliers, self.p, EQUALITIES, strict=True)
            )
        )

    def value(self, x: Variables, rows: object) -> float:
        """By the definition in the module's docstring, term by term."""
        c = CONSTRAINTS(self.problem, x, rows)
        total = np.sum(self.problem.attraction * (x.q - self.problem.reference) ** 2) / 2
        if self.S > 1:
            total += 0.5 * WEIGHTS.acceleration * np.sum(second_differences(self.problem, x.q) ** 2)
        for value, y, penalty, equality in zip(c, self.multipliers, self.p, EQUALITIES, strict=True):
            value = np.asarray(value)
            if equality:
                total += np.sum(y * value) + np.sum(penalty * value**2) / 2
            else:
                total += np.sum((np.maximum(0, y + penalty * value) ** 2 - y**2) / (2 * penalty))
        return float(total)

    def system(self) -> BorderedSystem:
        _, J, measured = self.evaluated.results
        slopes = jax.tree.map(lambda leaf: leaf[self.b], J.slopes)
        force, curvature, _ = forces(self.multipliers, self.c, self.p, EQUALITIES)
        # The slices of this problem among those of the batch.
        L, samples = len(measured.distance), self.evaluated.case.number_of_samples
        own = np.arange(L) // samples == self.b
        everything = force[0].shape[1]
        pushes = (np.zeros((L, everything)), np.zeros((L, everything)))
        for target, value in zip(pushes, (force[0], curvature[0]), strict=True):
            target[own] = value
        reduced = jax.tree.map(lambda leaf: leaf[own], jax.jit(reduce_slices)(measured, *pushes))
        build = jax.jit(partial(gauss_newton_system, weights=WEIGHTS))
        force, curvature = (unpack(FlatResiduals(*rows), self.T, self.K) for rows in (force, curvature))
        return build(self.problem, self.x, reduced, slopes, force, curvature)

    @property
    def free(self) -> Floats:
        """True for all joints and for the mode parameters that are not pinned."""
        return np.concatenate([np.ones(self.x.q.size, bool), np.ravel(self.problem.upper > self.problem.lower)])


def second_differences(problem: Problem, q: Floats) -> Floats:
    return np.diff(np.concatenate([np.tile(problem.home, (2, 1)), q]), n=2, axis=0)


CASES = [(name, index) for name in ("keyframes", "path") for index in range(3)] + [("coarse_path", 2)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{('handover', 'place', 'both')[case[1]]}")
def lagrangian(request: pytest.FixtureRequest) -> Lagrangian:
    """One point of each skeleton."""
    return Lagrangian(request.getfixturevalue(request.param[0]), request.param[1])


def test_accelerations_start_at_home_at_rest(path) -> None:
    sample = Lagrangian(path, 0)
    ours = accelerations(sample.problem, sample.x.q)
    np.testing.assert_allclose(ours, second_differences(sample.problem, sample.x.q), atol=1e-13)


def test_rest_steps_are_those_into_the_switches(path) -> None:
    sample = Lagrangian(path, 0)
    S, resting = sample.S, sample.problem.resting
    expected = [
        (sample.x.q[(k + 1) * S - 1] - sample.x.q[(k + 1) * S - 2]) * np.repeat(resting[k], 7) for k in range(sample.K)
    ]
    np.testing.assert_allclose(rest_steps(sample.problem, sample.x), expected, atol=1e-15)


def test_residuals_are_those_of_limits_and_bounds(lagrangian: Lagrangian) -> None:
    lower, upper = np.tile(load_arm().joint_limits, 2)
    x, problem = lagrangian.x, lagrangian.problem
    c = unpack(lagrangian.c, lagrangian.T, lagrangian.K)
    np.testing.assert_allclose(c.limit, [lower - x.q, x.q - upper])
    np.testing.assert_allclose(c.bound, [problem.lower - x.m, x.m - problem.upper])
    assert c.rest.any() == (lagrangian.S > 1)


def test_value_is_the_definition(lagrangian: Lagrangian) -> None:
    _, _, total = forces(lagrangian.multipliers, lagrangian.c, lagrangian.p, EQUALITIES)
    ours = cost(lagrangian.problem, lagrangian.x, WEIGHTS) + total
    expected = lagrangian.value(lagrangian.x, lagrangian.rows([lagrangian.x])[0])
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


def test_gradient(lagrangian: Lagrangian) -> None:
    """Of the system against central differences of the value, which is C1 where the distances are."""
    system = lagrangian.system()
    ours = np.concatenate([np.ravel(system.gradient_q), system.gradient_m])
    expected = np.where(lagrangian.free, lagrangian.differentiate(lagrangian.value), 0)
    scale = np.abs(expected).max()
    assert scale > 1
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6 * scale)


def test_gauss_newton_matrix(lagrangian: Lagrangian) -> None:
    """Against J^T J of all costs, equalities and active inequalities, J by central differences of all residuals."""
    active = lagrangian.active()
    inequalities = [np.ravel(on) for on, equality in zip(active, EQUALITIES, strict=True) if not equality]
    share = np.concatenate(inequalities).mean()
    assert 0.3 < share < 0.7

    def scaled(x: Variables, rows: object) -> Floats:
        c = CONSTRAINTS(lagrangian.problem, x, rows)
        parts = [np.ravel(np.sqrt(lagrangian.problem.attraction) * x.q)]
        if lagrangian.S > 1:
            parts.append(np.sqrt(WEIGHTS.acceleration) * np.ravel(second_differences(lagrangian.problem, x.q)))
        for value, penalty, on in zip(c, lagrangian.p, active, strict=True):
            parts.append((np.sqrt(penalty) * np.asarray(value))[on])
        return np.concatenate(parts)

    J = lagrangian.differentiate(scaled).T
    free = lagrangian.free
    expected = J.T @ J * free * free[:, None] + np.diag((~free).astype(float))
    ours = written_out(lagrangian.system())
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(ours, ours.T, rtol=1e-9, atol=1e-11)


def test_pinned_parameters_do_not_move(lagrangian: Lagrangian) -> None:
    system = lagrangian.system()
    pinned = np.ravel(lagrangian.problem.upper == lagrangian.problem.lower)
    assert pinned.any()
    assert not np.asarray(system.gradient_m)[pinned].any()
    assert not np.asarray(system.border)[..., pinned].any()
    np.testing.assert_array_equal(np.asarray(system.corner)[pinned], np.eye(len(pinned))[pinned])


def test_multiplier_update(lagrangian: Lagrangian) -> None:
    """First order: y + p h for equalities, max(0, z + p g) for inequalities."""
    updated = update_multipliers(lagrangian.multipliers, lagrangian.c, lagrangian.p, EQUALITIES)
    for new, y, value, penalty, equality in zip(
        updated, lagrangian.multipliers, lagrangian.c, lagrangian.p, EQUALITIES, strict=True
    ):
        expected = y + penalty * value
        np.testing.assert_allclose(new, expected if equality else np.maximum(expected, 0), atol=1e-12)


def test_penalties_follow_their_weights() -> None:
    T, K = 6, 3
    p = unpack(scales(WEIGHTS, T, K, np.dtype(float)), T, K)
    np.testing.assert_allclose(p.switch, [[0.9, 0.9, 0.9, 0.2, 0.2, 0.2]] * K)
    for value, shape, weight in (
        (p.distance, (), 1.1),
        (p.rest, (K, 14), 0.5),
        (p.limit, (2, T, 14), 0.4),
        (p.bound, (2, K, 4), 1.2),
        (p.footprint, (K, 4), 1.2),
    ):
        np.testing.assert_allclose(value, np.full(shape, weight))
