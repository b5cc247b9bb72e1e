"""Linear solve with the structure of a path: block-banded in time, with a dense border of mode parameters.

The matrix couples each slice with the one before it (distances are sampled between slices too), with the second
before it through a
*diagonal* block (accelerations act on each joint alone), and with the border:

        [ A_0      B1_1^T   B2_2                 E_0 ]
        [ B1_1     A_1      B1_2^T   B2_3        E_1 ]
    H = [ B2_2     B1_2     A_2      ...         ... ]
        [          B2_3     ...      A_{T-1}         ]
        [ E_0^T    E_1^T    ...                   C  ]

A block Cholesky factorisation runs along time under `lax.scan`; the border is eliminated by its Schur complement.
Keyframes have no coupling in time: their slices are factorised side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.lax.linalg import triangular_solve


class BorderedSystem(NamedTuple):
    """A symmetric positive definite system ``H [dq; dm] = -[gradient_q; gradient_m]``; D = 14 joints, M = 4 K
    parameters."""

    diagonal: Array
    """(T, D, D) blocks A_t."""
    coupling: Array | None
    """(T, D, D) blocks B1_t with slice t - 1; None: no coupling in time."""
    far_coupling: Array | None
    """(T, D) diagonals of B2_t with slice t - 2."""
    border: Array
    """(T, D, M) blocks E_t."""
    corner: Array
    """(M, M) block C."""
    gradient_q: Array
    """(T, D)."""
    gradient_m: Array
    """(M,)."""


def _inverse_factor(A: Array) -> Array:
    """Inverse of the lower Cholesky factor of a symmetric matrix ``(..., D, D)``; NaN where it is not positive
    definite."""
    L = jnp.linalg.cholesky(A, symmetrize_input=False)
    identity = jnp.broadcast_to(jnp.eye(A.shape[-1], dtype=A.dtype), A.shape)
    return triangular_solve(L, identity, left_side=True, lower=True)


def solve_bordered(system: BorderedSystem, damping: Array) -> tuple[Array, Array]:
    """Newton step ``(dq (T, D), dm (M,))`` with ``damping`` added to the whole diagonal; NaN where the matrix is
    indefinite."""
    _T, D = system.gradient_q.shape
    A = system.diagonal + damping * jnp.eye(D, dtype=system.diagonal.dtype)
    right = jnp.concatenate([system.border, -system.gradient_q[..., None]], axis=-1)
    if system.coupling is None or system.far_coupling is None:
        inverse = _inverse_factor(A)
        reduced = inverse @ right
        dm = _solve_corner(system, reduced, damping)
        dq = jnp.einsum("tij,ti->tj", inverse, reduced[..., -1] - reduced[..., :-1] @ dm)
        return dq, dm

    zero = jnp.zeros((D, D), A.dtype)
    no_rows = jnp.zeros_like(right[0])

    def forward(carry: tuple[Array, ...], block: tuple[Array, ...]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        # Row t of the factor: L2 = L[t, t-2], L1 = L[t, t-1]; `inverse` of L[t, t].
        inverse_1, inverse_2, L1_before, rows_1, rows_2 = carry
        A_t, B1, B2, right_t = block
        L2 = B2[:, None] * inverse_2.T
        L1 = (B1 - L2 @ L1_before.T) @ inverse_1.T
        L21 = jnp.concatenate([L2, L1], axis=1)
        inverse = _inverse_factor(A_t - L21 @ L21.T)
        rows = inverse @ (right_t - L21 @ jnp.concatenate([rows_2, rows_1], axis=0))
        return (inverse, inverse_1, L1, rows, rows_1), (inverse, L21, rows)

    start = (zero, zero, zero, no_rows, no_rows)
    _, (inverse, L21, reduced) = jax.lax.scan(forward, start, (A, system.coupling, system.far_coupling, right))
    dm = _solve_corner(system, reduced, damping)
    y = reduced[..., -1] - reduced[..., :-1] @ dm

    def backward(carry: tuple[Array, Array], block: tuple[Array, ...]) -> tuple[tuple[Array, Array], Array]:
        # `to_1` collects what later slices subtract from slice t, `to_2` from slice t - 1.
        to_1, to_2 = carry
        inverse_t, L21_t, y_t = block
        x_t = inverse_t.T @ (y_t - to_1)
        passed = L21_t.T @ x_t
        return (to_2 + passed[D:], passed[:D]), x_t

    nothing = jnp.zeros((D,), A.dtype)
    _, dq = jax.lax.scan(backward, (nothing, nothing), (inverse, L21, y), reverse=True)
    return dq, dm


def _solve_corner(system: BorderedSystem, reduced: Array, damping: Array) -> Array:
    """Border step (M,) from the forward-reduced right-hand sides ``(T, D, M + 1)``."""
    M = system.gradient_m.shape[0]
    flat = reduced.reshape(-1, M + 1)
    product = flat.T @ flat
    schur = system.corner + damping * jnp.eye(M, dtype=flat.dtype) - product[:M, :M]
    inverse = _inverse_factor(schur)
    return inverse.T @ (inverse @ (-system.gradient_m - product[:M, M]))


def dense_matrix(system: BorderedSystem) -> Array:
    """The same matrix as a dense array ``(T D + M, T D + M)``: for tests and for looking at."""
    T, D = system.gradient_q.shape
    M = system.gradient_m.shape[0]
    H = jnp.zeros((T * D + M, T * D + M), system.diagonal.dtype)
    for t in range(T):
        rows = slice(t * D, (t + 1) * D)
        H = H.at[rows, rows].set(system.diagonal[t])
        H = H.at[rows, T * D :].set(system.border[t]).at[T * D :, rows].set(system.border[t].T)
        for back in (1, 2):
            if system.coupling is not None and system.far_coupling is not None and t >= back:
                columns = slice((t - back) * D, (t - back + 1) * D)
                block = system.coupling[t] if back == 1 else jnp.diag(system.far_coupling[t])
                H = H.at[rows, columns].set(block).at[columns, rows].set(block.T)
    return H.at[T * D :, T * D :].set(system.corner)
