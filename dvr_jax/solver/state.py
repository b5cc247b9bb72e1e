"""What the augmented Lagrangian method keeps of one lane: settings, state, status, and the verdict on a trial point.

A *lane* is one NLP with its point, multipliers and penalty; `dvr_jax.solver.augmented_lagrangian` describes the method.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array


class SolverStatus(IntEnum):
    """Whether a lane is still iterated, and if not, why it has ended."""

    RUNNING = 0
    """The lane is still iterated."""

    FEASIBLE = 1
    """The lane has ended at a point whose violations are all within their tolerances."""

    STAGNATED = 2
    """The lane has ended because its violation decreases too slowly to become feasible within the iteration limit."""

    ITERATION_LIMIT = 3
    """The lane has ended because it reached the iteration limit."""

    NUMERICAL_FAILURE = 4
    """The lane has ended because the augmented Lagrangian is not finite at its start."""

    OPTIMAL = 5
    """The lane has ended at a feasible point whose KKT residual is within its tolerance (see
    `dvr_jax.solver.sequential`)."""


class Termination(IntEnum):
    """The point at which the optimization of a path ends."""

    FEASIBLE = 0
    """The first feasible point of the augmented Lagrangian method, which suffices for bounds and verdicts."""

    OPTIMAL = 1
    """A feasible point that satisfies the KKT conditions within a tolerance; sequential quadratic programming leads to
    it from the first feasible point (`dvr_jax.solver.sequential`)."""


class RestorationPhase(IntEnum):
    """Whether the restoration of a lane has begun or ended; a lane has at most one restoration."""

    BEFORE = 0
    """The restoration has not begun."""

    DURING = 1
    """The lane is iterated without multipliers and gradient of the costs."""

    AFTER = 2
    """The restoration has ended."""


class Settings(NamedTuple):
    """Settings of the method; they are arrays in compiled programs, so that changing one needs no new compilation.

    The violation of a point is its largest violation as a multiple of the tolerance. The size of a step is the largest
    change of one variable [m or rad].
    """

    penalty: float = 3e3
    """Initial penalty [1/m^2]."""

    penalty_growth: float = 5.0
    """Factor by which the penalty grows at a multiplier update if the violation has not decreased enough."""

    penalty_limit: float = 1e7
    """Largest penalty [1/m^2]."""

    sufficient_decrease: float = 0.5
    """The violation has decreased enough if it is at most this fraction of that at the last multiplier update."""

    step_limit: float = 0.5
    """Largest size of a step [m or rad]; a longer step is scaled as a whole."""

    step_tolerance: float = 1e-2
    """A subproblem ends with a step of at most this size [m or rad], if its damping was at most `step_damping`."""

    step_damping: float = 1.0
    """Largest damping of a step that can end a subproblem; with more damping, a step is small without convergence."""

    inner_limit: int = 6
    """A subproblem also ends after this number of iterations."""

    damping: float = 1e-3
    """Initial damping, a number that is added to the diagonal of the Gauss-Newton matrix."""

    damping_floor: float = 0.5
    """Smaller dampings are raised to this number after a refused step, before they grow; damping that is much smaller
    than the curvature of the costs does not change the step."""

    damping_limit: float = 1e4
    """Largest damping; if it is exceeded, the lane stays at its point and the damping is reset."""

    final_step: float = 1e-1
    """A feasible lane ends if the size of its last accepted step was at most this [m or rad]."""

    iteration_limit: int = 40
    """Largest number of iterations."""

    restoration_ratio: float = 10.0
    """The restoration begins after the first subproblem that ends with a violation between 1 and this number. With the
    ratio 0 there is no restoration, which is meant for finding optima rather than feasible points."""

    restoration_limit: int = 4
    """The restoration ends with the first accepted step from this number of iterations on."""

    patience: int = 5
    """A lane stagnates after this number of multiplier updates in a row that did not decrease the least violation so
    far by at least 10 %."""

    course_start: int = 10
    """Iteration from which on a lane also stagnates if its least violation so far lies above a *course*, a bound that
    decreases exponentially from `course_ratio` at this iteration to 1 at the iteration limit."""

    course_ratio: float = 60.0
    """Value of the course at the iteration `course_start`, as a multiple of the tolerance."""


class SolverState(NamedTuple):
    """The state of one lane between two iterations."""

    x: Any
    """Last accepted point, a pytree of arrays."""

    step: Any
    """Step from `x` to the next trial point, a pytree of the same structure."""

    multipliers: tuple[Array, ...]
    """Multipliers y and z of all rows, one array for each kind of row."""

    penalty: Float[Array, "*lanes"]
    """Common penalty p [1/m^2]."""

    damping: Float[Array, "*lanes"]
    """Damping of the next step."""

    value: Float[Array, "*lanes"]
    """Augmented Lagrangian at `x` under the present multipliers and penalty; infinite before the first iteration."""

    system: Any
    """Gauss-Newton system of the augmented Lagrangian at `x` under the present multipliers and penalty."""

    report: Any
    """Numbers about `x` that the caller wants to keep, a pytree of arrays; here the violation of each measure."""

    updated_violation: Float[Array, "*lanes"]
    """Relative violation at the last multiplier update."""

    best_violation: Float[Array, "*lanes"]
    """Least relative violation so far."""

    inner_iterations: Int[Array, "*lanes"]
    """Iterations since the last multiplier update."""

    updates_without_progress: Int[Array, "*lanes"]
    """Number of multiplier updates in a row that did not decrease the least violation by at least 10 %."""

    iterations: Int[Array, "*lanes"]
    """Iterations since the start."""

    restoration: Int[Array, "*lanes"]
    """Phase of the restoration, a `RestorationPhase`."""

    status: Int[Array, "*lanes"]
    """Whether the lane is still iterated, a `SolverStatus`."""


class TrialUpdate(NamedTuple):
    """Whether a lane's trial point is accepted, and the multipliers and penalty after it."""

    accepted: Bool[Array, ""]
    """True if the trial point becomes the lane's point."""

    feasible: Bool[Array, ""]
    """True if the lane ends at the trial point because it is feasible."""

    ended: Bool[Array, ""]
    """True if a subproblem has ended and the multipliers were updated."""

    relative_violation: Float[Array, ""]
    """Largest violation at the trial point as a multiple of its tolerance."""

    multipliers: tuple[Array, ...]
    """Multipliers after the iteration."""

    penalty: Float[Array, ""]
    """Common penalty after the iteration [1/m^2]."""

    value: Float[Array, ""]
    """Augmented Lagrangian at the trial point, under the new multipliers and penalty."""

    multiplier_estimate: tuple[Array, ...]
    """Derivative of the augmented Lagrangian by each row: y + p h, and max(0, z + p g)."""

    active_penalty: tuple[Array, ...]
    """The penalty of each row where it is active, else 0."""

    updates_without_progress: Int[Array, ""]
    """Number of multiplier updates in a row without progress, after the iteration."""

    restoration: Int[Array, ""]
    """Phase of the restoration after the iteration, a `RestorationPhase`."""
