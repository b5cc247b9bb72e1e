"""When the point of a lane is optimal, and which point a lane ends at if it does not reach an optimal one.

A point x with multipliers y satisfies the KKT conditions if the gradient of the Lagrangian vanishes, the constraints
hold, and multipliers of inactive inequalities are zero. The *KKT residual* measures by how much the cost could still
change, as a fraction of the cost f:

    residual = (1/2 g^T (H + damping I)^-1 g + sum_i |e_i c_i|) / f.

Here g is the gradient of the augmented Lagrangian, H its Gauss-Newton matrix, c_i are the rows, and e_i their
multiplier estimates, the derivatives of the augmented Lagrangian by the rows. With these as multipliers, g is also the
gradient of the Lagrangian. The first term is the decrease that the quadratic model predicts, half the square of the
Newton decrement (Boyd and Vandenberghe, Convex Optimization, section 9.5); it is zero only if g is. The second term is
to first order the change of the cost when all rows with multipliers are made exactly zero, which are both violations
and slack of inequalities with a multiplier. The residual does not depend on the units of variables and rows.

With much damping the first term is small at any point. The residual therefore counts as infinite if the damping exceeds
`Settings.step_damping`.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from dvr_jax.geometry.arrays import Array
from dvr_jax.solver.state import BestPoint, Settings, SolverStatus, Termination, TrialUpdate

TINY_COST = 1e-9
"""Costs below this count as this number where something is compared with the cost."""


def kkt_residual(
    settings: Settings, update: TrialUpdate, predicted_decrease: Array, damping: Array
) -> Array:
    """Return the KKT residual of a trial point; infinite if the point was refused or the damping is too large.

    Args:
        settings: Settings of the method.
        update: The verdict on the trial point.
        predicted_decrease: Decrease that the quadratic model at the trial point predicts.
        damping: Damping of the model.
    """
    residual = (predicted_decrease + update.gap) / jnp.maximum(jnp.abs(update.cost), TINY_COST)
    is_known = update.accepted & (damping <= settings.step_damping)
    return jnp.where(is_known, residual, jnp.inf)


def best_of(
    settings: Settings, best: BestPoint, trial: BestPoint, update: TrialUpdate
) -> BestPoint:
    """Return the trial point if it is feasible and of less cost than the best point so far, else that point.

    Args:
        settings: Settings of the method.
        best: The best point so far.
        trial: The trial point, if it was accepted.
        update: The verdict on the trial point.
    """
    is_better = update.accepted & (trial.cost < best.cost)
    is_better &= update.relative_violation <= settings.violation_limit
    is_better &= settings.termination == Termination.OPTIMAL
    return jax.tree.map(lambda new, old: jnp.where(is_better, new, old), trial, best)


def final_point(
    settings: Settings, last: BestPoint, best: BestPoint, status: Array
) -> tuple[BestPoint, Array]:
    """Return the point of a lane after an iteration, and its status.

    A lane that ends without an optimal point goes back to the best feasible point that it has visited.

    Args:
        settings: Settings of the method.
        last: The lane's last accepted point.
        best: The best point that it has visited.
        status: Its status at the last point.
    """
    has_ended = (status != SolverStatus.RUNNING) & (status != SolverStatus.OPTIMAL)
    goes_back = (settings.termination == Termination.OPTIMAL) & has_ended & jnp.isfinite(best.cost)
    point = jax.tree.map(lambda old, new: jnp.where(goes_back, old, new), best, last)
    return point, jnp.where(goes_back, int(SolverStatus.FEASIBLE), status)
