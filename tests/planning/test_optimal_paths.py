"""Optimal paths: their KKT conditions by SciPy, their cost beside the first feasible path, and how plans state both."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import nnls

from dvr_jax import sample_scenes
from dvr_jax.errors import OptionError
from dvr_jax.nlp.cost import cost, path_cost
from dvr_jax.nlp.evaluation import (
    EQUALITIES,
    evaluate_constraints,
    flatten,
    relative_violation,
    violations_of,
)
from dvr_jax.nlp.layout import lay_out
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import measure
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.search.node import Node
from dvr_jax.search.node_solver import NodeSolver
from dvr_jax.search.work import Steps
from dvr_jax.seeds.initial_paths import optimal_path_problem
from dvr_jax.solver.lane_pool import NlpSolution, stack
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import SolverStatus
from dvr_jax.workcell.model import WorkcellModel

Floats = NDArray[np.float64]

BATCH = 32
"""Number of points that are evaluated together."""

NEAR = 2e-3
"""Inequalities up to this far from their bound [m or rad] may have a multiplier."""


class Optimized(NamedTuple):
    """The path of a plan before and after it was optimized."""

    plan: Plan
    model: WorkcellModel
    problem: Problem
    feasible: NlpSolution
    optimal: NlpSolution


@pytest.fixture(scope="module")
def optimized() -> Optimized:
    """The first path of a plan; the scene is the first of seed 12 with an optimal path of two actions."""
    recorded: list[tuple[WorkcellModel, Problem, NlpSolution, NlpSolution]] = []
    original = NodeSolver.optimize_path

    def record(self: NodeSolver, node: Node, path: NlpSolution) -> Steps[NlpSolution]:
        found = yield from original(self, node, path)
        assert node.problem is not None
        recorded.append((self.model, node.problem, path, found))
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(NodeSolver, "optimize_path", record)
        for scene in sample_scenes(10, objects=2, seed=12):
            recorded.clear()
            result = plan(scene, "mbts", termination="optimal")
            is_optimal = result.path is not None and result.path.termination == "optimal"
            if len(result.actions) == 2 and is_optimal:
                return Optimized(result, *recorded[-1])
    raise AssertionError("no scene has an optimal path of two actions")


def _home(problem: Problem) -> Floats:
    return np.asarray(problem.home)


def test_the_plan_states_how_good_its_path_is(optimized: Optimized) -> None:
    stated = optimized.plan.path
    assert stated is not None
    assert stated.termination == "optimal"
    assert optimized.optimal.status == SolverStatus.OPTIMAL
    assert stated.kkt_residual is not None
    assert stated.kkt_residual <= SequentialSettings().kkt_tolerance
    assert stated.cost == path_cost(_home(optimized.problem), optimized.optimal.q)
    assert stated.iterations == optimized.optimal.iterations


def test_the_cost_is_that_of_the_solver(optimized: Optimized) -> None:
    x = Variables(optimized.optimal.q, optimized.optimal.m)
    problem = optimal_path_problem(optimized.problem, x)
    with jax.enable_x64(True):
        expected = float(cost(problem, x))
    stated = optimized.plan.path
    assert stated is not None
    assert stated.cost + stated.preference == pytest.approx(expected)


def test_an_optimal_path_costs_less_than_the_first_feasible_one(optimized: Optimized) -> None:
    home = _home(optimized.problem)
    before = path_cost(home, optimized.feasible.q)
    after = path_cost(home, optimized.optimal.q)
    assert after < 0.9 * before


def _row_values(
    model: WorkcellModel, problems: Problem, points: Variables
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Equalities, inequalities and relative violation at a batch of points."""
    geometry = measure(model, lay_out(problems, points))
    evaluations = evaluate_constraints(model, problems, points, geometry)
    rows = jax.vmap(flatten)({name: found.rows for name, found in evaluations.items()})
    kinds: dict[bool, list[jax.Array]] = {True: [], False: []}
    for value, is_equality in zip(rows, EQUALITIES, strict=True):
        kinds[is_equality].append(value.reshape(value.shape[0], -1))
    violation = relative_violation(violations_of(evaluations))
    return jnp.concatenate(kinds[True], 1), jnp.concatenate(kinds[False], 1), violation


