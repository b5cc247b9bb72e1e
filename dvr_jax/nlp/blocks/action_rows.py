"""How rows that belong to the actions of a path enter a Gauss-Newton system."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import SystemParts


def add_action_rows(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: Float[Array, "phases rows parameters"],
    multiplier_estimate: Float[Array, "phases rows"],
    active_penalty: Float[Array, "phases rows"],
) -> SystemParts:
    """Add rows that depend on the mode parameters of one action each to the corner of a system.

    Every action has its own 4 x 4 block on the diagonal of the corner.

    Args:
        parts: The system so far.
        problem: The NLP, without batch axes.
        x: Its variables.
        jacobian: Derivatives of the rows by the mode parameters of their action.
        multiplier_estimate: Estimates of the rows' multipliers.
        active_penalty: Penalties of the rows that are active, and 0 for the others.

    Returns:
        The system with the rows.
    """
    if jacobian.shape[-2] == 0:
        return parts

    K = len(x.m)
    own = jnp.einsum("kri,krj,kr->kij", jacobian, jacobian, active_penalty)
    corner = jnp.einsum("kij,kl->kilj", own, jnp.eye(K, dtype=own.dtype)).reshape(
        K * PARAMETERS, -1
    )
    gradient = jnp.einsum("kri,kr->ki", jacobian, multiplier_estimate).reshape(-1)
    return parts._replace(corner=parts.corner + corner, gradient_m=parts.gradient_m + gradient)
