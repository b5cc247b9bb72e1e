"""Time-optimal motion along a given path under limits of joint velocity, acceleration, jerk and torque.

A path q(s) is traversed from rest to rest. With the speed s' and the acceleration s'' along it,

    dq/dt = q_s s',        d2q/dt2 = q_s s'' + q_ss s'^2,        torque = M (d2q/dt2) + C (dq/dt) + g.

All but the jerk are linear in s'' and s'^2, and the library `toppra` finds the fastest s(t) under such limits
(`dvr_jax.motion.path_parameter`). Its acceleration jumps. The limits of the jerk are so high compared with those of the
acceleration (500 times as much in each second) that it is enough to round these jumps: s(t) is averaged over a window
of `SMOOTHING`, twice. This keeps the path. The motion is then sampled, and what lies between the samples is the cubic
spline through them (`dvr_jax.motion.interpolation`).

Where the path turns sharply, rounding raises the speed, and the motion exceeds a limit. The bounds of its speed and its
acceleration are then lowered around this time alone, and the fastest motion is computed again. What a few such
corrections leave above a limit slows the motion down as a whole.

Torques reach their limits in few motions. They are bounded as soon as a motion without these bounds exceeds them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline

from dvr_jax.motion.limit_use import LimitUse, MotionLimits, Torques, limit_use

if TYPE_CHECKING:
    from dvr_jax.motion.path_parameter import PathLimits

__all__ = ["TIME_STEP", "MotionLimits", "Torques", "time_optimal"]

TIME_STEP = 0.02
"""Time between two samples of a motion [s]."""

FINE_STEPS = 20
"""Number of steps of 1 ms into which this time is divided for what is computed finely."""

SMOOTHING = 0.025
"""Length of the window over which the parameter of the path is averaged, twice [s]."""

LIMIT_FRACTION = 0.98
"""Fraction of the limits of velocity, acceleration and torque for which the fastest motion is computed. The rest is
left to the rounding of its jumps."""

GRID_POINTS = 120
"""Number of intervals into which TOPP-RA divides a path."""

SHORTEST_PATH = 1e-4
"""A path that is shorter than this is none [s]; the unit is that of joint angles over joint velocities."""

SMALLEST_STEP = 1e-4
"""Points of a path that are nearer to each other than this fraction of its length are left out."""

TORQUE_STEP = 5
"""Torques are computed at every so many-th point of the grid; it divides `GRID_POINTS`."""

LARGEST_LIMIT = 1e6
"""Number that stands for no limit of acceleration or torque [rad/s^2 or N m]."""

LEAST_TORQUE_ROOM = 0.05
"""Least torque that is left to a motion where the weight alone uses up the limit, as a fraction of it."""

CORRECTIONS = 8
"""Largest number of times that bounds are lowered around the times at which a motion exceeds a limit."""

CORRECTION_REACH = 0.03
"""Bounds are lowered up to this time before and after such a time [s]."""

CORRECTION_ROOM = 0.03
"""By how much more than the excess a bound is lowered, so that few corrections are needed."""

SLOWDOWNS = 20
"""Largest number of times that a motion is slowed down as a whole."""

SLOWDOWN_ROOM = 1e-3
"""By how much more than the excess a motion is slowed down as a whole."""


@dataclass(frozen=True, slots=True)
class _Bounds:
    """Bounds of the motion along a path, at the points of a grid."""

    path: CubicSpline
    """Joint angles as a function of the parameter."""

    grid: Float[np.ndarray, " grid"]
    """Values of the parameter."""

    speed: Float[np.ndarray, " grid"]
    """Largest speed of the parameter."""

    fraction: Float[np.ndarray, " grid"]
    """Fraction of the limits of acceleration, and of what gravity leaves of the limits of torque, that may be used."""

    bounds_torque: bool
    """Whether torques are bounded."""


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
    # Imported here, because toppra takes a second that other uses of a motion need not wait for.
    from dvr_jax.motion.path_parameter import fastest_speeds, interpolated

    steps = np.linalg.norm(np.diff(points, axis=0) / limits.velocity, axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    if length[-1] < SHORTEST_PATH:
        return points[-1:]

    # The parameter is the length of the path, with joints weighted by their speeds. Where the arms stay, there is none.
    kept = _distinct(length)
    path = CubicSpline(length[kept], points[kept])
    bounds = _first_bounds(path, limits, length, shortest_times)
    along_path = _path_limits(bounds, limits, torques)
    geometry = interpolated(bounds.grid, path(bounds.grid))

    # Lower the bounds around the times at which the motion exceeds a limit, and compute it again.
    for _ in range(CORRECTIONS):
        speeds = fastest_speeds(
            geometry, bounds.grid, along_path.scaled(bounds.fraction), bounds.speed
        )
        time = _grid_times(bounds.grid, speeds)
        parameter = _smoothed(_parameter_over_time(bounds.grid, speeds, time))
        along = _resampled(parameter, 1.0)
        samples = path(along)
        use = limit_use(samples, TIME_STEP, limits, torques)
        if use.slowdown() <= 1:
            return np.asarray(samples)
        torque_binds = not bounds.bounds_torque and bool(use.torque.max() > 1)
        bounds = _lowered(bounds, use, time, np.interp(along, bounds.grid, time))
        if torque_binds:
            along_path = _path_limits(bounds, limits, torques)

    # What is left slows the motion down as a whole.
    factor = 1.0
    for _ in range(SLOWDOWNS):
        factor *= max(use.slowdown() * (1 + SLOWDOWN_ROOM), 1.002)
        samples = path(_resampled(parameter, factor))
        use = limit_use(samples, TIME_STEP, limits, torques)
        if use.slowdown() <= 1:
            break
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


def _first_bounds(
    path: CubicSpline,
    limits: MotionLimits,
    length: Float[np.ndarray, " points"],
    shortest_times: Float[np.ndarray, " points-1"] | None,
) -> _Bounds:
    """Return the bounds before any correction.

    Args:
        path: Joint angles as a function of the parameter.
        limits: Limits of the joints.
        length: Parameter at each point of the path.
        shortest_times: Shortest time from each point to the next one [s].
    """
    # The points of a path are near to each other where it turns sharply, and so are those of the grid.
    numbers = np.arange(len(path.x))
    grid = np.interp(np.linspace(0, numbers[-1], GRID_POINTS + 1), numbers, path.x)
    by_velocity = (limits.velocity / np.maximum(np.abs(path(grid, 1)), 1e-9)).min(axis=1)
    speed = np.minimum(LIMIT_FRACTION * by_velocity, _largest_speeds(grid, length, shortest_times))
    return _Bounds(path, grid, speed, fraction=np.ones(len(grid)), bounds_torque=False)


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


def _path_limits(bounds: _Bounds, limits: MotionLimits, torques: Torques) -> PathLimits:
    """Return the limits along a path in the form of TOPP-RA.

    Args:
        bounds: Bounds at the points of the grid.
        limits: Limits of the joints.
        torques: Inverse dynamics with what the arms hold.
    """
    from dvr_jax.motion.path_parameter import PathLimits

    a = bounds.path(bounds.grid, 1)
    b = bounds.path(bounds.grid, 2)
    acceleration = LIMIT_FRACTION * np.minimum(limits.acceleration, LARGEST_LIMIT)
    of_joints = np.tile(acceleration, (len(a), 1))
    if not bounds.bounds_torque:
        return PathLimits(a, b, of_joints, of_joints)

    # The weight uses up a part of the limits of torque.
    by_speed_change, by_speed, weight = _torque_factors(bounds.path, bounds.grid, torques)
    limit = np.minimum(limits.torque, LARGEST_LIMIT)
    least = LEAST_TORQUE_ROOM * limit
    above = LIMIT_FRACTION * np.maximum(limit - weight, least)
    below = LIMIT_FRACTION * np.maximum(limit + weight, least)
    return PathLimits(
        np.concatenate([a, by_speed_change], axis=1),
        np.concatenate([b, by_speed], axis=1),
        np.concatenate([of_joints, below], axis=1),
        np.concatenate([of_joints, above], axis=1),
    )


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
    between = CubicSpline(coarse, np.stack([a, b, c]), axis=1)(grid)
    return between[0], between[1], between[2]


def _grid_times(
    grid: Float[np.ndarray, " grid"], speed: Float[np.ndarray, " grid"]
) -> Float[np.ndarray, " grid"]:
    """Return when a motion passes the points of a grid, between which its acceleration is constant [s].

    Args:
        grid: Values of the parameter.
        speed: Its speed there.
    """
    mean = np.maximum((speed[1:] + speed[:-1]) / 2, 1e-6 * grid[-1])
    return np.concatenate([[0.0], np.cumsum(np.diff(grid) / mean)])


def _parameter_over_time(
    grid: Float[np.ndarray, " grid"],
    speed: Float[np.ndarray, " grid"],
    time: Float[np.ndarray, " grid"],
) -> Float[np.ndarray, " steps"]:
    """Return the parameter every millisecond.

    Args:
        grid: Values of the parameter.
        speed: Its speed there.
        time: When the motion is there [s].
    """
    fine = np.arange(0, time[-1], TIME_STEP / FINE_STEPS)
    interval = np.clip(np.searchsorted(time, fine, side="right") - 1, 0, len(grid) - 2)
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
    return np.interp(at, np.arange(len(parameter)), parameter)


def _lowered(
    bounds: _Bounds,
    use: LimitUse,
    grid_time: Float[np.ndarray, " grid"],
    sample_time: Float[np.ndarray, " samples"],
) -> _Bounds:
    """Lower the bounds around the times at which a motion exceeds its limits.

    Args:
        bounds: Bounds of this motion.
        use: How much of its limits it uses at its samples.
        grid_time: When it passes the points of the grid, before it was rounded [s].
        sample_time: When it passes its samples, before it was rounded [s].
    """

    def excess(used: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " grid"]:
        """Return by how much a limit is exceeded around each point of the grid; 1 where it is kept."""
        over = used > 1
        is_near = np.abs(grid_time[:, None] - sample_time[over]) <= CORRECTION_REACH
        return np.where(is_near, used[over] * (1 + CORRECTION_ROOM), 1.0).max(axis=1, initial=1.0)

    by_acceleration = excess(use.acceleration)
    by_torque = excess(use.torque)

    # The first time that a torque is too large, bounding it is enough.
    if not bounds.bounds_torque:
        by_torque = np.ones_like(by_torque)
    return replace(
        bounds,
        speed=bounds.speed / excess(use.velocity),
        fraction=bounds.fraction / np.maximum(by_acceleration, by_torque),
        bounds_torque=bounds.bounds_torque or bool(use.torque.max() > 1),
    )
