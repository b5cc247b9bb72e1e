"""Footprint: what an action puts down lies within the rectangle of its support.

Four rows for each action, in the support's own frame: by how much the object's footprint sticks out at the sides +x,
+y, -x and -y [m]. A prism (hx, hy, hz, r) that is turned by ``a`` against the support reaches

    e_x = |cos a| hx + |sin a| hy + r,        e_y = |sin a| hx + |cos a| hy + r

from its center, so that the rows at +x and -x are ``+-d_x + e_x - s_x`` for the center's offset d and the support's
half extents s. The rows of an action that puts nothing down are -1.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import PARAMETERS
from dvr_jax.nlp.blocks.block import (
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    Measure,
)
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.system import SystemParts

FOOTPRINT_TOLERANCE = 1e-3
"""Largest overhang of a footprint over its support [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""

SIDES = 4


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, SIDES)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    problems = given.problems
    rows, jacobian = _overhang(problems, given.x.m)
    is_placed = problems.on_support[..., None] > 0
    rows = jnp.where(is_placed, rows, -1)
    jacobian = jnp.where(is_placed[..., None], jacobian, 0)
    return Evaluation(rows, jacobian, (jnp.maximum(rows.max(axis=(1, 2)), 0),))


def _overhang(
    problems: Problem, m: Array
) -> tuple[Float[Array, "batch phases 4"], Float[Array, "batch phases 4 parameters"]]:
    """Overhang of every switched object over its support [m], and its derivatives by the mode parameters."""
    prism = jnp.take_along_axis(problems.prism, problems.switched_object[..., None], axis=1)
    support = problems.support

    # The center's offset in the support's frame.
    c = jnp.cos(support[..., 2])
    s = jnp.sin(support[..., 2])
    dx = m[..., 0] - support[..., 0]
    dy = m[..., 1] - support[..., 1]
    offset = jnp.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)

    # How far the footprint reaches from its center, and how that changes with the yaw: |cos|' = -sin sign(cos), and
    # |sin|' = cos sign(sin).
    turn = m[..., 2] - support[..., 2]
    cosine = jnp.cos(turn)
    sine = jnp.sin(turn)
    hx = prism[..., 0]
    hy = prism[..., 1]
    extent_x = jnp.abs(cosine) * hx + jnp.abs(sine) * hy
    extent_y = jnp.abs(sine) * hx + jnp.abs(cosine) * hy
    extent = jnp.stack([extent_x, extent_y], axis=-1) + prism[..., 3, None]
    fall = -sine * jnp.sign(cosine)
    rise = cosine * jnp.sign(sine)
    widening = jnp.stack([fall * hx + rise * hy, rise * hx + fall * hy], axis=-1)

    rows = jnp.concatenate([offset + extent, extent - offset], axis=-1) - jnp.tile(
        support[..., 3:], 2
    )
    by_position = jnp.stack([jnp.stack([c, s], axis=-1), jnp.stack([-s, c], axis=-1)], axis=-2)
    by_yaw = jnp.stack([widening, jnp.zeros_like(widening)], axis=-1)
    jacobian = jnp.concatenate(
        [
            jnp.concatenate([by_position, -by_position], axis=-2),
            jnp.concatenate([by_yaw, by_yaw], axis=-2),
        ],
        axis=-1,
    )
    return rows, jacobian


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: Float[Array, "phases 4 parameters"],
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    K = len(x.m)
    own = jnp.einsum("kri,krj,kr->kij", jacobian, jacobian, active_penalty)
    corner = jnp.einsum("kij,kl->kilj", own, jnp.eye(K, dtype=own.dtype)).reshape(
        K * PARAMETERS, -1
    )
    return parts._replace(
        corner=parts.corner + corner,
        gradient_m=parts.gradient_m
        + jnp.einsum("kri,kr->ki", jacobian, multiplier_estimate).reshape(-1),
    )


FOOTPRINT = ConstraintBlock(
    name="footprint",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("footprint", "m", FOOTPRINT_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""Footprints lie within their supports."""
