"""How much of the limits of the joints a sampled motion uses, at each of its samples.

The motion is the cubic spline through the samples (`dvr_jax.motion.interpolation`), at rest before the first and after
the last one. Between two samples its acceleration is linear and its jerk is constant, so that both are largest at the
samples. Its velocity is looked at in the middle between two samples as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

REST_SAMPLES = 2
"""Number of samples at rest that are put before and after a motion."""

Torques = Callable[
    [
        Float[np.ndarray, "samples joints"],
        Float[np.ndarray, "samples joints"],
        Float[np.ndarray, "samples joints"],
    ],
    Float[np.ndarray, "samples joints"],
]
"""Function of joint angles, velocities and accelerations that returns the torques of all joints [N m]."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of all D joints; infinite where there is none."""

    velocity: Float[np.ndarray, " joints"]
    """[rad/s]"""

    acceleration: Float[np.ndarray, " joints"]
    """[rad/s^2]"""

    jerk: Float[np.ndarray, " joints"]
    """[rad/s^3]"""

    torque: Float[np.ndarray, " joints"]
    """[N m]"""


@dataclass(frozen=True, slots=True)
class LimitUse:
    """How much of its limits a motion uses at each sample: the largest ratio to a limit of any joint."""

    velocity: Float[np.ndarray, " samples"]
    acceleration: Float[np.ndarray, " samples"]
    jerk: Float[np.ndarray, " samples"]
    torque: Float[np.ndarray, " samples"]

    def slowdown(self) -> float:
        """Return the factor by which the whole motion has to be slowed down to keep all limits; at most 1 if it does.

        Velocities are inversely proportional to the duration, accelerations and torques to its square (apart from
        gravity), jerks to its cube.
        """
        return float(
            max(
                self.velocity.max(),
                self.acceleration.max() ** 0.5,
                self.jerk.max() ** (1 / 3),
                self.torque.max() ** 0.5,
            )
        )


def limit_use(
    samples: Float[np.ndarray, "samples joints"],
    step: float,
    limits: MotionLimits,
    torques: Torques,
) -> LimitUse:
    """Measure how much of its limits a motion from rest to rest uses.

    Args:
        samples: Joint angles [rad].
        step: Time between two samples [s].
        limits: Limits of the joints.
        torques: Inverse dynamics with what the arms hold.

    Returns:
        The ratios. Those of torques are zero if another limit is exceeded, and where a torque is too large at rest.
    """
    padded = np.pad(samples, ((REST_SAMPLES, REST_SAMPLES), (0, 0)), mode="edge")
    time = step * np.arange(len(padded))
    c = CubicSpline(time, padded, bc_type="clamped").c

    # Velocities and accelerations at the samples, and what lies between each of them and the next one.
    inner = slice(REST_SAMPLES, REST_SAMPLES + len(samples))
    velocity = c[2, inner]
    acceleration = 2 * c[1, inner]
    between = c[2] + c[1] * step + c[0] * (0.75 * step**2)

    def largest(
        values: Float[np.ndarray, "times joints"], limit: Float[np.ndarray, " joints"]
    ) -> np.ndarray:
        """Return the largest ratio to the limit of any joint."""
        return np.asarray((np.abs(values) / limit).max(axis=1))

    by_middle = largest(between, limits.velocity)
    by_jerk = largest(6 * c[0], limits.jerk)
    before = slice(inner.start - 1, inner.stop - 1)
    use = LimitUse(
        velocity=np.maximum.reduce(
            [largest(velocity, limits.velocity), by_middle[inner], by_middle[before]]
        ),
        acceleration=largest(acceleration, limits.acceleration),
        jerk=np.maximum(by_jerk[inner], by_jerk[before]),
        torque=np.zeros(len(samples)),
    )

    # Torques take longest to compute, and where another limit is exceeded, the motion will change anyway.
    if use.slowdown() > 1:
        return use
    torque = _torque_use(samples, velocity, acceleration, limits.torque, torques)
    return replace(use, torque=torque)


def _torque_use(
    q: Float[np.ndarray, "samples joints"],
    velocity: Float[np.ndarray, "samples joints"],
    acceleration: Float[np.ndarray, "samples joints"],
    limit: Float[np.ndarray, " joints"],
    torques: Torques,
) -> Float[np.ndarray, " samples"]:
    """Return the largest ratio of a torque to its limit at each sample.

    Args:
        q: Joint angles [rad].
        velocity: Joint velocities [rad/s].
        acceleration: Joint accelerations [rad/s^2].
        limit: Limits of the torques [N m].
        torques: Inverse dynamics with what the arms hold.
    """
    if not np.isfinite(limit).any():
        return np.zeros(len(q))
    use = np.abs(torques(q, velocity, acceleration)) / limit

    # No timing helps where an arm is too weak to hold its load still.
    over = np.flatnonzero((use > 1).any(axis=1))
    if len(over):
        rest = np.zeros((len(over), q.shape[1]))
        is_too_weak = np.abs(torques(q[over], rest, rest)) > limit
        use[over] = np.where(is_too_weak, 0.0, use[over])
    return np.asarray(use.max(axis=1))
