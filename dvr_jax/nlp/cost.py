"""The cost of one NLP: squared accelerations, weighted squared distances from given postures, and preferred grasps.

With the second differences ``a_t = q_t - 2 q_{t-1} + q_{t-2}`` of a path that starts at rest at the home posture, with
the targets r_t and weights w_t of the regularization, and with the weights v_k of the mode parameters m_k,

    cost = 1/2 sum_t w_t (q_t - r_t)^2  +  1/2 ACCELERATION_WEIGHT sum_t a_t^2  +  1/2 sum_k v_k m_k^2.

The regularization leads to a feasible point near the start; without it, the other two sums lead to an optimal one.
The second sum belongs to paths only. The last one prefers steep grasps near the center of an object
(`dvr_jax.operators.grasp`); it is no part of the objective of the paper.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import SystemParts

ACCELERATION_WEIGHT = 1.0
"""Weight of the squared second differences in the cost [1/rad^2]."""


def accelerations(
    problem: Problem, q: Float[Array, "slices joints"]
) -> Float[Array, "slices joints"]:
    """Compute the second differences of a path that starts at rest at the home posture [rad/slice^2].

    Args:
        problem: The NLP, without batch axes.
        q: Joint angles [rad].
    """
    extended = jnp.concatenate([jnp.broadcast_to(problem.home, (2, q.shape[1])), q])
    return extended[2:] - 2 * extended[1:-1] + extended[:-2]


def cost(problem: Problem, x: Variables) -> Float[Array, ""]:
    """Compute the cost of a point, half the sum of all squared cost residuals.

    Args:
        problem: The NLP, without batch axes.
        x: Its variables.
    """
    value = 0.5 * jnp.sum(
        problem.regularization_weight * (x.q - problem.regularization_target) ** 2
    )
    value += 0.5 * problem.preference_scale * jnp.sum(problem.preference * x.m**2)
    if x.q.shape[0] > x.m.shape[0]:
        value += 0.5 * ACCELERATION_WEIGHT * jnp.sum(accelerations(problem, x.q) ** 2)
    return value


def curvature(problem: Problem, step: Variables) -> Float[Array, ""]:
    """Compute half the product ``d^T H d`` of a step d with the Hessian H of the cost.

    Args:
        problem: The NLP, without batch axes.
        step: A step of its variables.
    """
    # The cost is quadratic, so that this is the cost of the step when all targets are zero.
    centered = problem._replace(
        home=jnp.zeros_like(problem.home),
        regularization_target=jnp.zeros_like(problem.regularization_target),
    )
    return cost(centered, step)


def path_cost(home: Float[np.ndarray, " joints"], q: Float[np.ndarray, "slices joints"]) -> float:
    """Return the objective of the paper of a path, half the sum of its squared accelerations [rad^2/slice^4].

    Args:
        home: Home posture, at which the path starts at rest [rad].
        q: Joint angles at its slices [rad].
    """
    second_differences = np.diff(np.concatenate([home[None], home[None], q]), n=2, axis=0)
    return float(0.5 * ACCELERATION_WEIGHT * np.sum(second_differences**2))


def preference_cost(
    preference: Float[np.ndarray, "phases 4"], m: Float[np.ndarray, "phases 4"]
) -> float:
    """Return the part of the cost that prefers some modes to others.

    Args:
        preference: Weights of the squared mode parameters [1/m^2 or 1/rad^2].
        m: Mode parameters [m or rad].
    """
    return float(0.5 * np.sum(preference * m**2))


def add_cost(
    parts: SystemParts, problem: Problem, x: Variables, gradient_scale: Float[Array, ""]
) -> SystemParts:
    """Add the cost to a Gauss-Newton system; the cost is quadratic, so its Hessian is exact.

    Args:
        parts: The system so far.
        problem: The NLP, without batch axes.
        x: Its variables.
        gradient_scale: Factor of the cost's gradient; its Hessian is added as it is.
    """
    weight = problem.regularization_weight
    diagonal = parts.joint_diagonal + weight
    gradient = parts.gradient_q + gradient_scale * weight * (x.q - problem.regularization_target)
    preference = problem.preference_scale * jnp.reshape(problem.preference, -1)
    parts = parts._replace(
        corner=parts.corner + jnp.diag(preference),
        gradient_m=parts.gradient_m + gradient_scale * preference * x.m.reshape(-1),
    )

    T, D = x.q.shape
    if x.m.shape[0] == T:
        return parts._replace(joint_diagonal=diagonal, gradient_q=gradient)

    # The gradient of the accelerations is D^T a: each slice takes part in three second differences.
    a = gradient_scale * accelerations(problem, x.q)
    ahead = jnp.concatenate([a, jnp.zeros((2, D), a.dtype)])
    gradient += ACCELERATION_WEIGHT * (a - 2 * ahead[1:-1] + ahead[2:])
    own, first, second = (ACCELERATION_WEIGHT * band[:, None] for band in _acceleration_bands(T))
    return parts._replace(
        joint_diagonal=diagonal + own,
        coupling_diagonal=parts.coupling_diagonal + first,
        far_coupling=parts.far_coupling + second,
        gradient_q=gradient,
    )


def _acceleration_bands(T: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return diagonal, first and second sub-diagonal of D^T D, each (T,), for the matrix D of second differences."""
    D = np.eye(T) - 2 * np.eye(T, k=-1) + np.eye(T, k=-2)
    H = D.T @ D
    first = np.concatenate([[0.0], np.diag(H, -1)])
    second = np.concatenate([[0.0, 0.0], np.diag(H, -2)])
    return np.diag(H).copy(), first, second
