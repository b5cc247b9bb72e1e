"""Solve linear systems with the structure of a path: block-banded in time, with a dense border of mode parameters.

The matrix is defined in `dvr_jax.nlp.system`. Two consecutive slices form a *pair*, a block of size 2 D, so that each
block is coupled only with its neighbors. A block Cholesky factorization runs along time under `lax.scan`. With the
diagonal block own_i of pair i and its coupling ahead_i with the next pair,

    L_i L_i^T = own_i - C_{i-1}^T C_{i-1},        C_i = L_i^-1 ahead_i,

and the border is eliminated by its Schur complement. Keyframes are not coupled in time, so their slices are factorized
independently.

Matrices are passed to LAPACK transposed, and its triangular solves multiply from the right. LAPACK stores matrices by
columns and XLA by rows, so nothing has to be rearranged, and OpenBLAS is nearly twice as fast in this form.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.lax.linalg import triangular_solve
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.nlp.system import BorderedSystem


class _Pair(NamedTuple):
    """The parts of the system that belong to two consecutive slices; M is the number of mode parameters."""

    own: Array
    """(2 D, 2 D) their block of the matrix."""

    ahead: Array
    """(2 D, 2 D) its coupling with the next pair."""

    right: Array
    """(2 D, M + 1) border and right-hand side."""


class _Factorized(NamedTuple):
    """A pair after the forward sweep."""

    factor: Array
    """Transposed Cholesky factor L^T."""

    solved: Array
    """L^-1 [coupling with the next pair, border, right-hand side]."""


class _Backward(NamedTuple):
    """What the backward sweep needs of a pair."""

    factor: Array
    ahead: Array
    right: Array


def _inverse_factor(A: Array) -> Array:
    """Inverse of the lower Cholesky factor of a symmetric matrix (..., D, D); NaN where it is not positive definite."""
    L = jnp.linalg.cholesky(A.swapaxes(-1, -2), symmetrize_input=False)
    identity = jnp.broadcast_to(jnp.eye(A.shape[-1], dtype=A.dtype), A.shape)
    return triangular_solve(L, identity, lower=True, transpose_a=True).swapaxes(-1, -2)


def solve_bordered(
    system: BorderedSystem, damping: Float[Array, ""] | float
) -> tuple[Float[Array, "slices joints"], Float[Array, " parameters"]]:
    """Solve a damped Gauss-Newton system for the steps of joint angles and mode parameters.

    Args:
        system: The system.
        damping: Number that is added to the whole diagonal.

    Returns:
        Steps of the joint angles and of the mode parameters; NaN if the damped matrix is indefinite.
    """
    D = system.gradient_q.shape[1]
    A = system.diagonal + damping * jnp.eye(D, dtype=system.diagonal.dtype)
    right = jnp.concatenate([system.border, -system.gradient_q[..., None]], axis=-1)
    if system.coupling is None or system.far_coupling is None:
        return _solve_uncoupled(system, A, right, damping)
    return _solve_coupled(system, A, right, damping, system.coupling, system.far_coupling)


def _solve_uncoupled(
    system: BorderedSystem, A: Array, right: Array, damping: Array | float
) -> tuple[Array, Array]:
    """Solve a keyframe system, whose slices are not coupled in time."""
    inverse = _inverse_factor(A)
    reduced = inverse @ right
    dm = _solve_corner(system, reduced, damping)
    dq = jnp.einsum("tij,ti->tj", inverse, reduced[..., -1] - reduced[..., :-1] @ dm)
    return dq, dm


def _solve_coupled(
    system: BorderedSystem, A: Array, right: Array, damping: Array | float, B1: Array, B2: Array
) -> tuple[Array, Array]:
    """Solve the system of a path by a forward and a backward sweep over pairs of slices."""
    T, D = system.gradient_q.shape
    own, ahead = _pair_blocks(A, B1, B2)
    width = own.shape[-1]
    right = _in_pairs(right)

    def forward(before: Array, pair: _Pair) -> tuple[Array, _Factorized]:
        L = jnp.linalg.cholesky((pair.own - before[:, :width]).T, symmetrize_input=False)
        sides = jnp.concatenate([pair.ahead, pair.right - before[:, width:]], axis=1)
        solved = triangular_solve(L, sides.T, lower=True, transpose_a=True).T
        return solved[:, :width].T @ solved, _Factorized(L.T, solved)

    start = jnp.zeros((width, width + right.shape[-1]), A.dtype)
    _, factorized = jax.lax.scan(forward, start, _Pair(own, ahead, right))
    reduced = factorized.solved[..., width:]
    dm = _solve_corner(system, reduced, damping)

    def backward(after: Array, pair: _Backward) -> tuple[Array, Array]:
        x = triangular_solve(pair.factor.T, (pair.right - pair.ahead @ after)[None], lower=True)[0]
        return x, x

    y = reduced[..., -1] - reduced[..., :-1] @ dm
    pairs = _Backward(factorized.factor, factorized.solved[..., :width], y)
    _, dq = jax.lax.scan(backward, jnp.zeros(width, A.dtype), pairs, reverse=True)
    return dq.reshape(-1, D)[:T], dm


def _in_pairs(value: Array) -> Array:
    """Reshape (T, D, ...) to (T / 2, 2 D, ...); an odd number of slices is padded with zeros."""
    padded = jnp.pad(value, [(0, len(value) % 2), *[(0, 0)] * (value.ndim - 1)])
    return padded.reshape(-1, 2 * value.shape[1], *value.shape[2:])


def _pair_blocks(A: Array, B1: Array, B2: Array) -> tuple[Array, Array]:
    """Return the blocks (T / 2, 2 D, 2 D) of pairs of slices, and those of each pair's coupling with the next one."""
    T, D = B2.shape
    identity = jnp.eye(D, dtype=A.dtype)
    if T % 2:
        A = jnp.concatenate([A, identity[None]])
    B1 = jnp.pad(B1, [(0, -T % 2 + 2), (0, 0), (0, 0)])
    B2 = jnp.pad(B2, [(0, -T % 2 + 2), (0, 0)])

    inner = B1[1:-2:2]
    outer = B1[2::2].swapaxes(1, 2)
    far = (B2[2:, :, None] * identity).reshape(-1, 2, D, D)
    own = jnp.block([[A[::2], inner.swapaxes(1, 2)], [inner, A[1::2]]])
    ahead = jnp.block([[far[:, 0], jnp.zeros_like(outer)], [outer, far[:, 1]]])
    return own, ahead


