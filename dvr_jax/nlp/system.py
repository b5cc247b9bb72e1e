"""The Gauss-Newton system of one NLP, and its parts while blocks and costs add to it.

Unknowns are the steps of the joint angles of T slices, D each, and of the M = 4 K mode parameters. The matrix couples
each slice with the one before it (distances are sampled between slices too), with the second before it through a
*diagonal* block (accelerations act on each joint alone), and with the border of mode parameters:

        [ A_0      B1_1^T   B2_2                 E_0 ]
        [ B1_1     A_1      B1_2^T   B2_3        E_1 ]
    H = [ B2_2     B1_2     A_2      ...         ... ]
        [          B2_3     ...      A_{T-1}         ]
        [ E_0^T    E_1^T    ...                   C  ]
"""

from __future__ import annotations

from typing import NamedTuple

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
    """Derivative by the joint angles."""

    gradient_m: Float[Array, " parameters"]
    """Derivative by the mode parameters."""


class SystemParts(NamedTuple):
    """A system while it is being added up; diagonal parts are kept apart until the end."""

    blocks: Float[Array, "slices joints joints"]
    """Blocks A_t without `joint_diagonal`."""

    joint_diagonal: Float[Array, "slices joints"]
    """What is added to the diagonals of the blocks A_t."""

    coupling: Float[Array, "slices joints joints"]
    """Blocks B1_t without `coupling_diagonal`."""

    coupling_diagonal: Float[Array, "slices joints"]
    """What is added to the diagonals of the blocks B1_t."""

    far_coupling: Float[Array, "slices joints"]
    """Diagonals of the blocks B2_t."""

    border: Float[Array, "slices joints parameters"]
    corner: Float[Array, "parameters parameters"]
    gradient_q: Float[Array, "slices joints"]
    gradient_m: Float[Array, " parameters"]


def assemble(parts: SystemParts, problem: Problem, is_path: bool) -> BorderedSystem:
    """Complete a system whose costs and blocks have all been added.

    Pinned mode parameters take no part: they get unit rows.

    Args:
        parts: The sum of all costs and blocks.
        problem: The NLP, without batch axes.
        is_path: Whether there are slices between the switches.
    """
    T, D = parts.joint_diagonal.shape
    dtype = parts.blocks.dtype
    identity = jnp.eye(D, dtype=dtype)
    free = (problem.parameter_upper > problem.parameter_lower).reshape(-1).astype(dtype)

    coupling = None
    far_coupling = None
    if is_path:
        # The first slice would be coupled with the home posture, which is no variable.
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
