"""The augmented Lagrangian, its gradient and Gauss-Newton matrix against their definitions and central differences."""

from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from nlp_cases import Floats, written_out

from dvr_jax.modes.mode import PARAMETERS, ModeKind
from dvr_jax.nlp.blocks import CONSTRAINT_BLOCKS, ConstraintBlock, ConstraintKind, Horizon
from dvr_jax.nlp.cost import ACCELERATION_WEIGHT, accelerations, add_cost, cost
from dvr_jax.nlp.evaluation import (
    FlatResiduals,
    flatten,
    gauss_newton_system,
    horizon_of,
    number_of_flat_rows,
    row_scales,
    unflatten,
)
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import NormalEquations, reduce_slices
from dvr_jax.nlp.system import BorderedSystem, SystemParts, assemble
from dvr_jax.runtime.compilation import Program

PENALTY = 20.0
STEP = 1e-5
HALF_TURN = 2.9
"""As documented (`half_rotation_vector`) [rad]."""

SCALES = {
    "collision": 1.0,
    "mode_switch": [1.0, 1.0, 1.0, 0.1, 0.1, 0.1],
    "rest": 0.1,
    "joint_limit": 0.1,
    "parameter_bound": 1.0,
    "footprint": 1.0,
    "kept_clear": 1.0,
    "on_top": 1.0,
    "straight_line": [1.0, 1.0, 0.1, 0.1, 0.1],
    "straight_corridor": 1.0,
}
"""Penalty of each block's rows relative to the common one."""

Rows = dict[str, Floats]
BLOCKS = {block.name: block for block in CONSTRAINT_BLOCKS}
reduce_collisions = Program(reduce_slices)


def is_equality(name: str) -> bool:
    return BLOCKS[name].kind is ConstraintKind.EQUALITY


