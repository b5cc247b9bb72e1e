"""Time-optimal motion along a given path under limits of joint velocity, acceleration, jerk and torque.

A path q(s) is traversed from rest to rest. With the speed s' and the acceleration s'' along it,

    dq/dt = q_s s',        d2q/dt2 = q_s s'' + q_ss s'^2,        torque = M (d2q/dt2) + C (dq/dt) + g.

All but the jerk are linear in s'' and s'^2. TOPP-RA (H. Pham and Q.-C. Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", IEEE Transactions on Robotics 34, 2018; the library `toppra`) finds
the fastest s(t). Its acceleration jumps. The limits of the jerk are so high compared with those of the acceleration
(500 times as much in each second) that it is enough to round these jumps: s(t) is averaged over a window of
`SMOOTHING`, twice. This keeps the path. The motion is then sampled, and what lies between the samples is the cubic
spline through them (`dvr_jax.motion.interpolation`). If this spline exceeds a limit, the motion is slowed down as a
whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline

TIME_STEP = 0.02
"""Time between two samples of a motion [s]."""

FINE_STEPS = 20
"""Number of steps of 1 ms into which this time is divided for what is computed finely."""

SMOOTHING = 0.03
"""Length of the window over which the parameter of the path is averaged, twice [s]."""

LIMIT_FRACTION = 0.98
"""Fraction of the limits of velocity, acceleration and torque for which the fastest motion is computed. The rest is
left to the rounding of its jumps."""

GRID_POINTS = 200
"""Number of intervals into which TOPP-RA divides a path."""

SHORTEST_PATH = 1e-4
"""A path that is shorter than this is none [s]; the unit is that of joint angles over joint velocities."""

SMALLEST_STEP = 1e-4
"""Points of a path that are nearer to each other than this fraction of its length are left out."""

TORQUE_STEP = 5
"""Torques are computed at every so many-th point of the grid; it divides `GRID_POINTS`."""

SLOWDOWNS = 20
"""Largest number of times that a motion is slowed down."""

LARGEST_TORQUE = 1e6
"""Torque that stands for no limit [N m]."""

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
        a single sample where nothing moves. They exceed a limit of torque only where an arm is too weak to hold its
        load still, which no timing can mend.
    """
    steps = np.linalg.norm(np.diff(points, axis=0) / limits.velocity, axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    if length[-1] < SHORTEST_PATH:
        return points[-1:]

    # The parameter is the length of the path, with joints weighted by their speeds. Where the arms stay, there is none.
    kept = _distinct(length)
    path = CubicSpline(length[kept], points[kept])

    def largest_speeds(grid: Float[np.ndarray, " grid"]) -> Float[np.ndarray, " grid"]:
        return _largest_speeds(grid, length, shortest_times)

    parameter = _smoothed(_fastest_parameter(path, limits, torques, largest_speeds))
    factor = 1.0
    for _ in range(SLOWDOWNS):
        samples = path(_resampled(parameter, factor))
        excess = _excess(samples, limits, torques)
        if excess <= 1:
            return np.asarray(samples)
        factor *= max(excess * (1 + ROOM), 1.002)
    return np.asarray(samples)


def _distinct(length: Float[np.ndarray, " points"]) -> Int[np.ndarray, " kept"]:
    """Return the indices of points that are far enough apart for a spline, always with both ends.

    Args:
        length: Length of the path up to each point.
    """
    least = SMALLEST_STEP * length[-1]
    kept = [0]
    for index in range(1, len(length)):
        if length[index] - length[kept[-1]] >= least:
            kept.append(index)
    if len(kept) > 1:
        kept.pop()
    return np.array([*kept, len(length) - 1])


def _largest_speeds(
    grid: Float[np.ndarray, " grid"],
    length: Float[np.ndarray, " points"],
    shortest_times: Float[np.ndarray, " points-1"] | None,
) -> Float[np.ndarray, " grid"]:
    """Return the largest speed along a path at some values of its parameter; infinite where there is none.

    Args:
        grid: Values of the parameter.
        length: Parameter at each point of the path.
        shortest_times: Shortest time from each point to the next one [s].
    """
    if shortest_times is None:
        return np.full(len(grid), np.inf)
    fastest = np.full(len(shortest_times), np.inf)
    is_slow = shortest_times > 0
    fastest[is_slow] = np.diff(length)[is_slow] / shortest_times[is_slow]
    interval = np.clip(np.searchsorted(length, grid, side="right") - 1, 0, len(fastest) - 1)
    return fastest[interval]


def _fastest_parameter(
    path: CubicSpline,
    limits: MotionLimits,
    torques: Torques,
    largest_speeds: Callable[[Float[np.ndarray, " grid"]], Float[np.ndarray, " grid"]],
) -> Float[np.ndarray, " steps"]:
    """Return the parameter of the fastest motion along a path every millisecond.

    Args:
        path: Joint angles as a function of the parameter.
        limits: Limits of the joints.
        torques: Inverse dynamics with what the arms hold.
        largest_speeds: Function of values of the parameter that returns the largest speeds there.
    """
    # Imported here, because toppra takes a second that other uses of a motion need not wait for.
    from dvr_jax.motion.path_parameter import PathLimits, fastest_speeds

    # The points of a path are near to each other where it turns sharply, and so are those of the grid.
    numbers = np.arange(len(path.x))
    grid = np.interp(np.linspace(0, numbers[-1], GRID_POINTS + 1), numbers, path.x)
    slope = path(grid, 1)
    bend = path(grid, 2)
    by_velocity = (limits.velocity / np.maximum(np.abs(slope), 1e-9)).min(axis=1)
    speed = np.minimum(LIMIT_FRACTION * by_velocity, largest_speeds(grid))

    # Accelerations, then torques, where they are limited.
    none = np.zeros_like(slope)
    accelerations = (slope, bend, none, LIMIT_FRACTION * limits.acceleration)
    parts = [accelerations]
    if np.isfinite(limits.torque).any():
        limit = np.minimum(limits.torque, LARGEST_TORQUE)
        parts.append((*_torque_factors(path, grid, torques), LIMIT_FRACTION * limit))

    def solve(rows: Sequence[tuple[np.ndarray, ...]]) -> Float[np.ndarray, " grid"] | None:
        a, b, c, limit = (np.concatenate(values, axis=-1) for values in zip(*rows, strict=True))
        return fastest_speeds(grid, path(grid), PathLimits(a, b, c, limit, speed))

    # Where an arm is too weak to hold still, no motion keeps the limits of torque.
    speeds = solve(parts)
    if speeds is None:
        speeds = solve(parts[:1])
    assert speeds is not None
    return _parameter_over_time(grid, speeds)


def _torque_factors(
    path: CubicSpline, grid: Float[np.ndarray, " grid"], torques: Torques
) -> tuple[
    Float[np.ndarray, "grid joints"],
    Float[np.ndarray, "grid joints"],
    Float[np.ndarray, "grid joints"],
]:
    """Return the factors of s'' and s'^2 in the torques, and the torques at rest, interpolated from some points.

    Args:
        path: Joint angles as a function of the parameter.
        grid: Values of the parameter.
        torques: Inverse dynamics with what the arms hold.
    """
    coarse = grid[::TORQUE_STEP]
    q = path(coarse)
    slope = path(coarse, 1)
    rest = np.zeros_like(q)
    c = torques(q, rest, rest)
    a = torques(q, rest, slope) - c
    b = torques(q, slope, path(coarse, 2)) - c
    between = [CubicSpline(coarse, values)(grid) for values in (a, b, c)]
    return between[0], between[1], between[2]


def _parameter_over_time(
    grid: Float[np.ndarray, " grid"], speed: Float[np.ndarray, " grid"]
) -> Float[np.ndarray, " steps"]:
    """Return the parameter every millisecond.

    Args:
        grid: Values of the parameter.
        speed: Its speed there.
    """
    # The acceleration is constant between two grid points.
    mean = np.maximum((speed[1:] + speed[:-1]) / 2, 1e-6 * grid[-1])
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
