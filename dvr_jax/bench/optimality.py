"""How close the paths of plans come to an optimum: the shipped settings against ten times as many iterations.

The problems are the frozen path problems of the recall benchmark. Each path starts from the first feasible path, once
with the shipped settings and once with ten times the iterations and no tolerances at which they end. The
cost of the second path is the reference.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
import tyro

from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.bench.problems import read_problems
from dvr_jax.bench.recall import judge_prefix
from dvr_jax.logic import Action
from dvr_jax.nlp.cost import path_cost, preference_cost
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.scene.types import Scene
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_together
from dvr_jax.seeds.initial_paths import initial_path, optimal_path_problem
from dvr_jax.solver.lane_pool import NlpSolution, solve
from dvr_jax.solver.sequential import SequentialSettings
from dvr_jax.solver.state import SolverStatus
from dvr_jax.workcell.model import WorkcellModel

MORE_ITERATIONS = 10
"""The reference has this many times the iterations of the shipped settings."""

NEAR_OPTIMA = (0.01, 0.05)
"""Excesses of the cost over the reference whose shares are counted."""


@dataclass(frozen=True)
class OptimalityOptions:
    """Optimize the paths of the frozen problems, and compare their costs with those of ten times the iterations."""

    problems: Path | None = None
    """What `python -m dvr_jax.bench oracle` wrote; by default the problems of the package."""
    number: int | None = None
    """Number of path problems; by default all of them."""
    out: Path | None = None
    """JSON file to write the figures to."""


@dataclass(frozen=True)
class FeasiblePath:
    """A problem with the feasible path that its optimization starts from."""

    model: WorkcellModel
    problem: Problem
    initial: Variables
    path: NlpSolution


@dataclass(frozen=True)
class Comparison:
    """Costs of one path."""

    length: int
    """Number of actions."""
    feasible_cost: float
    """Cost of the first feasible path."""
    cost: float
    """Cost with the shipped settings."""
    reference: float
    """Cost with ten times the iterations; infinite if they found no better path than the feasible one."""
    is_optimal: bool
    """Whether the shipped settings reached their KKT residual."""
    iterations: int
    """Number of iterations with the shipped settings."""
    is_initial: bool
    """Whether the path is the initial one, slice by slice."""

    @property
    def excess(self) -> float:
        """Cost above the better of both paths, as a fraction of that one's cost."""
        best = min(self.cost, self.reference)
        return self.cost / best - 1


def run(arguments: list[str]) -> int:
    """Print a table by length, and write the figures."""
    options = tyro.cli(OptimalityOptions, prog="python -m dvr_jax.bench optimality", args=arguments)
    drawn = [
        (scene, actions)
        for scene, actions, row in read_problems(options.problems)
        if row["kind"] == "path"
    ][: options.number]
    with jax.enable_x64(True):
        found = dict(run_together([_feasible_path(*problem) for problem in drawn]))
        comparisons = []
        for number, (_, actions) in enumerate(drawn):
            start = found[number]
            if start is None:
                print(f"  problem {number}: no feasible path")
                continue
            comparisons.append(_compare(start))
            last = comparisons[-1]
            print(
                f"  problem {number}, {len(actions)} actions: cost {last.feasible_cost:.4f} -> {last.cost:.4f}, "
                f"reference {last.reference:.4f}, {last.iterations} iterations",
                flush=True,
            )

    lengths = sorted({item.length for item in comparisons})
    for length in lengths:
        print(_row(f"length {length}", [item for item in comparisons if item.length == length]))
    print(_row("all", comparisons))
    if options.out is not None:
        save_metrics(options.out, "optimality", _metrics(comparisons))
    return 0


def _feasible_path(scene: Scene, actions: Sequence[Action]) -> Steps[FeasiblePath | None]:
    """Return the first feasible path of a sequence, or None."""
    tree = SequenceTree(scene, k_max=6)
    node = yield from judge_prefix(tree, actions, second_look=True)
    if not node.feasible or node.problem is None:
        return None
    for keyframes in tree.solver.path_keyframes(node):
        path = yield from tree.solver.solve_path(node, keyframes)
        if path.feasible:
            model = tree.solver.model
            return FeasiblePath(
                model, node.problem, initial_path(model, node.problem, keyframes), path
            )
    return None


def _compare(start: FeasiblePath) -> Comparison:
    """Optimize a feasible path with both settings."""
    x = Variables(start.path.q, start.path.m)
    problem = optimal_path_problem(start.problem, x)
    settings = SequentialSettings()
    longer = settings._replace(
        kkt_tolerance=0.0,
        decrease_tolerance=0.0,
        iteration_limit=MORE_ITERATIONS * settings.iteration_limit,
    )
    (ours,) = solve(start.model, [problem], [x], settings)
    (reference,) = solve(start.model, [problem], [x], longer)
    shown = ours if ours.feasible else start.path
    return Comparison(
        length=len(x.m),
        feasible_cost=_cost(start.problem, start.path),
        cost=_cost(start.problem, shown),
        reference=_cost(start.problem, reference) if reference.feasible else math.inf,
        is_optimal=ours.status == SolverStatus.OPTIMAL,
        iterations=ours.iterations,
        is_initial=bool(np.array_equal(shown.q, start.initial.q)),
    )


def _cost(problem: Problem, path: NlpSolution) -> float:
    """Return the whole cost of a path."""
    accelerations = path_cost(np.asarray(problem.home), path.q)
    return accelerations + preference_cost(np.asarray(problem.preference), path.m)


def _row(title: str, items: Sequence[Comparison]) -> str:
    """Return one line about some paths."""
    shares = ", ".join(f"{_share(items, limit):.0%} within {limit:.0%}" for limit in NEAR_OPTIMA)
    saved = statistics.median(item.cost / item.feasible_cost for item in items)
    optimal = sum(item.is_optimal for item in items)
    iterations = statistics.median(item.iterations for item in items)
    initial = sum(item.is_initial for item in items)
    return (
        f"{title}: {len(items)} paths, {shares} of the reference, "
        f"median cost {saved:.0%} of the first feasible path's, "
        f"{optimal} reached the KKT residual, median {iterations:.0f} iterations, {initial} equal to the initial path"
    )


def _share(items: Sequence[Comparison], limit: float) -> float:
    """Return the share of paths whose cost exceeds the reference by at most a limit."""
    return sum(item.excess <= limit for item in items) / len(items)


def _metrics(items: Sequence[Comparison]) -> list[Metric]:
    """Return the figures of all paths."""
    saved = statistics.median(item.cost / item.feasible_cost for item in items)
    shares = [
        Metric(
            f"within {limit:.0%} of the reference",
            100 * _share(items, limit),
            "%",
            Direction.HIGHER,
            0.1,
        )
        for limit in NEAR_OPTIMA
    ]
    return [
        *shares,
        Metric("cost beside the first feasible path", 100 * saved, "%", Direction.LOWER, 0.1),
        Metric(
            "paths that reach the KKT residual",
            100 * sum(item.is_optimal for item in items) / len(items),
            "%",
            Direction.HIGHER,
            0.1,
        ),
        Metric(
            "iterations",
            statistics.median(item.iterations for item in items),
            "",
            Direction.LOWER,
            0.2,
        ),
    ]
