"""Linear solve with the structure of a path: block-banded in time, with a dense border of mode parameters.

The matrix couples each slice with the one before it (distances are sampled between slices too), with the second
before it through a
*diagonal* block (accelerations act on each joint alone), and with the border:

        [ A_0      B1_1^T   B2_2                 E_0 ]
        [ B1_1     A_1      B1_2^T   B2_3        E_1 ]
    H = [ B2_2     B1_2     A_2      ...         ... ]
        [          B2_3     ...      A_{T-1}         ]
        [ E_0^T    E_1^T    ...                   C  ]

Two slices make a block of 2 D, so that each block is coupled with its neighbours only, by full matrices. A block
Cholesky factorisation runs along time under `lax.scan`; the border is eliminated by its Schur complement. Keyframes
have no coupling in time: their slices are factorised side by side.
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


# Matrices that go to LAPACK are transposed, and its triangular solves are those from the right: it stores by columns
# what XLA stores by rows, so nothing is rearranged, and OpenBLAS is nearly twice as fast that way round.


def _inverse_factor(A: Array) -> Array:
    """Inverse of the lower Cholesky factor of a symmetric matrix ``(..., D, D)``; NaN where it is not positive
    definite."""
    L = jnp.linalg.cholesky(A.swapaxes(-1, -2), symmetrize_input=False)
    identity = jnp.broadcast_to(jnp.eye(A.shape[-1], dtype=A.dtype), A.shape)
    return triangular_solve(L, identity, lower=True, transpose_a=True).swapaxes(-1, -2)


def solve_bordered(system: BorderedSystem, damping: Array) -> tuple[Array, Array]:
    """Newton step ``(dq (T, D), dm (M,))`` with ``damping`` added to the whole diagonal; NaN where the matrix is
    indefinite."""
    T, D = system.gradient_q.shape
    A = system.diagonal + damping * jnp.eye(D, dtype=system.diagonal.dtype)
    right = jnp.concatenate([system.border, -system.gradient_q[..., None]], axis=-1)
    if system.coupling is None or system.far_coupling is None:
        inverse = _inverse_factor(A)
        reduced = inverse @ right
        dm = _solve_corner(system, reduced, damping)
        dq = jnp.einsum("tij,ti->tj", inverse, reduced[..., -1] - reduced[..., :-1] @ dm)
        return dq, dm

    own, ahead = _pair_blocks(A, system.coupling, system.far_coupling)
    right = _in_pairs(right)
    W = own.shape[-1]

    def forward(before: Array, block: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        # With the factor L of a block, `solved` is L^-1 [coupling with the next block, right-hand sides].
        own, ahead, right = block
        L = jnp.linalg.cholesky((own - before[:, :W]).T, symmetrize_input=False)
        sides = jnp.concatenate([ahead, right - before[:, W:]], axis=1)
        solved = triangular_solve(L, sides.T, lower=True, transpose_a=True).T
        return solved[:, :W].T @ solved, (L.T, solved)

    start = jnp.zeros((W, W + right.shape[-1]), A.dtype)
    _, (U, solved) = jax.lax.scan(forward, start, (own, ahead, right))
    reduced = solved[..., W:]
    dm = _solve_corner(system, reduced, damping)
    y = reduced[..., -1] - reduced[..., :-1] @ dm

    def backward(after: Array, block: tuple[Array, ...]) -> tuple[Array, Array]:
        U, ahead, y = block
        x = triangular_solve(U.T, (y - ahead @ after)[None], lower=True)[0]
        return x, x

    _, dq = jax.lax.scan(backward, jnp.zeros(W, A.dtype), (U, solved[..., :W], y), reverse=True)
    return dq.reshape(-1, D)[:T], dm


def _in_pairs(value: Array) -> Array:
    """(T, D, ...) as (T / 2, 2 D, ...), with zeros after an odd last one."""
    padded = jnp.pad(value, [(0, len(value) % 2), *[(0, 0)] * (value.ndim - 1)])
    return padded.reshape(-1, 2 * value.shape[1], *value.shape[2:])


def _pair_blocks(A: Array, B1: Array, B2: Array) -> tuple[Array, Array]:
    """Blocks (T / 2, 2 D, 2 D) of pairs of slices, and of each pair's coupling with the next one."""
    T, D = B2.shape
    identity = jnp.eye(D, dtype=A.dtype)
    if T % 2:
        A = jnp.concatenate([A, identity[None]])
    B1, B2 = (jnp.pad(value, [(0, -T % 2 + 2), *[(0, 0)] * (value.ndim - 1)]) for value in (B1, B2))
    inner, outer = B1[1:-2:2], B1[2::2].swapaxes(1, 2)
    far = (B2[2:, :, None] * identity).reshape(-1, 2, D, D)
    own = jnp.block([[A[::2], inner.swapaxes(1, 2)], [inner, A[1::2]]])
    return own, jnp.block([[far[:, 0], jnp.zeros_like(outer)], [outer, far[:, 1]]])


def _solve_corner(system: BorderedSystem, reduced: Array, damping: Array) -> Array:
    """Border step (M,) from the forward-reduced right-hand sides, rows of M + 1."""
    M = system.gradient_m.shape[0]
    flat = reduced.reshape(-1, M + 1)
    product = flat.T @ flat
    schur = system.corner + damping * jnp.eye(M, dtype=flat.dtype) - product[:M, :M]
    inverse = _inverse_factor(schur)
    return inverse.T @ (inverse @ (-system.gradient_m - product[:M, M]))