def test_linearized_constraints_allow_hardly_any_decrease(optimized: Optimized) -> None:
    """A quadratic program by SciPy with derivatives by central differences: neither is the solver's.

    The program is to minimize ``g.d + 1/2 d.H d`` with the gradient g and the Hessian H of the cost, subject to the
    linearized constraints. By duality its minimum is ``-1/2 |L^-1 (g + J^T y)|^2`` with the multipliers y that make
    this norm least, and ``H = L L^T``. At a KKT point it is zero.
    """
    decreases = []
    with jax.enable_x64(True):
        evaluate = jax.jit(partial(_row_values, optimized.model))
        for path in (optimized.feasible, optimized.optimal):
            x = Variables(path.q, path.m)
            problem = optimal_path_problem(optimized.problem, x)
            gradient, equalities, inequalities = _linearized(evaluate, problem, x)

            # A multiplier of an equality is the difference of two that are not negative.
            columns = np.concatenate([equalities, -equalities, inequalities]).T
            L = np.linalg.cholesky(_hessian(x.q.shape, len(gradient)))
            _, norm = nnls(np.linalg.solve(L, columns), -np.linalg.solve(L, gradient))
            decreases.append(0.5 * norm**2 / float(cost(problem, x)))
    # The solver's own model is damped and promises at most 0.5 %; this program has no damping.
    assert decreases[1] <= 0.03
    assert decreases[0] >= 0.2


def _hessian(shape: tuple[int, ...], size: int) -> Floats:
    """Hessian of the squared accelerations, and a small number for each variable, because it is singular."""
    T, D = shape
    differences = np.eye(T) - 2 * np.eye(T, k=-1) + np.eye(T, k=-2)
    H = 1e-3 * np.eye(size)
    H[: T * D, : T * D] += np.kron(differences.T @ differences, np.eye(D))
    return H


def _linearized(evaluate, problem: Problem, x: Variables) -> tuple[Floats, Floats, Floats]:
    """Gradient of the cost, and derivatives of the equalities and of the inequalities that are near their bounds."""
    step = 1e-6
    T, D = x.q.shape
    free = np.asarray(problem.parameter_upper > problem.parameter_lower).reshape(-1)
    center = np.concatenate([x.q.reshape(-1), x.m.reshape(-1)])
    directions = np.eye(len(center))[np.r_[np.ones(T * D, bool), free]]
    points = np.concatenate([center + step * directions, center - step * directions, center[None]])

    # All points in batches of one size, the last of which is filled up with its last point.
    fill = -len(points) % BATCH
    padded = np.concatenate([points, np.repeat(points[-1:], fill, axis=0)])
    batch = stack([problem] * BATCH)
    h = []
    g = []
    for part in padded.reshape(-1, BATCH, len(center)):
        variables = Variables(
            part[:, : T * D].reshape(BATCH, T, D), part[:, T * D :].reshape(BATCH, -1, 4)
        )
        equalities, inequalities, _ = evaluate(batch, variables)
        h.append(np.asarray(equalities))
        g.append(np.asarray(inequalities))
    values = [np.concatenate(parts)[: len(points)] for parts in (h, g)]
    N = len(directions)
    by_h, by_g = ((value[:N] - value[N : 2 * N]).T / (2 * step) for value in values)

    by_q, by_m = jax.grad(lambda point: cost(problem, point))(x)
    return (
        np.r_[np.asarray(by_q).reshape(-1), np.asarray(by_m).reshape(-1)[free]],
        by_h[np.abs(by_h).max(axis=1) > 0],
        by_g[np.abs(values[1][2 * N]) <= NEAR],
    )


def test_a_feasible_path_suffices_if_that_is_asked_for(optimized: Optimized) -> None:
    found = plan(optimized.plan.scene, "mbts", termination="feasible")
    assert found.path is not None
    assert found.path.termination == "feasible"
    assert "optimum" not in found.nlps
    assert found.path.cost == path_cost(_home(optimized.problem), optimized.feasible.q)


def test_an_unknown_termination_is_refused(optimized: Optimized) -> None:
    with pytest.raises(
        OptionError, match="termination is the text 'best'; valid: optimal, feasible"
    ):
        plan(optimized.plan.scene, termination="best")