def _solve_corner(system: BorderedSystem, reduced: Array, damping: Array | float) -> Array:
    """Compute the step of the mode parameters (M,) from the forward-reduced right-hand sides, rows of M + 1."""
    M = system.gradient_m.shape[0]
    flat = reduced.reshape(-1, M + 1)
    product = flat.T @ flat
    schur = system.corner + damping * jnp.eye(M, dtype=flat.dtype) - product[:M, :M]
    inverse = _inverse_factor(schur)
    return inverse.T @ (inverse @ (-system.gradient_m - product[:M, M]))


class BorderedFactor(NamedTuple):
    """Block Cholesky factor of the damped matrix of a path, for right-hand sides that become known later.

    P pairs of slices have W = 2 D joint angles each, and there are M mode parameters.
    """

    inverse: Float[Array, "pairs width width"]
    """``L_i^-1`` of each pair."""

    ahead: Float[Array, "pairs width width"]
    """Reduced coupling C_i of each pair with the next one."""

    border: Float[Array, "pairs width parameters"]
    """Border after the forward sweep."""

    corner_inverse: Float[Array, "parameters parameters"]
    """Inverse Cholesky factor of the Schur complement of the mode parameters."""


class ReducedSides(NamedTuple):
    """R right-hand sides r after the forward sweep. For two of them, ``r^T H^-1 s`` is the product of these arrays."""

    of_joints: Float[Array, "pairs width sides"]
    of_parameters: Float[Array, "parameters sides"]


def factorize_bordered(system: BorderedSystem, damping: Float[Array, ""] | float) -> BorderedFactor:
    """Factorize the damped matrix of a path.

    Args:
        system: The system of a path NLP.
        damping: Number that is added to the whole diagonal.

    Returns:
        The factor; NaN if the damped matrix is indefinite.
    """
    assert system.coupling is not None and system.far_coupling is not None
    D = system.gradient_q.shape[1]
    A = system.diagonal + damping * jnp.eye(D, dtype=system.diagonal.dtype)
    own, ahead = _pair_blocks(A, system.coupling, system.far_coupling)
    border = _in_pairs(system.border)
    width = own.shape[-1]

    def forward(before: Array, pair: _Pair) -> tuple[Array, tuple[Array, Array]]:
        inverse = _inverse_factor(pair.own - before[:, :width])
        sides = jnp.concatenate([pair.ahead, pair.right - before[:, width:]], axis=1)
        solved = inverse @ sides
        return solved[:, :width].T @ solved, (inverse, solved)

    start = jnp.zeros((width, width + border.shape[-1]), A.dtype)
    _, (inverse, solved) = jax.lax.scan(forward, start, _Pair(own, ahead, border))
    reduced = solved[..., width:]

    # The Schur complement of the mode parameters.
    M = system.gradient_m.shape[0]
    flat = reduced.reshape(-1, M)
    schur = system.corner + damping * jnp.eye(M, dtype=A.dtype) - flat.T @ flat
    return BorderedFactor(inverse, solved[..., :width], reduced, _inverse_factor(schur))


def reduce_sides(
    factor: BorderedFactor,
    of_joints: Float[Array, "slices joints sides"],
    of_parameters: Float[Array, "parameters sides"],
) -> ReducedSides:
    """Do the forward sweep for right-hand sides.

    Args:
        factor: Factor of the matrix.
        of_joints: Entries of the joint angles.
        of_parameters: Entries of the mode parameters.
    """

    def forward(before: Array, pair: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        inverse, ahead, sides = pair
        solved = inverse @ (sides - before)
        return ahead.T @ solved, solved

    sides = _in_pairs(of_joints)
    start = jnp.zeros(sides.shape[1:], sides.dtype)
    _, reduced = jax.lax.scan(forward, start, (factor.inverse, factor.ahead, sides))
    rest = of_parameters - jnp.einsum("pwm,pwr->mr", factor.border, reduced)
    return ReducedSides(reduced, factor.corner_inverse @ rest)


def solve_reduced(
    factor: BorderedFactor, side: ReducedSides, slices: int
) -> tuple[Float[Array, "slices joints"], Float[Array, " parameters"]]:
    """Do the backward sweep for one right-hand side, without the axis of sides.

    Args:
        factor: Factor of the matrix.
        side: The right-hand side after the forward sweep.
        slices: Number T of slices.

    Returns:
        The solution, for joint angles and mode parameters.
    """
    dm = factor.corner_inverse.T @ side.of_parameters
    right = side.of_joints - factor.border @ dm

    def backward(after: Array, pair: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        inverse, ahead, own = pair
        x = inverse.T @ (own - ahead @ after)
        return x, x

    start = jnp.zeros(right.shape[-1], right.dtype)
    _, dq = jax.lax.scan(backward, start, (factor.inverse, factor.ahead, right), reverse=True)
    joints = right.shape[-1] // 2
    return dq.reshape(-1, joints)[:slices], dm
