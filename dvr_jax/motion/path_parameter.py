"""The fastest motion along a path under limits that are linear in s'' and s'^2, by the library `toppra`.

A path is traversed with the speed s' and the acceleration s'' of its parameter s. At each point of a grid, each limit
is one row

    -lower <= a s'' + b s'^2 <= upper,        a, b, lower, upper from `PathLimits`,

and s' is bounded by a largest speed. TOPP-RA (H. Pham and Q.-C. Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", IEEE Transactions on Robotics 34, 2018) finds the fastest s(t) from
rest to rest. Rest keeps all limits, so that there always is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from dvr_jax.runtime.lazy_plots import without_plots

with without_plots():
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint


@dataclass(frozen=True, slots=True)
class PathLimits:
    """Limits ``-lower <= a s'' + b s'^2 <= upper`` at the points of a grid."""

    a: Float[np.ndarray, "points rows"]
    """Factors of s''."""

    b: Float[np.ndarray, "points rows"]
    """Factors of s'^2."""

    lower: Float[np.ndarray, "points rows"]
    """Bounds below zero without their signs; positive."""

    upper: Float[np.ndarray, "points rows"]
    """Bounds above zero; positive."""

    def scaled(self, fraction: Float[np.ndarray, " points"]) -> PathLimits:
        """Return these limits with all bounds multiplied by a fraction at each point of the grid."""
        return replace(
            self, lower=self.lower * fraction[:, None], upper=self.upper * fraction[:, None]
        )


class _Rows(LinearConstraint):  # type: ignore[misc]
    """These limits in the form of `toppra`: rows that are divided by half of their range, so that all bounds are 1."""

    def __init__(self, limits: PathLimits, largest: Float[np.ndarray, " points"]) -> None:
        """Keep the numbers.

        Args:
            limits: Limits at the points of the grid.
            largest: Largest s' there; infinite where there is no such limit.
        """
        super().__init__()
        self.identical = True
        half = (limits.upper + limits.lower) / 2
        at_rest = (limits.lower - limits.upper) / 2
        number = half.shape[1]
        matrix = np.concatenate([np.eye(number), -np.eye(number)])
        squared = np.stack([np.zeros_like(largest), largest**2], axis=1)
        self._params = (
            limits.a / half,
            limits.b / half,
            at_rest / half,
            matrix,
            np.ones(2 * number),
            None,
            squared,
        )

    def get_dof(self) -> int:
        """Return -1: the limits fit a path of any number of joints."""
        return -1

    def compute_constraint_params(self, path: Any, gridpoints: Any) -> Any:
        """Return the numbers; the grid is the one that they were computed for."""
        return self._params


def fastest_speeds(
    path: Any,
    grid: Float[np.ndarray, " points"],
    limits: PathLimits,
    largest: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " points"]:
    """Return s' of the fastest motion from rest to rest at the points of a grid.

    Args:
        path: The path as `toppra` interpolates it.
        grid: Values of s, which increase.
        limits: Limits at these points.
        largest: Largest s' there; infinite where there is no such limit.
    """
    solver = TOPPRA([_Rows(limits, largest)], path, gridpoints=grid, solver_wrapper="seidel")
    speeds = solver.compute_parameterization(0, 0)[1]
    assert speeds is not None, "rest keeps all limits"
    return np.maximum(np.nan_to_num(np.asarray(speeds)), 0)


def interpolated(
    grid: Float[np.ndarray, " points"], positions: Float[np.ndarray, "points joints"]
) -> Any:
    """Return a path as `toppra` interpolates it.

    Args:
        grid: Values of s, which increase.
        positions: Joint angles there [rad].
    """
    return toppra.SplineInterpolator(grid, positions)