class Lagrangian:
    """The augmented Lagrangian of one problem of a case, with multipliers that make half of the inequalities active."""

    def __init__(self, evaluated, b: int) -> None:
        self.evaluated, self.b = evaluated, b
        self.problem: Problem = jax.tree.map(lambda leaf: leaf[b], evaluated.case.problems)
        self.x: Variables = jax.tree.map(lambda leaf: leaf[b], evaluated.case.x)
        self.S = evaluated.case.steps
        self.T, self.K = self.x.q.shape[0], self.x.m.shape[0]
        self.D = self.x.q.shape[1]
        self.horizon: Horizon = horizon_of(evaluated.model, self.problem, self.x)
        self.rows: Rows = {name: rows[b] for name, rows in evaluated.results.rows.items()}
        self.penalty = {
            name: PENALTY * np.broadcast_to(SCALES[name], rows.shape)
            for name, rows in self.rows.items()
        }

        # Rows of two bodies: wrenches are inexact past corners (tests/geometry), so these stay inactive here.
        case = evaluated.case
        N = case.number_of_objects
        self.inexact = N * (N - 1) // 2 + N * case.setting.number_of_fixed

        generator = np.random.default_rng(b)
        self.multipliers: Rows = {}
        for name, value in self.rows.items():
            random = generator.normal(size=value.shape)
            # An inequality is active where z + p g > 0.
            wanted = np.maximum(-self.penalty[name] * value, 0) + np.abs(random)
            # Bounds that stand for none are 1e3 away: a force from there would drown all others in rounding.
            inequality = np.where((random > 0) & (value > -10), wanted, 0)
            self.multipliers[name] = random if is_equality(name) else inequality
        self.multipliers["collision"][:, -self.inexact :] = 0

    @cached_property
    def differences(self) -> tuple[list[Variables], list[Rows]]:
        """Points at both sides of this one, at the whole and half the step along each variable, and their rows."""
        amounts = [STEP, -STEP, STEP / 2, -STEP / 2]
        moves = np.eye(self.x.q.size + self.x.m.size)
        points = [self.at(amount * move) for move in moves for amount in amounts]
        return points, self.rows_at(points)

    def at(self, change: Floats) -> Variables:
        dq, dm = np.split(change, [self.x.q.size])
        return Variables(
            self.x.q + dq.reshape(self.x.q.shape), self.x.m + dm.reshape(self.x.m.shape)
        )

    def rows_at(self, points: list[Variables]) -> list[Rows]:
        """Rows of this problem at points, as many at a time as the compiled batch holds."""
        B = self.evaluated.case.batch
        problems = jax.tree.map(lambda leaf: np.stack([leaf] * B), self.problem)
        found: list[Rows] = []
        for i in range(0, len(points), B):
            chunk = points[i : i + B]
            batch = jax.tree.map(
                lambda *leaves: np.stack(leaves), *(chunk + chunk[:1] * (B - len(chunk)))
            )
            rows = self.evaluated.rows_of(problems, batch)
            found += [
                {name: value[lane] for name, value in rows.items()} for lane in range(len(chunk))
            ]
        return found

    def differentiate(self, values: list[Floats]) -> Floats:
        """Central differences, extrapolated from two steps, of what was taken at `differences`; variables first."""
        by_move = np.array(values).reshape(-1, 4, *np.shape(values[0]))
        whole = (by_move[:, 0] - by_move[:, 1]) / (2 * STEP)
        half = (by_move[:, 2] - by_move[:, 3]) / STEP
        return (4 * half - whole) / 3

    def jacobian(self, name: str) -> Floats:
        """Numeric derivatives (variables, rows) of one block."""
        return self.differentiate([rows[name].ravel() for rows in self.differences[1]])

    def active(self) -> dict[str, Floats]:
        """Rows that count: equalities, and inequalities with z + p g > 0."""
        return {
            name: np.ones(value.shape, bool)
            if is_equality(name)
            else self.multipliers[name] + self.penalty[name] * value > 0
            for name, value in self.rows.items()
        }

    def value(self, x: Variables, rows: Rows) -> float:
        """By the definition in the modules' docstrings, term by term."""
        weight, target = self.problem.regularization_weight, self.problem.regularization_target
        total = np.sum(weight * (x.q - target) ** 2) / 2
        preference = self.problem.preference_scale * self.problem.preference
        total += np.sum(preference * x.m**2) / 2
        if self.S > 1:
            total += 0.5 * ACCELERATION_WEIGHT * np.sum(second_differences(self.problem, x.q) ** 2)
        for name, value in rows.items():
            y, penalty = self.multipliers[name], self.penalty[name]
            if is_equality(name):
                total += np.sum(y * value) + np.sum(penalty * value**2) / 2
            else:
                total += np.sum((np.maximum(0, y + penalty * value) ** 2 - y**2) / (2 * penalty))
        return float(total)

    def flat(self, rows: Rows) -> FlatResiduals:
        return jax.tree.map(np.asarray, flatten(rows))

    def reduce(self, estimate: Floats, penalty: Floats) -> NormalEquations:
        """Sums of the distances of this problem, whose slices are among those of the batch."""
        geometry = self.evaluated.results.geometry
        L, samples = len(geometry.distance), self.evaluated.case.number_of_samples
        own = np.arange(L) // samples == self.b
        everything = estimate.shape[1]
        both = (np.zeros((L, everything)), np.zeros((L, everything)))
        for target, value in zip(both, (estimate, penalty), strict=True):
            target[own] = value
        reduced = reduce_collisions(self.evaluated.model, geometry, *both)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[own], reduced)

    def jacobians(self, estimate: Floats, penalty: Floats) -> dict[str, object]:
        """Derivatives as blocks take them: sums in place of those of the distances."""
        own = jax.tree.map(lambda leaf: leaf[self.b], self.evaluated.results.jacobians)
        return {**own, "collision": self.reduce(estimate, penalty)}

    def system(self, gradient_scale: float = 1.0) -> BorderedSystem:
        """The whole system, with multiplier estimates and active penalties by their definition."""
        estimate = {}
        penalty = {}
        for name, value in self.rows.items():
            estimate[name] = self.multipliers[name] + self.penalty[name] * value
            penalty[name] = np.broadcast_to(self.penalty[name], value.shape)
            if not is_equality(name):
                estimate[name] = np.maximum(estimate[name], 0)
                penalty[name] = np.where(estimate[name] > 0, penalty[name], 0)
        jacobians = self.jacobians(estimate["collision"], penalty["collision"])
        return gauss_newton_system(
            self.problem, self.x, jacobians, estimate, penalty, gradient_scale
        )

    def no_parts(self) -> SystemParts:
        T, D, M = self.T, self.D, PARAMETERS * self.K
        return SystemParts(
            blocks=np.zeros((T, D, D)),
            joint_diagonal=np.zeros((T, D)),
            coupling=np.zeros((T, D, D)),
            coupling_diagonal=np.zeros((T, D)),
            far_coupling=np.zeros((T, D)),
            border=np.zeros((T, D, M)),
            corner=np.zeros((M, M)),
            gradient_q=np.zeros((T, D)),
            gradient_m=np.zeros(M),
        )

    @property
    def free(self) -> Floats:
        """True for all joints and for the mode parameters that are not pinned."""
        is_free = np.ravel(self.problem.parameter_upper > self.problem.parameter_lower)
        return np.concatenate([np.ones(self.x.q.size, bool), is_free])


