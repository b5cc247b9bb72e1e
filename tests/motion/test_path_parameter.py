"""The fastest speeds along a path: against the library `toppra` on the same grid, and a profile by hand."""

import numpy as np
import pytest
import toppra
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint

from dvr_jax.motion.path_parameter import FastestSpeeds, PathLimits

Floats = NDArray[np.float64]


class Rows(LinearConstraint):
    """The rows of given limits as a constraint of `toppra`, which are imposed at the points of the grid."""

    def __init__(self, limits: PathLimits, speed: Floats) -> None:
        super().__init__()
        self.identical = True
        rows = np.eye(limits.a.shape[1])
        # Bounds around zero that are the same everywhere, and what is there at rest.
        half = (limits.upper + limits.lower)[0] / 2
        at_rest = half - limits.upper
        squared = np.stack([np.zeros_like(speed), speed**2], axis=1)
        matrix = np.concatenate([rows, -rows])
        bounds = np.concatenate([half, half])
        self._params = (limits.a, limits.b, at_rest, matrix, bounds, None, squared)

    def get_dof(self) -> int:
        return -1

    def compute_constraint_params(self, path: object, gridpoints: object) -> object:
        return self._params


@pytest.mark.parametrize("seed", range(6))
def test_the_speeds_are_those_of_toppra(seed: int) -> None:
    """On random curves of 5 joints whose bounds differ in both directions, as those of torques do."""
    generator = np.random.default_rng(seed)
    path = CubicSpline(np.linspace(0, 1, 8), generator.normal(0, 1, (8, 5)))
    grid = np.linspace(0, 1, 121)
    slope = path(grid, 1)
    limit = generator.uniform(5, 20, 5)
    at_rest = 0.6 * limit * np.sin(path(grid))
    speed = (generator.uniform(0.5, 3, 5) / np.abs(slope)).min(axis=1)
    limits = PathLimits(slope, path(grid, 2), limit + at_rest, limit - at_rest)

    spline = toppra.SplineInterpolator(grid, path(grid))
    solver = TOPPRA([Rows(limits, speed)], spline, gridpoints=grid, solver_wrapper="seidel")
    expected = solver.compute_parameterization(0, 0)[1]
    found = FastestSpeeds(grid, limits).speeds(np.ones(len(grid)), speed)
    np.testing.assert_allclose(found, expected, atol=2e-5 * expected.max())
    assert found.max() > 0.05


def test_a_straight_line_has_the_profile_of_a_trapezoid() -> None:
    """By hand: the speed is the least of sqrt(2 a s), sqrt(2 d (1 - s)) and the largest one, for half of the limits."""
    grid = np.linspace(0, 1, 51)
    ones = np.ones((51, 1))
    limits = PathLimits(ones, 0 * ones, 4.0 * ones, 6.0 * ones)
    expected = np.minimum(np.sqrt(np.minimum(2 * 3.0 * grid, 2 * 2.0 * (1 - grid))), 1.2)
    found = FastestSpeeds(grid, limits).speeds(np.full(51, 0.5), np.full(51, 1.2))
    np.testing.assert_allclose(found, expected, atol=1e-9)
