"""The fastest motion along a path under limits that are linear in s'' and s'^2, by the library `toppra`."""

from __future__ import annotations

from typing import Any

import numpy as np
import toppra
from jaxtyping import Float
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint


class PathLimits(LinearConstraint):  # type: ignore[misc]
    """Limits ``-limit <= a s'' + b s'^2 + c <= limit`` and ``s' <= speed`` at the points of a grid."""

    def __init__(
        self,
        a: Float[np.ndarray, "points rows"],
        b: Float[np.ndarray, "points rows"],
        c: Float[np.ndarray, "points rows"],
        limit: Float[np.ndarray, " rows"],
        speed: Float[np.ndarray, " points"],
    ) -> None:
        """Keep the numbers.

        Args:
            a: Factors of s''.
            b: Factors of s'^2.
            c: What is there at rest.
            limit: Limits, the same at all points.
            speed: Largest s' at each point.
        """
        super().__init__()
        self.identical = True
        rows = np.eye(len(limit))
        squared = np.stack([np.zeros_like(speed), speed**2], axis=1)
        matrix = np.concatenate([rows, -rows])
        self._params = (a, b, c, matrix, np.concatenate([limit, limit]), None, squared)

    def get_dof(self) -> int:
        """Return -1: the limits fit a path of any number of joints."""
        return -1

    def compute_constraint_params(self, path: Any, gridpoints: Any) -> Any:
        """Return the numbers; the grid is the one that they were computed for."""
        return self._params


def fastest_speeds(
    grid: Float[np.ndarray, " points"],
    positions: Float[np.ndarray, "points joints"],
    limits: PathLimits,
) -> Float[np.ndarray, " points"] | None:
    """Return s' of the fastest motion from rest to rest at the points of a grid.

    Args:
        grid: Values of s.
        positions: Joint angles there [rad].
        limits: Limits at these points.

    Returns:
        The speeds; None if no motion keeps the limits.
    """
    path = toppra.SplineInterpolator(grid, positions)
    solver = TOPPRA([limits], path, gridpoints=grid, solver_wrapper="seidel")
    speeds = solver.compute_parameterization(0, 0)[1]
    if speeds is None:
        return None
    return np.maximum(np.nan_to_num(np.asarray(speeds)), 0)
