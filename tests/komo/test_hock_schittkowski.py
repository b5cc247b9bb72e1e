"""The augmented-Lagrangian method against published optima of the Hock-Schittkowski collection."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hock_schittkowski import EXAMPLES, Example
from jax import Array

from dvr_jax.komo import augmented
from dvr_jax.komo.augmented import FEASIBLE, RUNNING, Lane, Settings, trial_point

TOLERANCE = 1e-7
"""Violation that the method may leave."""

SETTINGS = Settings(
    penalty=10.0,
    penalty_limit=1e8,
    step_limit=10.0,
    step_tolerance=1e-7,
    inner_limit=50,
    final_step=1e-7,
    iteration_limit=2000,
    patience=100,
)


class System(NamedTuple):
    """Dense Gauss-Newton system."""

    matrix: Array
    gradient: Array


def _values(rows: tuple[Any, ...]) -> Array:
    return jnp.stack(rows) if rows else jnp.zeros(0)


def _functions(example: Example, x: Array) -> tuple[Array, tuple[Array, Array]]:
    """Residuals, such that half their sum of squares is the objective less its constant, and constraint rows."""
    r = np.sqrt(2 * example.scale) * _values(example.residuals(*x))
    return r, (_values(example.equalities(*x)), _values(example.rows(*x)))


def _solve(system: System, damping: Array) -> Array:
    factor = jnp.linalg.cholesky(system.matrix + damping * jnp.eye(len(system.gradient)))
    return -jax.scipy.linalg.cho_solve((factor, True), system.gradient)


def _start(example: Example) -> Lane:
    x = jnp.array(example.start)
    _, c = _functions(example, x)
    infinity, count = jnp.array(jnp.inf), jnp.array(0, jnp.int32)
    # The first trial point is the start. A step of 1 leads there: after a step of 0 a feasible start would end the lane.
    return Lane(
        x=x - 1,
        step=jnp.ones_like(x),
        multipliers=tuple(map(jnp.zeros_like, c)),
        penalty=jnp.array(SETTINGS.penalty),
        damping=jnp.array(SETTINGS.damping),
        value=infinity,
        system=System(jnp.zeros((x.size, x.size)), jnp.zeros_like(x)),
        report=infinity,
        updated_ratio=infinity,
        best_ratio=infinity,
        inner=count,
        stale=count,
        iterations=count,
        status=count,
    )


def _iterate(example: Example, lane: Lane) -> Lane:
    x = trial_point(lane)
    r, c = _functions(example, x)
    J_r, J_c = jax.jacfwd(partial(_functions, example))(x)
    h, g = c
    violation = jnp.concatenate([jnp.abs(h), g]).max(initial=0.0)
    ratio = violation / TOLERANCE
    judged = augmented.judge(SETTINGS, lane, 0.5 * r @ r, c, (1.0, 1.0), (True, False), ratio)
    matrix, gradient = J_r.T @ J_r, J_r.T @ r
    for J, force, curvature in zip(J_c, judged.force, judged.curvature, strict=True):
        matrix += J.T @ (curvature[:, None] * J)
        gradient += J.T @ force
    return augmented.advance(SETTINGS, lane, judged, System(matrix, gradient), ratio, _solve)


@partial(jax.jit, static_argnums=0)
def _run(example: Example) -> Lane:
    return jax.lax.while_loop(lambda lane: lane.status == RUNNING, partial(_iterate, example), _start(example))


@pytest.mark.parametrize("number", EXAMPLES)
def test_published_optimum_is_reached(number: int) -> None:
    example = EXAMPLES[number]
    lane = _run(example)
    x = np.asarray(lane.x)
    assert x.dtype == np.float64
    f = example.scale * np.sum(np.square(example.residuals(*x))) + example.constant
    violation = max([0.0, *np.abs(example.equalities(*x)), *example.rows(*x)])
    assert lane.status == FEASIBLE
    assert violation < 1e-6
    assert abs(f - example.optimum) <= 1e-3 * max(1, abs(example.optimum))
