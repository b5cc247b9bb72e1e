"""How good the path of a plan is: its cost, and how close it is to an optimum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvr_jax.nlp.cost import path_cost, preference_cost
from dvr_jax.nlp.problem import Problem
from dvr_jax.solver.lane_pool import NlpSolution
from dvr_jax.solver.state import SolverStatus

TERMINATIONS = ("optimal", "feasible")
"""Names of the points at which the optimization of a path may end."""


@dataclass(frozen=True, slots=True)
class PathQuality:
    """Quality of the path of a plan, before it is timed."""

    termination: str
    """"optimal" if the path satisfies the KKT conditions within the solver's tolerance, else "feasible"."""

    cost: float
    """Objective of the paper, half the sum of the squared accelerations [rad^2/slice^4]."""

    preference: float
    """The rest of the solver's cost: how far grasps are from the objects' centers and from straight down."""

    kkt_residual: float | None
    """KKT residual, a fraction of the cost (`dvr_jax.solver.sequential`); None if it is not known."""

    iterations: int
    """Number of iterations of the NLP that the path solves."""


def quality_of(problem: Problem, path: NlpSolution) -> PathQuality:
    """Return the quality of the solution of a path NLP.

    Args:
        problem: Keyframe NLP of the sequence.
        path: A feasible solution of the path NLP.
    """
    return PathQuality(
        termination="optimal" if path.status == SolverStatus.OPTIMAL else "feasible",
        cost=path_cost(np.asarray(problem.home), path.q),
        preference=preference_cost(np.asarray(problem.preference), path.m),
        kkt_residual=path.kkt_residual if math.isfinite(path.kkt_residual) else None,
        iterations=path.iterations,
    )
