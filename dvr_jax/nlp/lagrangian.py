"""Costs, constraint rows and Gauss-Newton system of one NLP: what the augmented Lagrangian (`dvr_jax.solver.augmented_lagrangian`)
is made of here."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.nlp.constraints import ConstraintValues, Jacobians
from dvr_jax.nlp.problem import PARAMETERS, Problem, Variables
from dvr_jax.nlp.slices import NormalEquations
from dvr_jax.nlp.tolerances import joint_limits, rest_steps
from dvr_jax.solver.banded import BorderedSystem


class Weights(NamedTuple):
    """Costs, and penalties relative to the solver's common one: they bring metres and radians to a common scale."""

    acceleration: float = 1.0
    """Cost of a squared second difference [1/rad^2]; paths only."""
    distance: float = 1.0
    position: float = 1.0
    rotation: float = 0.1
    limit: float = 0.1
    parameter: float = 1.0
    rest: float = 0.1


WEIGHTS = Weights()
"""What the solver uses."""


class Residuals(NamedTuple):
    """Constraint rows by the sign conventions g <= 0, h = 0; forces and curvatures have the same shapes."""

    distance: Array
    """(T', P), at the samples of the slices."""
    switch: Array
    """(K, 6)."""
    rest: Array
    """(K, 14)."""
    limit: Array
    """(2, T, 14) of the lower and the upper joint limits."""
    bound: Array
    """(2, K, 4) of the lower and the upper bounds of the mode parameters."""
    footprint: Array
    """(K, 4)."""


class FlatResiduals(NamedTuple):
    """The same rows in fewer arrays: every array costs kernels of its own, and theirs take longer than the few rows."""

    distance: Array
    """(T', P)."""
    equality: Array
    """Switches and rest, (E,)."""
    inequality: Array
    """Limits, bounds and footprints, (I,)."""


EQUALITIES = FlatResiduals(False, True, False)
"""Which rows are equalities."""


def pack(rows: Residuals) -> FlatResiduals:
    """ConstraintValues of one NLP."""
    equalities, inequalities = (rows.switch, rows.rest), (rows.limit, rows.bound, rows.footprint)
    return FlatResiduals(
        rows.distance, *(jnp.concatenate([v.reshape(-1) for v in of]) for of in (equalities, inequalities))
    )


def unpack(packed: FlatResiduals, T: int, K: int) -> Residuals:
    """ConstraintValues of one NLP of T slices and K actions: the inverse of `pack`."""
    equalities = _cut(packed.equality, (K, 6), (K, 14))
    return Residuals(packed.distance, *equalities, *_cut(packed.inequality, (2, T, 14), (2, K, PARAMETERS), (K, 4)))


def _cut(value: Array, *shapes: tuple[int, ...]) -> list[Array]:
    ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1]
    return [piece.reshape(shape) for piece, shape in zip(jnp.split(value, ends), shapes, strict=True)]


def residuals(problem: Problem, x: Variables, rows: ConstraintValues) -> Residuals:
    """All constraint rows of one NLP."""
    lower, upper = jnp.asarray(joint_limits(), x.q.dtype)
    T, K = x.q.shape[0], x.m.shape[0]
    rest = rest_steps(problem, x) if T > K else jnp.zeros((K, x.q.shape[1]), x.q.dtype)
    return Residuals(
        distance=-rows.distance,
        switch=rows.switch,
        rest=rest,
        limit=jnp.stack([lower - x.q, x.q - upper]),
        bound=jnp.stack([problem.lower - x.m, x.m - problem.upper]),
        footprint=rows.footprint,
    )


def scales(weights: Weights, T: int, K: int, dtype: jnp.dtype) -> FlatResiduals:
    """Penalty of each row relative to the common one; the distances share one number."""
    switch = np.tile(np.repeat([weights.position, weights.rotation], 3), K)
    equality = np.concatenate([switch, np.full(K * 14, weights.rest)])
    inequality = np.repeat([weights.limit, weights.parameter], [2 * T * 14, (2 * PARAMETERS + 4) * K])
    return FlatResiduals(*(jnp.asarray(value, dtype) for value in (weights.distance, equality, inequality)))


