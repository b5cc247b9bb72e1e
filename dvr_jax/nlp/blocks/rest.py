"""The rest block requires that some arms do not move in some intervals of a path.

A phase has three such intervals. An arm that takes part in the switch at its end rests in its last interval, in which
the fingers move. In a handover, the arm that holds the object rests while the other hand comes to it straight, in the
last interval but one, and while the other hand leaves it, in the first interval of the next phase. The rows are

    h = rest_ki (q_t - q_{t-1}) [rad]

for each phase k, each of its intervals i, and each joint, where t is the slice after the interval. ``rest_ki`` is 1 for
the joints of an arm that has to rest, else 0. A keyframe NLP has no such rows.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
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

REST_TOLERANCE = 3e-3
"""Largest change of a resting joint from one slice to the next that a feasible point may have [rad/slice].

At a distance of 0.8 m from the joint it moves a point by 2.4 mm.
"""

SCALE = 0.1
"""Penalty of a row relative to the common one."""


INTERVALS = 3
"""Number of intervals of a phase in which an arm may have to rest."""


def _shape(horizon: Horizon) -> tuple[int, ...]:
    return (horizon.phases if horizon.is_path else 0, INTERVALS, horizon.joints)


def _scale(horizon: Horizon) -> float:
    return SCALE


def _slices_after(phases: int, steps: int) -> Int[np.ndarray, "phases intervals"]:
    """Return the slice at the end of each interval in which an arm may have to rest.

    Args:
        phases: Number K of phases.
        steps: Number S of slices in each phase.
    """
    return np.arange(phases)[:, None] * steps + np.array([0, steps - 2, steps - 1])


def _joints_at_rest(
    problem: Problem, joints: int
) -> Float[Array, "*batch phases intervals joints"]:
    """Return 1 for each joint of an arm at rest in an interval, and 0 for each other joint.

    Args:
        problem: One or more NLPs.
        joints: Number D of joints of all arms.
    """
    at_switch = jnp.asarray(problem.arm_at_rest)
    at_rest = jnp.concatenate([jnp.asarray(problem.still_arm), at_switch[..., None, :]], axis=-2)
    return jnp.repeat(at_rest, joints // at_rest.shape[-1], axis=-1)


def _evaluate(given: EvaluationInput) -> Evaluation:
    """Evaluate the rows; their derivatives are constant."""
    q = given.x.q
    B, K = given.x.m.shape[:2]
    T, D = q.shape[1:]
    if T == K:
        return Evaluation(jnp.zeros((B, 0, INTERVALS, D), q.dtype), None, (jnp.zeros(B, q.dtype),))
    after = _slices_after(K, T // K)

    # No arm has to rest in the first interval of the first phase.
    steps = q[:, after] - q[:, np.maximum(after - 1, 0)]
    rows = steps * _joints_at_rest(given.problems, D)
    return Evaluation(rows, None, (jnp.abs(rows).max(axis=(1, 2, 3)),))


def _add_to_system(
    parts: SystemParts,
    problem: Problem,
    x: Variables,
    jacobian: None,
    multiplier_estimate: Array,
    active_penalty: Array,
) -> SystemParts:
    """Add the rows to the diagonals of the blocks A_t, A_{t-1} and B1_t."""
    T, D = x.q.shape
    K = len(x.m)
    if T == K:
        return parts

    # A row couples the slice after the interval with the one before it, joint by joint.
    after = _slices_after(K, T // K)
    at_rest = _joints_at_rest(problem, D)
    zeros = jnp.zeros((T, D), x.q.dtype)
    penalty = zeros.at[after].add(active_penalty * at_rest)
    estimate = zeros.at[after].add(multiplier_estimate * at_rest)
    one = jnp.zeros((1, D), x.q.dtype)
    return parts._replace(
        joint_diagonal=parts.joint_diagonal + penalty + jnp.concatenate([penalty[1:], one]),
        coupling_diagonal=parts.coupling_diagonal - penalty,
        gradient_q=parts.gradient_q + estimate - jnp.concatenate([estimate[1:], one]),
    )


REST = ConstraintBlock(
    name="rest",
    kind=ConstraintKind.EQUALITY,
    measures=(Measure("rest", "rad/slice", REST_TOLERANCE),),
    shape=_shape,
    scale=_scale,
    evaluate=_evaluate,
    add_to_system=_add_to_system,
)
"""The block that keeps the arms that take part in a switch at rest before it, and those that hold still for a hand."""
