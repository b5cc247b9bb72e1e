"""The dual of a quadratic program against SciPy's nonnegative least squares."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import nnls

from dvr_jax.solver.quadratic_program import solve_nonnegative

solve = jax.jit(solve_nonnegative)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rows", [4, 30, 90])
def test_multipliers_are_those_of_scipy(rows: int, seed: int) -> None:
    """From any guess of the rows with a multiplier; a tenth of them have one, as in the programs of paths."""
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(rows + 5, rows))
    is_active = generator.random(rows) < 0.1
    slack = np.where(is_active, 0, generator.random(rows))
    right = A @ (is_active * generator.random(rows) - np.linalg.solve(A.T @ A, slack))
    expected, _ = nnls(A, right)
    guess = generator.random(rows) < 0.2
    found = solve(jnp.asarray(A.T @ A), jnp.asarray(-A.T @ right), jnp.asarray(guess))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_nearly_parallel_rows_have_the_multipliers_of_scipy() -> None:
    """Two rows that differ by a millionth, of which one has a multiplier."""
    A = np.array([[1.0, 1.0, 0.3], [0.0, 1e-6, 0.1], [0.0, 0.0, 1.0]])
    right = np.array([1.0, 1.0, -1.0])
    expected, _ = nnls(A, right)
    found = solve(jnp.asarray(A.T @ A), jnp.asarray(-A.T @ right), jnp.zeros(3, bool))
    value = 0.5 * np.sum((A @ np.asarray(found) - right) ** 2)
    assert value == pytest.approx(0.5 * np.sum((A @ expected - right) ** 2), abs=1e-6)


def test_slack_rows_have_no_multiplier() -> None:
    found = solve(jnp.eye(8), jnp.ones(8), jnp.ones(8, bool))
    assert not np.any(found)
