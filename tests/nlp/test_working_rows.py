"""The working rows of paths: which are chosen, by NumPy, and their derivatives, by central differences."""

from functools import lru_cache
from typing import NamedTuple

import jax
import numpy as np
import pytest
from conftest import Evaluated, evaluate, evaluate_rows
from nlp_cases import Floats, make_case

from dvr_jax.nlp.blocks import COLLISION
from dvr_jax.nlp.evaluation import FlatResiduals, flatten, horizon_of
from dvr_jax.nlp.problem import Variables
from dvr_jax.nlp.working_rows import (
    BISECTIONS,
    FARTHEST,
    NEAREST,
    RowDerivatives,
    RowIndex,
    choose_rows,
    put_rows,
    row_derivatives,
    take_rows,
    working_rows_of,
)

STEP = 1e-5

TOLERANCE = 1e-5


class Chosen(NamedTuple):
    """The working rows of the problems of a case."""

    evaluated: Evaluated
    rows: FlatResiduals
    index: RowIndex
    derivatives: RowDerivatives


def _flat(rows: dict[str, Floats]) -> FlatResiduals:
    return jax.tree.map(np.asarray, jax.vmap(flatten)(rows))


@lru_cache
def chosen() -> Chosen:
    evaluated = Evaluated(make_case(steps=4, repeats=1, seed=3))
    case = evaluated.case
    results = evaluate(evaluated.model, case.problems, case.x)
    horizon = horizon_of(evaluated.model, case.problems, case.x)
    rows = _flat({name: np.asarray(value) for name, value in results.rows.items()})
    index = jax.vmap(choose_rows, in_axes=(0, None))(rows, horizon)
    derivatives = row_derivatives(
        evaluated.model,
        case.problems,
        case.x,
        horizon,
        [results.geometry],
        {name: value for name, value in results.jacobians.items() if name != COLLISION.name},
        index,
    )
    return Chosen(evaluated, rows, index, jax.tree.map(np.asarray, derivatives))


def test_the_nearest_rows_are_chosen() -> None:
    """The largest values of each kind, and no distance of more than 10 cm."""
    found = chosen()
    case = found.evaluated.case
    number = working_rows_of(horizon_of(found.evaluated.model, case.problems, case.x))
    for b in range(case.batch):
        values = np.sort(found.rows.collision[b].ravel())[::-1]
        expected = values[: number.collision]
        expected = expected[expected > FARTHEST]
        index = np.asarray(found.index.collision[b])
        index = index[index < values.size]
        taken = np.sort(found.rows.collision[b].ravel()[index])[::-1]
        np.testing.assert_allclose(taken, expected[: len(taken)], atol=1e-7)

        # Values that the bisection cannot tell from the first one beyond the limit are left out.
        left_out = expected[len(taken) :]
        np.testing.assert_allclose(
            left_out,
            np.full_like(left_out, values[number.collision]),
            atol=(NEAREST - FARTHEST) / 2**BISECTIONS,
        )
        others = np.sort(found.rows.inequality[b])[::-1][: number.other]
        taken = found.rows.inequality[b][np.asarray(found.index.other[b])]
        np.testing.assert_array_equal(np.sort(taken)[::-1], others)


def test_values_that_were_taken_can_be_put_back() -> None:
    found = chosen()
    rows = jax.tree.map(lambda value: value[0], found.rows)
    index = jax.tree.map(lambda value: value[0], found.index)
    changed = put_rows(take_rows(rows, index) + 1, index, rows)
    difference = np.asarray(changed.collision) - rows.collision
    is_row = np.asarray(index.collision) < rows.collision.size
    assert difference.sum() == pytest.approx(is_row.sum())
    assert np.sum(np.asarray(changed.inequality) - rows.inequality) == pytest.approx(
        len(index.other)
    )


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_are_those_of_central_differences(seed: int) -> None:
    """Along random directions of all variables; where the halved step disagrees, a distance has a kink."""
    found = chosen()
    case = found.evaluated.case
    generator = np.random.default_rng(seed)
    dq = generator.normal(size=case.x.q.shape)
    free = np.asarray(case.problems.parameter_upper > case.problems.parameter_lower)
    dm = generator.normal(size=case.x.m.shape) * free
    predicted = np.einsum("btjr,btj->br", found.derivatives.by_joints, dq)
    predicted += np.einsum("bmr,bm->br", found.derivatives.by_parameters, dm.reshape(len(dm), -1))

    def values(amount: float) -> Floats:
        x = Variables(case.x.q + amount * dq, case.x.m + amount * dm)
        rows = _flat(evaluate_rows(found.evaluated.model, case.problems, x))
        return np.asarray(jax.vmap(take_rows)(rows, found.index))

    whole = (values(STEP) - values(-STEP)) / (2 * STEP)
    half = (values(STEP / 2) - values(-STEP / 2)) / STEP
    expected = (4 * half - whole) / 3
    scale = np.maximum(1, np.abs(expected))
    is_smooth = np.abs(whole - half) < TOLERANCE * scale
    assert is_smooth.mean() > 0.95
    assert np.all(np.abs(predicted - expected)[is_smooth] < (TOLERANCE * scale)[is_smooth])
