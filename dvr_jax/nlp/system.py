"""The Gauss-Newton system of one NLP, and the sums into which constraint blocks and costs add their contributions.

The unknowns are the steps of the D joint angles at each of the T slices, and of the 4 K mode parameters. The matrix H
couples each slice with

- the slice before it, by blocks B1_t (distances between two slices depend on both),
- the second slice before it, by *diagonal* blocks B2_t (the cost of accelerations couples each joint only with itself),
- the mode parameters, by blocks E_t (the *border*):

        [ A_0      B1_1^T   B2_2                 E_0 ]
        [ B1_1     A_1      B1_2^T   B2_3        E_1 ]
    H = [ B2_2     B1_2     A_2      ...         ... ]
        [          B2_3     ...      A_{T-1}         ]
        [ E_0^T    E_1^T    ...                   C  ]
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.nlp.problem import Problem


class BorderedSystem(NamedTuple):
    """A symmetric positive definite system ``H [dq; dm] = -[gradient_q; gradient_m]``."""

    diagonal: Float[Array, "slices joints joints"]
    """Blocks A_t."""

    coupling: Float[Array, "slices joints joints"] | None
    """Blocks B1_t with slice t - 1; None for keyframes, which nothing couples in time."""

    far_coupling: Float[Array, "slices joints"] | None
    """Diagonals of the blocks B2_t with slice t - 2; None for keyframes."""

    border: Float[Array, "slices joints parameters"]
    """Blocks E_t."""

    corner: Float[Array, "parameters parameters"]
    """Block C."""

    gradient_q: Float[Array, "slices joints"]
    """Derivative of the augmented Lagrangian by the joint angles."""

    gradient_m: Float[Array, " parameters"]
    """Derivative of the augmented Lagrangian by the mode parameters, action after action."""


class SystemParts(NamedTuple):
    """A Gauss-Newton system to which constraint blocks and costs are added; diagonal parts are stored separately."""

    blocks: Float[Array, "slices joints joints"]
    """Blocks A_t without `joint_diagonal`."""

    joint_diagonal: Float[Array, "slices joints"]
    """Numbers that are added to the diagonals of the blocks A_t."""

    coupling: Float[Array, "slices joints joints"]
    """Blocks B1_t without `coupling_diagonal`."""

    coupling_diagonal: Float[Array, "slices joints"]
    """Numbers that are added to the diagonals of the blocks B1_t."""

    far_coupling: Float[Array, "slices joints"]
    """Diagonals of the blocks B2_t."""

    border: Float[Array, "slices joints parameters"]
    """Blocks E_t."""

    corner: Float[Array, "parameters parameters"]
    """Block C."""

    gradient_q: Float[Array, "slices joints"]
    """Derivative by the joint angles."""

    gradient_m: Float[Array, " parameters"]
    """Derivative by the mode parameters, action after action."""


class Curvature(NamedTuple):
    """Second derivatives of a sum of constraint rows by all variables, in the blocks of `BorderedSystem`."""

    diagonal: Float[Array, "*batch slices joints joints"]
    """Blocks A_t."""

    coupling: Float[Array, "*batch slices joints joints"]
    """Blocks B1_t with slice t - 1."""

    border: Float[Array, "*batch slices joints parameters"]
    """Blocks E_t."""

    corner: Float[Array, "*batch parameters parameters"]
    """Block C."""


def empty_parts(slices: int, joints: int, parameters: int, dtype: Any) -> SystemParts:
    """Return a system to which nothing has been added.

    Args:
        slices: Number T of slices.
        joints: Number D of joints of all arms.
        parameters: Number M of mode parameters.
        dtype: Type of the numbers.
    """
    T = slices
    D = joints
    M = parameters
    return SystemParts(
        blocks=jnp.zeros((T, D, D), dtype),
        joint_diagonal=jnp.zeros((T, D), dtype),
        coupling=jnp.zeros((T, D, D), dtype),
        coupling_diagonal=jnp.zeros((T, D), dtype),
        far_coupling=jnp.zeros((T, D), dtype),
        border=jnp.zeros((T, D, M), dtype),
        corner=jnp.zeros((M, M), dtype),
        gradient_q=jnp.zeros((T, D), dtype),
        gradient_m=jnp.zeros(M, dtype),
    )


def assemble(parts: SystemParts, problem: Problem, is_path: bool) -> BorderedSystem:
    """Complete a system to which all costs and constraint blocks have been added.

    Pinned mode parameters, whose bounds are equal, must not change: their rows of H become unit rows and their gradient
    becomes zero, so that their steps are zero.

    Args:
        parts: The sum of all costs and blocks.
        problem: The NLP, without batch axes.
        is_path: Whether the NLP is a path NLP, with slices between the switches.
    """
    T, D = parts.joint_diagonal.shape
    dtype = parts.blocks.dtype
    identity = jnp.eye(D, dtype=dtype)
    free = (problem.parameter_upper > problem.parameter_lower).reshape(-1).astype(dtype)

    coupling = None
    far_coupling = None
    if is_path:
        # The slice before the first one is the home posture, which is no variable, so block B1_0 is zero.
        inside = (jnp.arange(T) > 0).astype(dtype)[:, None, None]
        coupling = inside * (parts.coupling + identity * parts.coupling_diagonal[:, None])
        far_coupling = parts.far_coupling

    return BorderedSystem(
        diagonal=parts.blocks + identity * parts.joint_diagonal[:, None],
        coupling=coupling,
        far_coupling=far_coupling,
        border=parts.border * free,
        corner=parts.corner * free * free[:, None] + jnp.diag(1 - free),
        gradient_q=parts.gradient_q,
        gradient_m=parts.gradient_m * free,
    )
