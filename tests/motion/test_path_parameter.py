"""The fastest speeds along a path, against a profile by hand."""

import numpy as np

from dvr_jax.motion.path_parameter import PathLimits, fastest_speeds, interpolated


def test_a_straight_line_has_the_profile_of_a_trapezoid() -> None:
    """By hand: the speed is the least of sqrt(2 a s), sqrt(2 d (1 - s)) and the largest one, for half of the limits."""
    grid = np.linspace(0, 1, 51)
    ones = np.ones((51, 1))
    limits = PathLimits(ones, 0 * ones, 4.0 * ones, 6.0 * ones)
    expected = np.minimum(np.sqrt(np.minimum(2 * 3.0 * grid, 2 * 2.0 * (1 - grid))), 1.2)
    path = interpolated(grid, grid[:, None])
    found = fastest_speeds(path, grid, limits.scaled(np.full(51, 0.5)), np.full(51, 1.2))
    np.testing.assert_allclose(found, expected, atol=1e-5)
