"""A small quadratic program with nonnegative variables, solved by block principal pivoting.

The dual of a convex quadratic program with the inequalities ``J d + g <= 0`` is

    minimize  1/2 y^T S y + b^T y    subject to  y >= 0,        S = J H^-1 J^T,

where b is the negative of the inequalities' values at the minimum without them. At the solution, each row i has
y_i = 0 and ``w_i = (S y + b)_i >= 0``, or y_i >= 0 and w_i = 0.

The method guesses the set F of rows with w_i = 0 and solves ``S_FF y_F = -b_F``. Rows with y_i < 0 leave F, and rows
with w_i < 0 enter it, all at once as long as that decreases the number of such rows, else only the last of them, which
ends after finitely many steps (Judice and Pires 1994; Portugal, Judice and Vicente 1994).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array

PIVOT_LIMIT = 100
"""Largest number of steps; most programs of paths need fewer than ten."""

FULL_TRIES = 5
"""Number of steps in a row that exchange all rows without decreasing the number of wrong ones."""

SMALL_SET = 64
"""The set F of up to this many rows may contain all of them."""

LARGEST_SHARE = 0.5
"""Largest share of more rows that may be in the set F; where more want to enter it, those with the least w do. Its
linear system takes a time that grows with the cube of this share."""

ROUNDING = 1e-9
"""Multipliers and slacks above the negative of this count as nonnegative."""


class _Solution(NamedTuple):
    """What a set F leads to."""

    y: Float[Array, " rows"]
    """Its multipliers, which may be negative."""

    w: Float[Array, " rows"]
    """The product ``S y + b``."""

    wrong: Bool[Array, " rows"]
    """Rows that have to leave or to enter F."""


class _Pivoting(NamedTuple):
    """State of the method."""

    in_set: Bool[Array, " rows"]
    """The set F."""

    solution: _Solution
    """What it leads to."""

    fewest: Int[Array, ""]
    """Least number of wrong rows so far."""

    tries: Int[Array, ""]
    """How many more steps may exchange all rows."""

    steps: Int[Array, ""]
    """Number of steps so far."""


def solve_nonnegative(
    S: Float[Array, "rows rows"], b: Float[Array, " rows"], guess: Bool[Array, " rows"]
) -> Float[Array, " rows"]:
    """Minimize ``1/2 y^T S y + b^T y`` over y >= 0.

    Args:
        S: A symmetric positive definite matrix.
        b: The linear term.
        guess: Rows that probably have a positive multiplier.

    Returns:
        The multipliers y; if the limit of steps is reached, the last ones, with negative ones set to zero.
    """
    S = jnp.asarray(S)
    b = jnp.asarray(b)
    rows = len(b)
    most = min(rows, max(SMALL_SET, math.ceil(LARGEST_SHARE * rows)))

    def is_unsolved(state: _Pivoting) -> Array:
        return jnp.any(state.solution.wrong) & (state.steps < PIVOT_LIMIT)

    def pivot(state: _Pivoting) -> _Pivoting:
        wrong = state.solution.wrong
        count = jnp.sum(wrong, dtype=jnp.int32)
        decreases = count < state.fewest

        # The last wrong row alone, where exchanging all of them leads nowhere.
        last = jnp.arange(rows) == rows - 1 - jnp.argmax(wrong[::-1])
        exchanges_all = decreases | (state.tries > 0)
        in_set = jnp.where(exchanges_all, _exchanged(state, most), state.in_set ^ last)
        return _Pivoting(
            in_set=in_set,
            solution=_solve_set(S, b, in_set, most),
            fewest=jnp.minimum(count, state.fewest),
            tries=jnp.where(decreases, FULL_TRIES, state.tries - 1),
            steps=state.steps + 1,
        )

    # A guess that is too large is not used.
    guess = guess & (jnp.sum(guess) <= most)
    zero = jnp.zeros((), jnp.int32)
    start = _Pivoting(
        guess, _solve_set(S, b, guess, most), zero + rows + 1, zero + FULL_TRIES, zero
    )
    return jnp.maximum(jax.lax.while_loop(is_unsolved, pivot, start).solution.y, 0.0)


def _solve_set(S: jax.Array, b: jax.Array, in_set: Array, most: int) -> _Solution:
    """Return the solution for a set F.

    Args:
        S: The matrix.
        b: The linear term.
        in_set: The set F.
        most: Largest number of its rows.
    """
    # The set is small, so its rows are gathered; places without a row get the row of an identity matrix.
    rows = len(b)
    chosen = jnp.nonzero(in_set, size=most, fill_value=rows)[0]
    is_row = chosen < rows
    both = is_row[:, None] & is_row[None]
    inside = S.at[chosen[:, None], chosen[None]].get(mode="clip")
    inside = jnp.where(both, inside, jnp.eye(most, dtype=S.dtype))

    factor = jnp.linalg.cholesky(inside, symmetrize_input=False)
    right = jnp.where(is_row, -b.at[chosen].get(mode="clip"), 0.0)
    found = jax.scipy.linalg.cho_solve((factor, True), right)
    y = jnp.zeros_like(b).at[chosen].set(found, mode="drop")
    w = S @ y + b
    return _Solution(y, w, jnp.where(in_set, y < -ROUNDING, w < -ROUNDING))


def _exchanged(state: _Pivoting, most: int) -> Bool[Array, " rows"]:
    """Return the set F after all wrong rows have left or entered it, those with the least w first.

    Args:
        state: State of the method.
        most: Largest number of rows of the set.
    """
    stays = state.in_set & ~state.solution.wrong
    enters = ~state.in_set & state.solution.wrong
    order = jnp.where(stays, -jnp.inf, jnp.where(enters, state.solution.w, jnp.inf))
    rows = len(order)
    rank = jnp.zeros(rows, int).at[jnp.argsort(order)].set(jnp.arange(rows))
    return (stays | enters) & (rank < most)
