"""What "feasible" means of an NLP: the largest violation of each kind, in metres and radians, against its tolerance.

Solver, data set, search and bench all use `measure_violations`. The largest single violation counts, never a sum of
scaled terms: such a sum grows with the horizon. A lane is feasible when `ratio` is at most 1 and its last step was
small (`dvr_jax.solver.augmented_lagrangian.judge`); a path, when its motion between the samples is too (`dvr_jax.solver.continuous_collision`, with
a tolerance of its own); and a motion is a solution when the independent check accepts it (`dvr_jax.checker.replay`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.nlp.constraints import ConstraintValues
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.workcell.kinematics import load_arm

POSITION_TOLERANCE = 1e-3
"""Largest distance between the switched object's positions under the old and the new mode; also of mode parameters
from their bounds and of footprints from their support [m, of pitch and yaw rad]."""
ROTATION_TOLERANCE = 1e-2
"""Largest angle between the switched object's orientations [rad]."""
PENETRATION_TOLERANCE = 1e-3
"""Deepest penetration [m]."""
LIMIT_TOLERANCE = 1e-3
"""Largest excess over a joint limit [rad]."""
REST_TOLERANCE = 3e-3
"""Largest step of a joint into a switch, of an arm that takes part in it [rad a slice]; it is the interval in which
fingers close, and 0.8 m from the joint 2.4 mm."""


class Violations(NamedTuple):
    """Largest violation of each kind, zero or positive; batch axes as the problem's."""

    position: Array
    """Switch residual [m]."""
    rotation: Array
    """Switch residual [rad]."""
    penetration: Array
    """Deepest penetration [m]."""
    joint_limit: Array
    """Excess over joint limits [rad]."""
    parameter: Array
    """Excess of mode parameters over their bounds and of footprints over their support [m, of pitch and yaw rad]."""
    rest: Array
    """Step of an arm into its switch [rad]; zero for keyframes."""

    def ratio(self) -> Array:
        """The largest violation as a multiple of its tolerance: feasible where <= 1."""
        # On the host single lanes are judged, where NumPy is a hundred times faster.
        xp: Any = jnp if isinstance(self.position, Array) else np
        ratio = xp.stack([value / tolerance for value, tolerance in zip(self, _TOLERANCES, strict=True)]).max(axis=0)
        return xp.where(xp.isnan(ratio), xp.inf, ratio)


_TOLERANCES = Violations(
    POSITION_TOLERANCE, ROTATION_TOLERANCE, PENETRATION_TOLERANCE, LIMIT_TOLERANCE, POSITION_TOLERANCE, REST_TOLERANCE
)


def measure_violations(problem: Problem, x: Variables, rows: ConstraintValues) -> Violations:
    """Largest violation of each kind of one NLP (no batch axes)."""
    T, K = x.q.shape[0], x.m.shape[0]
    lower, upper = jnp.asarray(joint_limits(), x.q.dtype)
    limit = jnp.maximum(lower - x.q, x.q - upper)
    bounds = jnp.maximum(problem.lower - x.m, x.m - problem.upper)
    return Violations(
        position=jnp.sqrt(jnp.sum(rows.switch[:, :3] ** 2, axis=1)).max(),
        rotation=rows.switch_angle.max(),
        penetration=jnp.maximum(-rows.distance.min(), 0),
        joint_limit=jnp.maximum(limit.max(), 0),
        parameter=jnp.maximum(jnp.maximum(bounds.max(), rows.footprint.max()), 0),
        rest=jnp.abs(rest_steps(problem, x)).max() if T > K else jnp.zeros((), x.q.dtype),
    )


def joint_limits() -> np.ndarray:
    """(2, 14) lower and upper limits of both arms [rad]."""
    return np.tile(load_arm().joint_limits, (1, 2))


def rest_steps(problem: Problem, x: Variables) -> Array:
    """First differences of the switching arms' joints at the K switches, ``(K, 14)`` [rad]."""
    S = x.q.shape[0] // x.m.shape[0]
    step = x.q[S - 1 :: S] - x.q[S - 2 :: S]
    return step * jnp.repeat(problem.resting, 7, axis=1)