def accelerations(problem: Problem, q: Array) -> Array:
    """Second differences ``(T, 14)`` of a path that starts at home at rest [rad]."""
    extended = jnp.concatenate([jnp.broadcast_to(problem.home, (2, q.shape[1])), q])
    return extended[2:] - 2 * extended[1:-1] + extended[:-2]


def cost(problem: Problem, x: Variables, weights: Weights) -> Array:
    """Half the sum of all squared costs of one NLP."""
    value = 0.5 * jnp.sum(problem.attraction * (x.q - problem.reference) ** 2)
    if x.q.shape[0] > x.m.shape[0]:
        value += 0.5 * weights.acceleration * jnp.sum(accelerations(problem, x.q) ** 2)
    return value


def gauss_newton_system(
    problem: Problem,
    x: Variables,
    distances: NormalEquations,
    slopes: Jacobians,
    force: Residuals,
    curvature: Residuals,
    weights: Weights,
    drive: Array | float = 1.0,
) -> BorderedSystem:
    """Gauss-Newton system of the augmented Lagrangian at ``x``.

    Args:
        problem, x: of one NLP.
        distances: what the distances add, at its T' samples.
        slopes: of switches and footprints.
        force, curvature: of the rows (`dvr_jax.solver.augmented_lagrangian`); those of the distances are in ``distances``.
        drive: factor of the costs' gradient, whose Hessian stays.
    """
    T, K = x.q.shape[0], x.m.shape[0]
    S, N, dtype = T // K, problem.half.shape[0], x.q.dtype

    # A sample between two slices depends on both: on slice t by its share s, on slice t - 1 by 1 - s.
    share = problem.share
    M = share.shape[1]

    def onto(weights: Array, value: Array) -> Array:
        """Weighted sum of the M samples of each slice."""
        samples = value.reshape(T, M, *value.shape[1:])
        weights = weights.reshape(T, M, *(1,) * (value.ndim - 1))
        return sum(weights[:, m] * samples[:, m] for m in range(M))  # type: ignore[return-value]

    def shifted(value: Array) -> Array:
        """Values of slice t + 1 at slice t; what falls on the home posture before the first slice is dropped."""
        return jnp.concatenate([value[1:], jnp.zeros_like(value[:1])])

    J = slice(0, 14)
    A_sample, E_sample, C_sample = distances.matrix[:, J, J], distances.matrix[:, J, 14:], distances.matrix[:, 14:, 14:]
    g_sample, gm_sample = distances.gradient[:, J], distances.gradient[:, 14:]
    A = onto(share**2, A_sample)
    gradient_q = onto(share, g_sample)
    E_own = onto(share, E_sample)
    mixed: Array | float = 0.0
    if M > 1:
        A += shifted(onto((1 - share) ** 2, A_sample))
        mixed = onto(share * (1 - share), A_sample)
        gradient_q += shifted(onto(1 - share, g_sample))

    # Each object's local parameter columns belong to the action that it is attached by: scatter with one-hot
    # matrices, per phase.
    belongs = jnp.asarray(problem.attached_by[:-1, :, None] == jnp.arange(K), dtype)

    def to_actions(value: Array) -> Array:
        local = value.reshape(K, S, -1, PARAMETERS, N)
        return jnp.einsum("ksicn,knl->ksilc", local, belongs).reshape(T, -1, K * PARAMETERS)

    E = to_actions(E_own)
    if M > 1:
        E += shifted(to_actions(onto(1 - share, E_sample)))
    C_phase = C_sample.reshape(K, S * M, PARAMETERS, N, PARAMETERS, N).sum(1)
    C = jnp.einsum("kcndo,knl,koj->lcjd", C_phase, belongs, belongs)
    gradient_m = jnp.einsum("kcn,knl->lc", gm_sample.reshape(K, S * M, PARAMETERS, N).sum(1), belongs)

    # Mode switches: six rows each, on the last slice of their phase.
    own = jnp.stack([_take(problem.attached_by[:-1], problem), _take(problem.attached_by[1:], problem)], axis=1)
    to_action = jnp.asarray(own[..., None] == jnp.arange(K), dtype)
    Sq = slopes.switch_q
    Sm = jnp.einsum("krob,kol->krlb", slopes.switch_m, to_action).reshape(K, 6, K * PARAMETERS)
    weighted_q, weighted_m = Sq * curvature.switch[..., None], Sm * curvature.switch[..., None]
    last = slice(S - 1, None, S)
    A = A.at[last].add(jnp.einsum("kri,krj->kij", weighted_q, Sq))
    E = E.at[last].add(jnp.einsum("kri,krj->kij", weighted_q, Sm))
    C = C.reshape(K * PARAMETERS, -1) + jnp.einsum("kri,krj->ij", weighted_m, Sm)
    gradient_q = gradient_q.at[last].add(jnp.einsum("kri,kr->ki", Sq, force.switch))
    gradient_m = gradient_m.reshape(-1) + jnp.einsum("kri,kr->i", Sm, force.switch)

    # Bounds and footprints of the mode parameters; joint limits; the pull to the reference.
    Fm = slopes.footprint_m
    block = jnp.einsum("kri,krj,kr->kij", Fm, Fm, curvature.footprint)
    block += jnp.eye(PARAMETERS, dtype=dtype) * (curvature.bound[0] + curvature.bound[1])[:, None]
    C += jnp.einsum("kij,kl->kilj", block, jnp.eye(K, dtype=dtype)).reshape(C.shape)
    gradient_m += (force.bound[1] - force.bound[0] + jnp.einsum("kri,kr->ki", Fm, force.footprint)).reshape(-1)
    diagonal = curvature.limit[0] + curvature.limit[1] + problem.attraction
    gradient_q += force.limit[1] - force.limit[0] + drive * problem.attraction * (x.q - problem.reference)

    coupling = far_coupling = None
    if S > 1:
        r = drive * accelerations(problem, x.q)
        ahead = jnp.concatenate([r, jnp.zeros((2, r.shape[1]), dtype)])
        gradient_q += weights.acceleration * (r - 2 * ahead[1:-1] + ahead[2:])
        own_weight, couple_1, couple_2 = (weights.acceleration * w[:, None] for w in _acceleration_pattern(T))
        rest = jnp.zeros((T, 14), dtype).at[last].set(curvature.rest * jnp.repeat(problem.resting, 7, axis=1))
        rest_force = jnp.zeros((T, 14), dtype).at[last].set(force.rest * jnp.repeat(problem.resting, 7, axis=1))
        before = jnp.concatenate([rest[1:], jnp.zeros((1, 14), dtype)])
        diagonal += own_weight + rest + before
        gradient_q += rest_force - jnp.concatenate([rest_force[1:], jnp.zeros((1, 14), dtype)])
        # B1 of slice 0 would couple it with the home posture, which is no variable.
        inside = (jnp.arange(T) > 0).astype(dtype)[:, None, None]
        coupling = inside * (mixed + jnp.eye(14, dtype=dtype) * (couple_1 - rest)[:, None])
        far_coupling = jnp.broadcast_to(couple_2, rest.shape)
    A += jnp.eye(14, dtype=dtype) * diagonal[:, None]

    # Pinned parameters take no part: unit rows.
    free = (problem.upper > problem.lower).reshape(-1).astype(dtype)
    E *= free
    C = C * free * free[:, None] + jnp.diag(1 - free)
    return BorderedSystem(A, coupling, far_coupling, E, C, gradient_q, gradient_m * free)


def _take(attached_by: Array, problem: Problem) -> Array:
    """(K,) entries of the switched objects in an array (K, N)."""
    return jnp.take_along_axis(attached_by, problem.switched_object[:, None], axis=1)[:, 0]


def _acceleration_pattern(T: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diagonal, first and second sub-diagonal of D^T D for the second differences D of `accelerations`, each (T,)."""
    D = np.eye(T) - 2 * np.eye(T, k=-1) + np.eye(T, k=-2)
    H = D.T @ D
    first = np.concatenate([[0.0], np.diag(H, -1)])
    second = np.concatenate([[0.0, 0.0], np.diag(H, -2)])
    return np.diag(H).copy(), first, second