def second_differences(problem: Problem, q: Floats) -> Floats:
    return np.diff(np.concatenate([np.tile(problem.home, (2, 1)), q]), n=2, axis=0)


def gradient_of(system: BorderedSystem) -> Floats:
    return np.concatenate([np.ravel(system.gradient_q), system.gradient_m])


NAMES = {0: "handover", 1: "place", 2: "both"}
CASES = [
    *[(name, index) for name in ("keyframes", "path") for index in range(3)],
    ("coarse_path", 2),
    ("fixed_bodies", 0),
    ("side_by_side", 0),
    ("single_arm", 0),
]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{NAMES[case[1]]}")
def lagrangian(request: pytest.FixtureRequest) -> Lagrangian:
    """The first point of a skeleton without a switch close to half a turn, where rows are no longer the quaternion."""
    name, skeleton = request.param
    evaluated = request.getfixturevalue(name)
    _, angles = evaluated.results.violations["mode_switch"]
    lanes = range(skeleton, evaluated.case.batch, len(evaluated.case.setting.skeletons))
    return Lagrangian(evaluated, next(b for b in lanes if angles[b] < HALF_TURN))


def test_accelerations_start_at_home_at_rest(path) -> None:
    sample = Lagrangian(path, 0)
    ours = accelerations(sample.problem, sample.x.q)
    np.testing.assert_allclose(ours, second_differences(sample.problem, sample.x.q), atol=1e-13)


def test_rest_rows_are_the_steps_of_resting_arms(lagrangian: Lagrangian) -> None:
    S, rest = lagrangian.S, lagrangian.rows["rest"]
    if S == 1:
        assert rest.shape == (0, 3, lagrangian.D)
        return
    q, joints = lagrangian.x.q, lagrangian.evaluated.model.structure.joints
    problem = lagrangian.problem
    for k in range(lagrangian.K):
        after = [k * S, (k + 1) * S - 2, (k + 1) * S - 1]
        resting = [*problem.still_arm[k], problem.arm_at_rest[k]]
        for row, slice_after, arms in zip(rest[k], after, resting, strict=True):
            step = q[slice_after] - q[slice_after - 1] if slice_after else 0 * q[0]
            np.testing.assert_allclose(row, step * np.repeat(arms, joints), atol=1e-15)

    # In a handover the other arm holds the object still.
    rows = np.arange(lagrangian.K)
    was, becomes = (problem.mode_kind[rows + k, problem.switched_object] for k in (0, 1))
    is_handover = (was == ModeKind.HELD) & (becomes == ModeKind.HELD)
    assert problem.still_arm[:, 1].any(axis=1).tolist() == is_handover.tolist()


