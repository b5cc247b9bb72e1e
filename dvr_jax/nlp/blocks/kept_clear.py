"""The kept-clear block requires that an object that an action places covers no region that has to be clear at the end.

It has one row g for each action and each such region: by how much the footprint covers the region
(`dvr_jax.geometry.intrusion`) [m]. A scene without such regions has no rows. For an action that places nothing, and for
a region that the action may cover, the row is the constant -1.
"""

from __future__ import annotations

import jax.numpy as jnp

from dvr_jax.geometry.intrusion import intrusion
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

KEPT_CLEAR_TOLERANCE = 1e-3
"""Depth by which the footprint of a feasible point may cover a region that has to be clear [m]."""

SCALE = 1.0
"""Penalty of a row relative to the common one."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases, horizon.kept_clear)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows, and their Jacobian by the mode parameters of the same action (B, K, C, 4)."""
    problems = given.problems
    regions = jnp.asarray(problems.kept_clear)
    B, K, C = regions.shape[:3]
    if C == 0:
        none = jnp.zeros((B, K, 0), given.x.m.dtype)
        return Evaluation(none, jnp.zeros((B, K, 0, PARAMETERS), none.dtype), (none.sum((1, 2)),))

    prism = jnp.take_along_axis(problems.prism, problems.switched_object[..., None], axis=1)
    outline = jnp.moveaxis(prism, -1, 0)[jnp.asarray([0, 1, 3])][..., None]
    m = jnp.moveaxis(given.x.m, -1, 0)[..., None]
    covered, slopes = intrusion(m, outline, jnp.moveaxis(regions, -1, 0))
    is_kept = regions[..., 3] > 0
    rows = jnp.where(is_kept, covered, -1)
    jacobian = jnp.where(is_kept[..., None], jnp.moveaxis(slopes, 0, -1), 0)
    return Evaluation(rows, jacobian, (jnp.maximum(rows.max(axis=(1, 2)), 0),))


KEPT_CLEAR = ConstraintBlock(
    name="kept_clear",
    kind=ConstraintKind.INEQUALITY,
    measures=(Measure("kept_clear", "m", KEPT_CLEAR_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=add_action_rows,
)
"""The block that keeps placed objects off regions that have to be clear at the end."""
