"""Time-optimal motion along a given path under limits of joint velocity, acceleration, jerk and torque.

A path q(s) is traversed from rest to rest. With the speed s' and the acceleration s'' along it,

    dq/dt = q_s s',        d2q/dt2 = q_s s'' + q_ss s'^2,        torque = M (d2q/dt2) + C (dq/dt) + g.

All but the jerk are linear in s'' and s'^2. TOPP-RA (H. Pham and Q.-C. Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", IEEE Transactions on Robotics 34, 2018; the library `toppra`) finds
the fastest s(t). Its acceleration jumps. The limits of the jerk are so high compared with those of the acceleration
(500 times as much in each second) that it is enough to round these jumps: s(t) is averaged over a window of
`SMOOTHING`, twice. This keeps the path. The motion is then sampled, and what lies between the samples is the cubic
spline through them (`dvr_jax.motion.motion`). If this spline exceeds a limit, the motion is slowed down as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

TIME_STEP = 0.02
"""Time between two samples of a motion [s]."""

FINE_STEPS = 20
"""Number of steps of 1 ms into which this time is divided for what is computed finely."""

SMOOTHING = 0.02
"""Length of the window over which the parameter of the path is averaged, twice [s]."""

LIMIT_FRACTION = 0.98
"""Fraction of the limits of velocity, acceleration and torque for which the fastest motion is computed. The rest is
left to the rounding of its jumps."""

GRID_POINTS = 80
"""Number of intervals into which TOPP-RA divides a path."""

SHORTEST_PATH = 1e-4
"""A path along which no joint moves for longer than this at full speed is none [s]."""

SLOWEST_JOINT = 1e-3
"""Velocity that each joint may have where the speed along a path is limited [rad/s]."""

ROOM = 1e-3
"""How much a motion stays below its limits, as a fraction of them."""

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


def time_optimal(
    points: Float[np.ndarray, "points joints"],
    limits: MotionLimits,
    torques: Torques,
    shortest_times: Float[np.ndarray, " points-1"] | None = None,
) -> Float[np.ndarray, "samples joints"]:
    """Return the samples of a fast motion through the points of a path, at rest at both ends.

    Args:
        points: Joint angles of dense points of a smooth path [rad].
        limits: Limits of the joints.
        torques: Inverse dynamics with what the arms hold.
        shortest_times: Shortest time from each point to the next one [s]; 0, or None, where only the limits count.

    Returns:
        Joint angles at times that are `TIME_STEP` apart [rad], the first and the last of them at the ends of the path;
        a single sample where nothing moves.
    """
    length = np.concatenate(
        [[0.0], np.cumsum((np.abs(np.diff(points, axis=0)) / limits.velocity).max(axis=1))]
    )
    if length[-1] < SHORTEST_PATH:
        return points[-1:]

    # Points that are equally far apart, so that the spline through them is even.
    kept = np.concatenate([[True], np.diff(length) > 1e-9 * length[-1]])
    kept[-1] = True
    even = np.linspace(0, length[-1], len(points))
    column = np.interp(even, length[kept], np.flatnonzero(kept))
    smooth = CubicSpline(np.arange(len(points)), points)(column)
    path = CubicSpline(even, smooth)
    fastest = _speed_limit(length, shortest_times)

    parameter = _smoothed(_fastest_parameter(path, limits, torques, fastest))
    factor = 1.0
    for _ in range(20):
        samples = path(_resampled(parameter, factor))
        excess = _excess(samples, limits, torques)
        if excess <= 1:
            return np.asarray(samples)
        factor *= max(excess * (1 + ROOM), 1.002)
    return np.asarray(samples)


def _speed_limit(
    length: Float[np.ndarray, " points"], shortest_times: Float[np.ndarray, " points-1"] | None
) -> Callable[[float], float]:
    """Return the largest speed along a path as a function of its parameter.

    Args:
        length: Parameter at each point.
        shortest_times: Shortest time from each point to the next one [s].
    """
    if shortest_times is None or not shortest_times.any():
        return lambda parameter: math.inf
    fastest = np.full(len(shortest_times), np.inf)
    is_slow = shortest_times > 0
    fastest[is_slow] = np.diff(length)[is_slow] / shortest_times[is_slow]

    def limit(parameter: float) -> float:
        interval = int(np.searchsorted(length, parameter, side="right")) - 1
        return float(fastest[min(max(interval, 0), len(fastest) - 1)])

    return limit


def _fastest_parameter(
    path: CubicSpline,
    limits: MotionLimits,
    torques: Torques,
    fastest: Callable[[float], float],
) -> Float[np.ndarray, " steps"]:
    """Return the parameter of the fastest motion along a path every millisecond, by TOPP-RA."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        JointAccelerationConstraint,
        JointTorqueConstraint,
        JointVelocityConstraintVarying,
    )

    def both(limit: Float[np.ndarray, " joints"]) -> Float[np.ndarray, "joints 2"]:
        return LIMIT_FRACTION * np.stack([-limit, limit], axis=1)

    def velocity_limits(parameter: float) -> Float[np.ndarray, "joints 2"]:
        """Limits of the joint velocities, lower where the speed along the path is limited."""
        largest = fastest(parameter)
        if math.isinf(largest):
            return both(limits.velocity)
        along = np.abs(path(parameter, 1)) * largest
        return both(np.clip(along, SLOWEST_JOINT, limits.velocity))

    constraints = [
        JointVelocityConstraintVarying(velocity_limits),
        JointAccelerationConstraint(both(limits.acceleration)),
    ]
    if np.isfinite(limits.torque).any():
        torque = np.minimum(limits.torque, 1e6)
        constraints.append(
            JointTorqueConstraint(
                lambda q, v, a: torques(q[None], v[None], a[None])[0],
                both(torque),
                np.zeros(len(torque)),
            )
        )
    grid = np.linspace(path.x[0], path.x[-1], GRID_POINTS + 1)
    spline = toppra.SplineInterpolator(path.x, path(path.x))
    solver = TOPPRA(constraints, spline, gridpoints=grid, solver_wrapper="seidel")
    speed = solver.compute_parameterization(0, 0)[1]
    speed = np.maximum(np.nan_to_num(np.asarray(speed)), 0)

    # The acceleration is constant between two grid points.
    mean = np.maximum((speed[1:] + speed[:-1]) / 2, 1e-6 * path.x[-1])
    time = np.concatenate([[0.0], np.cumsum(np.diff(grid) / mean)])
    fine = np.arange(0, time[-1], TIME_STEP / FINE_STEPS)
    interval = np.clip(np.searchsorted(time, fine, side="right") - 1, 0, GRID_POINTS - 1)
    since = fine - time[interval]
    duration = time[interval + 1] - time[interval]
    change = (speed[interval + 1] - speed[interval]) / duration
    return np.append(grid[interval] + speed[interval] * since + change * since**2 / 2, grid[-1])


