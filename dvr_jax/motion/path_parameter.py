"""The fastest motion along a path under limits that are linear in s'' and s'^2, by the algorithm TOPP-RA.

A path is traversed with the speed s' and the acceleration s'' of its parameter s. At each point of a grid, with
``x = s'^2`` and ``u = s''``, each limit is one row

    -lower <= a u + b x <= upper,        a, b, lower, upper from `PathLimits`,

and ``x <= speed^2``. Between two points of the grid at the distance d, u is constant, so that x changes by ``2 d u``.

TOPP-RA (H. Pham and Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis",
IEEE Transactions on Robotics 34, 2018) makes two passes. The backward pass computes at each point the largest x from
which the end can still be reached at rest. The forward pass accelerates as much as the limits allow, but never beyond
these values.

Because rest (u = 0, x = 0) keeps all limits, every smaller x can reach the end as well. The linear programs of the
backward pass then have closed solutions: u is eliminated by combining each row that bounds it from above with each one
that bounds it from below (Fourier-Motzkin elimination), and what remains are upper bounds of x. All of them but those
that depend on the next point of the grid are computed at once for the whole grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class PathLimits:
    """Limits ``-lower <= a s'' + b s'^2 <= upper`` and ``s' <= speed`` at the points of a grid."""

    a: Float[np.ndarray, "points rows"]
    """Factors of s''."""

    b: Float[np.ndarray, "points rows"]
    """Factors of s'^2."""

    lower: Float[np.ndarray, "points rows"]
    """Bounds below zero without their signs; not negative."""

    upper: Float[np.ndarray, "points rows"]
    """Bounds above zero; not negative."""

    speed: Float[np.ndarray, " points"]
    """Largest s'; infinite where there is no such limit."""


def fastest_speeds(
    grid: Float[np.ndarray, " points"], limits: PathLimits
) -> Float[np.ndarray, " points"]:
    """Return s' of the fastest motion from rest to rest at the points of a grid.

    Args:
        grid: Values of s, which increase.
        limits: Limits at these points.
    """
    # A row may be multiplied by -1, which exchanges its bounds: no factor of s'' is negative then.
    is_negative = limits.a < 0
    a = np.abs(limits.a)
    b = np.where(is_negative, -limits.b, limits.b)
    lower = np.where(is_negative, limits.upper, limits.lower)
    upper = np.where(is_negative, limits.lower, limits.upper)
    bound = np.minimum(_largest_squares(a, b, lower, upper), limits.speed**2)

    # Per unit of x at the next point, a row changes by this much.
    rate = a[:-1] / (2 * np.diff(grid)[:, None])
    square = _controllable(rate, b[:-1], lower[:-1], upper[:-1], bound)
    return np.sqrt(_accelerated(rate, b[:-1], upper[:-1], square))


def _largest_squares(
    a: Float[np.ndarray, "points rows"],
    b: Float[np.ndarray, "points rows"],
    lower: Float[np.ndarray, "points rows"],
    upper: Float[np.ndarray, "points rows"],
) -> Float[np.ndarray, " points"]:
    """Return the largest x at each point for which some u keeps all rows; infinite where x has no bound.

    Args:
        a: Factors of u, none of which is negative.
        b: Factors of x.
        lower: Lower bounds of the rows without their signs.
        upper: Upper bounds of the rows.
    """
    # Row j bounds u from above and row k from below: (b_j a_k - b_k a_j) x <= upper_j a_k + lower_k a_j.
    room = upper[:, :, None] * a[:, None, :] + lower[:, None, :] * a[:, :, None]
    slope = b[:, :, None] * a[:, None, :]
    slope -= slope.transpose(0, 2, 1)
    return _least_ratio(room, slope, axis=(1, 2))


def _controllable(
    rate: Float[np.ndarray, "intervals rows"],
    b: Float[np.ndarray, "intervals rows"],
    lower: Float[np.ndarray, "intervals rows"],
    upper: Float[np.ndarray, "intervals rows"],
    bound: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " points"]:
    """Return the largest x at each point from which the end is reached at rest.

    Args:
        rate: Factors of u over twice the length of the interval that begins at each point.
        b: Factors of x.
        lower: Lower bounds of the rows without their signs.
        upper: Upper bounds of the rows.
        bound: Upper bounds of x at the points themselves.
    """
    # The next x is not negative, so u is at least -x / (2 d), and each upper bound of a row bounds x.
    bound = bound.copy()
    bound[:-1] = np.minimum(bound[:-1], _least_ratio(upper, b - rate, axis=1))

    # The next x is at most its own largest value, so that (rate - b) x <= lower + rate * value for each row.
    slope = rate - b
    bounds_x = slope > 0
    divisor = np.where(bounds_x, slope, 1.0)
    constant = np.where(bounds_x, lower / divisor, np.inf)
    factor = np.where(bounds_x, rate / divisor, 0.0)

    square = np.zeros(len(bound))
    for i in range(len(bound) - 2, -1, -1):
        square[i] = min(bound[i], (constant[i] + factor[i] * square[i + 1]).min())
    square[0] = 0.0
    return square


def _accelerated(
    rate: Float[np.ndarray, "intervals rows"],
    b: Float[np.ndarray, "intervals rows"],
    upper: Float[np.ndarray, "intervals rows"],
    largest: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " points"]:
    """Return x at each point of the motion that starts at rest and accelerates as much as it can.

    Args:
        rate: Factors of u over twice the length of the interval that begins at each point.
        b: Factors of x.
        upper: Upper bounds of the rows.
        largest: Largest x at each point from which the end is reached.
    """
    # The next x is x + 2 d u with rate * (2 d u) <= upper - b x for each row.
    bounds_u = rate > 0
    divisor = np.where(bounds_u, rate, 1.0)
    constant = np.where(bounds_u, upper / divisor, np.inf)
    factor = np.where(bounds_u, 1 - b / divisor, 0.0)

    square = np.zeros(len(largest))
    for i in range(len(largest) - 1):
        reached = (constant[i] + factor[i] * square[i]).min()
        square[i + 1] = max(min(largest[i + 1], reached), 0.0)
    return square


def _least_ratio(
    room: Float[np.ndarray, "..."], slope: Float[np.ndarray, "..."], axis: int | tuple[int, int]
) -> Float[np.ndarray, "..."]:
    """Return the largest x with ``slope * x <= room`` along some axes, for rooms that are not negative."""
    divisor = np.where(slope > 0, slope, 1.0)
    return np.asarray(np.where(slope > 0, room / divisor, np.inf).min(axis=axis))
