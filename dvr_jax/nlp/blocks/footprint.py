"""The footprint block requires that an object that an action places lies within the rectangle of its support.

Where only the object's center has to lie within the support, the footprint is a point.

It has 16 rows g for each action, in the support's own frame: the distances by which each of the four corners of the
object's footprint extends beyond each of the sides +x, +y, -x and -y of the support [m]. The footprint of a prism
(hx, hy, hz, r) that is turned by the angle ``a`` with respect to the support is a rectangle with rounded corners of the
radius r. With the center's offset d, the signs u and v of a corner, and the support's half extents s, the center of the
rounding is

    c_x = d_x + u hx cos a - v hy sin a,        c_y = d_y + u hx sin a + v hy cos a,

and the rows at +x and -x are ``c_x + r - s_x`` and ``-c_x + r - s_x``. All corners have rows, because the one that
extends furthest changes with the angle, and the maximum of the four has a kink where it does. For an action that places
nothing, the rows are the constant -1.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks.action_rows import add_action_rows
from dvr_jax.nlp.blocks.block import (
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    Measure,
)
from dvr_jax.nlp.problem import Problem

FOOTPRINT_TOLERANCE = 1e-3
"""Largest distance by which the footprint of a feasible point may extend beyond its support [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""

SIDES = 4
"""Number of sides of a support."""

CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
"""Signs u and v of the corners of a footprint."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, SIDES * len(CORNERS))


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows, and their Jacobian by the mode parameters of the same action (B, K, 16, 4)."""
    problems = given.problems
    rows, jacobian = _overhang(problems, given.x.m)
    is_placed = problems.on_support[..., None] > 0
    rows = jnp.where(is_placed, rows, -1)
    jacobian = jnp.where(is_placed[..., None], jacobian, 0)
    return Evaluation(rows, jacobian, (jnp.maximum(rows.max(axis=(1, 2)), 0),))


def _overhang(
    problems: Problem, m: Array
) -> tuple[Float[Array, "batch phases 16"], Float[Array, "batch phases 16 parameters"]]:
    """Compute the overhang of every switched object at four sides [m], and its derivatives by the mode parameters."""
    prism = jnp.asarray(problems.inner_prism)
    support = jnp.asarray(problems.support)
    B, K = support.shape[:2]

    # The center's offset in the support's frame.
    c = jnp.cos(support[..., 2])
    s = jnp.sin(support[..., 2])
    dx = m[..., 0] - support[..., 0]
    dy = m[..., 1] - support[..., 1]
    offset = jnp.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)

    # The corners from the center, and their derivatives by the yaw (B, K, 2, 4).
    turn = (m[..., 2] - support[..., 2])[..., None]
    hx = prism[..., 0, None] * CORNERS[:, 0]
    hy = prism[..., 1, None] * CORNERS[:, 1]
    corner_x = hx * jnp.cos(turn) - hy * jnp.sin(turn)
    corner_y = hx * jnp.sin(turn) + hy * jnp.cos(turn)
    corners = jnp.stack([corner_x, corner_y], axis=-2)
    by_yaw = jnp.stack([-corner_y, corner_x], axis=-2)

    # The sides are in the order +x, +y, -x, -y, and the columns are x, y, yaw and the unused fourth parameter.
    reach = offset[..., None] + corners
    rounding = prism[..., 3, None, None]
    limits = jnp.concatenate([support[..., 3:], support[..., 3:]], axis=-1)[..., None]
    rows = jnp.concatenate([reach, -reach], axis=-2) + rounding - limits
    by_x = jnp.broadcast_to(jnp.stack([c, -s], axis=-1)[..., None], reach.shape)
    by_y = jnp.broadcast_to(jnp.stack([s, c], axis=-1)[..., None], reach.shape)
    change = jnp.stack([by_x, by_y, by_yaw, jnp.zeros_like(by_yaw)], axis=-1)
    jacobian = jnp.concatenate([change, -change], axis=-3)
    return rows.reshape(B, K, -1), jacobian.reshape(B, K, -1, PARAMETERS)


FOOTPRINT = ConstraintBlock(
    name="footprint",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("footprint", "m", FOOTPRINT_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=add_action_rows,
)
"""The block that keeps footprints within their supports."""