def _smoothed(parameter: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " longer"]:
    """Average a parameter over the window twice; before and after the motion it is constant."""
    window = round(SMOOTHING / TIME_STEP * FINE_STEPS)
    kernel = np.full(window, 1 / window)
    for _ in range(2):
        padded = np.pad(parameter, (window, window), mode="edge")
        parameter = np.convolve(padded, kernel, mode="valid")
    return parameter


def _resampled(
    parameter: Float[np.ndarray, " steps"], factor: float
) -> Float[np.ndarray, " samples"]:
    """Return the parameter every `TIME_STEP`, for a motion that is slower by a factor or a little more."""
    steps = factor * (len(parameter) - 1) / FINE_STEPS
    samples = int(np.ceil(steps - 1e-9)) + 1
    at = np.linspace(0, len(parameter) - 1, samples)
    return np.asarray(CubicSpline(np.arange(len(parameter)), parameter)(at))


def _excess(
    samples: Float[np.ndarray, "samples joints"], limits: MotionLimits, torques: Torques
) -> float:
    """Return by which factor a motion has to be slowed down to keep all limits; at most 1 if it keeps them.

    The motion is the spline through the samples, at rest at both ends. Velocities are inversely proportional to the
    duration, accelerations and torques to its square (apart from gravity), jerks to its cube.
    """
    if len(samples) < 2:
        return 1.0
    time = TIME_STEP * np.arange(len(samples))
    rest = np.repeat(samples[[0, -1]], 2, axis=0)
    padded = np.concatenate([rest[:2], samples, rest[2:]])
    spline = CubicSpline(np.arange(-2, len(samples) + 2) * TIME_STEP, padded, bc_type="clamped")
    fine = np.linspace(0, time[-1], FINE_STEPS // 2 * (len(samples) - 1) + 1)
    velocity = spline(fine, 1)
    acceleration = spline(fine, 2)
    jerk = spline(fine, 3)
    by_velocity = float((np.abs(velocity) / limits.velocity).max())
    by_acceleration = float((np.abs(acceleration) / limits.acceleration).max())
    by_jerk = float((np.abs(jerk) / limits.jerk).max())
    found = torques(spline(time), spline(time, 1), spline(time, 2))
    by_torque = float((np.abs(found) / limits.torque).max())
    return max(by_velocity, by_acceleration**0.5, by_jerk ** (1 / 3), by_torque**0.5)
