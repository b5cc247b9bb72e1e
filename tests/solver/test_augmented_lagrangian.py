"""Value, multiplier estimates and updates of the augmented Lagrangian, against their definitions.

The definitions are those of Nocedal and Wright, "Numerical Optimization", chapter 17.
"""

import numpy as np
import pytest

from dvr_jax.solver.augmented_lagrangian import lagrangian_rows, update_multipliers

EQUALITIES = (True, False)
"""Of the two kinds of rows here: the first ones are equalities h = 0, the second ones inequalities g <= 0."""


@pytest.fixture(params=range(5))
def rows(
    request: pytest.FixtureRequest,
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Multipliers, values and penalties; those of the inequalities are on both sides of the kink."""
    generator = np.random.default_rng(request.param)
    values = [generator.normal(size=(7, 3)), generator.normal(size=(40,))]
    multipliers = [generator.normal(size=(7, 3)), np.abs(generator.normal(size=(40,)))]
    penalties = [generator.uniform(0.1, 100, size=(7, 3)), generator.uniform(0.1, 100, size=(40,))]
    return multipliers, values, penalties


def test_value_is_the_definition(rows) -> None:
    (y, z), (h, g), (p, q) = rows
    expected = np.sum(y * h) + np.sum(p * h**2) / 2
    expected += np.sum((np.maximum(0, z + q * g) ** 2 - z**2) / (2 * q))
    np.testing.assert_allclose(lagrangian_rows(*rows, EQUALITIES).value, expected, rtol=1e-12)


def test_estimates_are_the_derivatives_of_the_value_by_the_rows(rows) -> None:
    multipliers, values, penalties = rows
    found = lagrangian_rows(*rows, EQUALITIES)
    step = 1e-6
    for kind, value in enumerate(values):
        for index in np.ndindex(value.shape):
            changed = [np.array(each) for each in values]
            changed[kind][index] += step
            ahead = lagrangian_rows(multipliers, changed, penalties, EQUALITIES).value
            changed[kind][index] -= 2 * step
            behind = lagrangian_rows(multipliers, changed, penalties, EQUALITIES).value
            slope = float(ahead - behind) / (2 * step)
            assert float(found.multiplier_estimate[kind][index]) == pytest.approx(slope, abs=1e-4)


def test_a_penalty_is_active_where_the_row_counts(rows) -> None:
    (_, z), (_, g), (p, q) = rows
    equalities, inequalities = lagrangian_rows(*rows, EQUALITIES).active_penalty
    np.testing.assert_array_equal(equalities, p)
    np.testing.assert_array_equal(inequalities, np.where(z + q * g > 0, q, 0))
    assert 0 < np.count_nonzero(inequalities) < g.size


def test_multiplier_update(rows) -> None:
    """First order: y + p h for equalities, max(0, z + p g) for inequalities."""
    (y, z), (h, g), (p, q) = rows
    equalities, inequalities = update_multipliers(*rows, EQUALITIES)
    np.testing.assert_allclose(equalities, y + p * h, rtol=1e-12)
    np.testing.assert_allclose(inequalities, np.maximum(0, z + q * g), atol=1e-12)