def test_rows_of_limits_and_bounds(lagrangian: Lagrangian) -> None:
    robot = lagrangian.evaluated.case.setting.scene.workcell.robot
    lower, upper = np.tile(robot.joint_limits, lagrangian.D // robot.number_of_joints)
    x, problem = lagrangian.x, lagrangian.problem
    np.testing.assert_allclose(lagrangian.rows["joint_limit"], [lower - x.q, x.q - upper])
    bounds = [problem.parameter_lower - x.m, x.m - problem.parameter_upper]
    np.testing.assert_allclose(lagrangian.rows["parameter_bound"], bounds)


def test_rows_have_the_shapes_of_their_blocks(lagrangian: Lagrangian) -> None:
    horizon = lagrangian.horizon
    case = lagrangian.evaluated.case
    assert (horizon.slices, horizon.phases, horizon.samples) == (
        lagrangian.T,
        lagrangian.K,
        case.samples,
    )
    assert (horizon.steps, horizon.is_path, horizon.joints) == (
        lagrangian.S,
        lagrangian.S > 1,
        lagrangian.D,
    )
    assert horizon.collision_rows == lagrangian.evaluated.distance.shape[-1]
    assert set(lagrangian.rows) == set(BLOCKS) == set(SCALES)
    for name, block in BLOCKS.items():
        assert lagrangian.rows[name].shape == block.shape(horizon)
    assert horizon_of(lagrangian.evaluated.model, case.problems, case.x) == horizon


def test_flat_rows_and_back(lagrangian: Lagrangian) -> None:
    """`unflatten` is the inverse of `flatten`, and every row has one place."""
    horizon = lagrangian.horizon
    first = 0
    numbered: Rows = {}
    for name, rows in lagrangian.rows.items():
        numbered[name] = np.arange(first, first + rows.size, dtype=float).reshape(rows.shape)
        first += rows.size
    flat = lagrangian.flat(numbered)
    assert tuple(value.shape for value in flat) == tuple(number_of_flat_rows(horizon))
    np.testing.assert_array_equal(
        np.sort(np.concatenate([np.ravel(value) for value in flat])), np.arange(first)
    )
    back = unflatten(flat, horizon)
    assert set(back) == set(numbered)
    for name, rows in numbered.items():
        np.testing.assert_array_equal(back[name], rows)
        kind = (
            flat.equality
            if is_equality(name)
            else flat.collision
            if name == "collision"
            else flat.inequality
        )
        assert np.isin(rows, kind).all()
    again = flatten(back)
    for ours, theirs in zip(again, flat, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_scales(lagrangian: Lagrangian) -> None:
    scales = row_scales(lagrangian.horizon, np.dtype(float))
    shapes = number_of_flat_rows(lagrangian.horizon)
    whole = FlatResiduals(
        *(np.broadcast_to(value, shape) for value, shape in zip(scales, shapes, strict=True))
    )
    for name, ours in unflatten(whole, lagrangian.horizon).items():
        np.testing.assert_allclose(ours, np.broadcast_to(SCALES[name], lagrangian.rows[name].shape))


@pytest.mark.parametrize("name", BLOCKS)
def test_contribution_of_each_block(lagrangian: Lagrangian, name: str) -> None:
    """``J^T y`` and ``J^T diag(p) J`` of one block alone, with a penalty of its own for every active row."""
    block: ConstraintBlock = BLOCKS[name]
    shape = lagrangian.rows[name].shape
    if 0 in shape:
        pytest.skip("keyframes have no such rows")
    generator = np.random.default_rng(7)
    is_active = np.ones(shape, bool) if is_equality(name) else generator.random(shape) < 0.5
    if name == "collision":
        is_active[:, -lagrangian.inexact :] = False
    penalty = np.where(is_active, generator.uniform(0.2, 3, shape), 0)
    estimate = generator.normal(size=shape)
    estimate = np.where(is_active, estimate if is_equality(name) else np.abs(estimate), 0)

    collisions = (
        (estimate, penalty)
        if name == "collision"
        else np.zeros((2, *lagrangian.rows["collision"].shape))
    )
    jacobian = lagrangian.jacobians(*collisions)[name]
    parts = block.add_to_system(
        lagrangian.no_parts(), lagrangian.problem, lagrangian.x, jacobian, estimate, penalty
    )
    system = assemble(parts, lagrangian.problem, is_path=lagrangian.S > 1)

    # Inequalities that are not active may be inexact, so their derivatives are left out.
    free = lagrangian.free
    J = lagrangian.jacobian(name)[:, is_active.ravel()]
    y, p = estimate[is_active], penalty[is_active]
    gradient = np.where(free, J @ y, 0)
    matrix = (J * p) @ J.T * free * free[:, None]
    np.testing.assert_allclose(
        gradient_of(system), gradient, rtol=1e-6, atol=1e-6 * np.abs(gradient).max()
    )
    ours = written_out(system) - np.diag((~free).astype(float))
    np.testing.assert_allclose(ours, matrix, rtol=1e-6, atol=1e-6 * np.abs(matrix).max())
    # A skeleton of grasps alone would have no rows of footprints; here each block says something.
    assert np.abs(gradient).max() > 1e-2 and np.abs(matrix).max() > 1e-2


def test_blocks_add_to_what_is_there(lagrangian: Lagrangian) -> None:
    """What a block adds does not depend on what others have added before."""
    generator = np.random.default_rng(3)
    before = jax.tree.map(lambda value: generator.normal(size=value.shape), lagrangian.no_parts())
    for name, block in BLOCKS.items():
        shape = lagrangian.rows[name].shape
        estimate, penalty = generator.uniform(0.1, 1, (2, *shape))
        collisions = (
            (estimate, penalty)
            if name == "collision"
            else np.zeros((2, *lagrangian.rows["collision"].shape))
        )
        jacobian = lagrangian.jacobians(*collisions)[name]
        added, alone = (
            block.add_to_system(
                parts, lagrangian.problem, lagrangian.x, jacobian, estimate, penalty
            )
            for parts in (before, lagrangian.no_parts())
        )
        for whole, first, own in zip(added, before, alone, strict=True):
            np.testing.assert_allclose(whole, first + own, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("gradient_scale", [1.0, 0.3])
def test_contribution_of_the_cost(lagrangian: Lagrangian, gradient_scale: float) -> None:
    """Exact: gradient and Hessian of a quadratic function; the Hessian keeps its scale."""
    scale = jnp.asarray(gradient_scale)
    parts = add_cost(lagrangian.no_parts(), lagrangian.problem, lagrangian.x, scale)
    system = assemble(parts, lagrangian.problem, is_path=lagrangian.S > 1)
    by_joints = jax.grad(lambda q: cost(lagrangian.problem, lagrangian.x._replace(q=q)))
    hessian = jax.jacfwd(by_joints)(jnp.asarray(lagrangian.x.q)).reshape(lagrangian.x.q.size, -1)
    np.testing.assert_allclose(
        system.gradient_q, gradient_scale * by_joints(lagrangian.x.q), rtol=1e-10, atol=1e-12
    )
    n = lagrangian.x.q.size
    np.testing.assert_allclose(written_out(system)[:n, :n], hessian, rtol=1e-10, atol=1e-12)

    # The mode parameters: pinned ones have no gradient, and a unit row in the matrix.
    problem = lagrangian.problem
    by_parameters = jax.grad(lambda m: cost(problem, lagrangian.x._replace(m=m)))(lagrangian.x.m)
    is_free = np.ravel(problem.parameter_upper > problem.parameter_lower)
    np.testing.assert_allclose(
        system.gradient_m,
        gradient_scale * is_free * np.ravel(by_parameters),
        rtol=1e-10,
        atol=1e-12,
    )
    weights = np.ravel(problem.preference_scale * problem.preference)
    np.testing.assert_allclose(system.corner, np.diag(np.where(is_free, weights, 1)), rtol=1e-10)


def test_gradient(lagrangian: Lagrangian) -> None:
    """Of the system against central differences of the value, which is C1 where the distances are."""
    ours = gradient_of(lagrangian.system())
    values = [lagrangian.value(x, rows) for x, rows in zip(*lagrangian.differences, strict=True)]
    expected = np.where(lagrangian.free, lagrangian.differentiate(values), 0)
    scale = np.abs(expected).max()
    assert scale > 1
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6 * scale)


def test_gauss_newton_matrix(lagrangian: Lagrangian) -> None:
    """Against J^T J of all costs, equalities and active inequalities, J by central differences of all residuals."""
    active = lagrangian.active()
    share = np.concatenate(
        [np.ravel(on) for name, on in active.items() if not is_equality(name)]
    ).mean()
    assert 0.3 < share < 0.7

    def scaled(x: Variables, rows: Rows) -> Floats:
        problem = lagrangian.problem
        parts = [
            np.ravel(np.sqrt(problem.regularization_weight) * x.q),
            np.ravel(np.sqrt(problem.preference_scale * problem.preference) * x.m),
        ]
        if lagrangian.S > 1:
            parts.append(
                np.sqrt(ACCELERATION_WEIGHT) * np.ravel(second_differences(lagrangian.problem, x.q))
            )
        parts += [
            (np.sqrt(lagrangian.penalty[name]) * rows[name])[on] for name, on in active.items()
        ]
        return np.concatenate(parts)

    J = lagrangian.differentiate(
        [scaled(x, rows) for x, rows in zip(*lagrangian.differences, strict=True)]
    ).T
    free = lagrangian.free
    expected = J.T @ J * free * free[:, None] + np.diag((~free).astype(float))
    ours = written_out(lagrangian.system())
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(ours, ours.T, rtol=1e-9, atol=1e-11)


def test_without_the_costs_gradient(lagrangian: Lagrangian) -> None:
    """As in a restoration: the gradient of the constraints alone, and the same matrix."""
    whole, restoring = lagrangian.system(), lagrangian.system(gradient_scale=0.0)
    np.testing.assert_array_equal(written_out(restoring), written_out(whole))
    own = jax.grad(lambda x: cost(lagrangian.problem, x))(lagrangian.x)
    is_free = np.ravel(lagrangian.problem.parameter_upper > lagrangian.problem.parameter_lower)
    for found, expected in (
        (whole.gradient_q - restoring.gradient_q, own.q),
        (whole.gradient_m - restoring.gradient_m, is_free * np.ravel(own.m)),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_pinned_parameters_do_not_move(lagrangian: Lagrangian) -> None:
    system = lagrangian.system()
    pinned = np.ravel(lagrangian.problem.parameter_upper == lagrangian.problem.parameter_lower)
    assert pinned.any()
    assert not np.asarray(system.gradient_m)[pinned].any()
    assert not np.asarray(system.border)[..., pinned].any()
    np.testing.assert_array_equal(np.asarray(system.corner)[pinned], np.eye(len(pinned))[pinned])


def test_keyframes_are_not_coupled(lagrangian: Lagrangian) -> None:
    system = lagrangian.system()
    assert (system.coupling is None) == (system.far_coupling is None) == (lagrangian.S == 1)
    if lagrangian.S > 1:
        # The first slice has none before it.
        assert not np.asarray(system.coupling)[0].any()
        assert not np.asarray(system.far_coupling)[:2].any()
