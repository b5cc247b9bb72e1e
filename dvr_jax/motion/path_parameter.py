"""The fastest motion along a path under limits that are linear in s'' and s'^2, by the algorithm TOPP-RA.

A path is traversed with the speed s' and the acceleration s'' of its parameter s. At each point of a grid, with
``x = s'^2`` and ``u = s''``, each limit is one row

    -lower <= a u + b x <= upper,        a, b, lower, upper from `PathLimits`,

and ``x <= largest^2`` for a largest speed. Between two points of the grid at the distance d, u is constant, so that x
changes by ``2 d u``.

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

LEAST_RATIO = 0.2
"""Least ratio of x at a point of the grid to x at the point before, but for the last point. Without it, a motion can be
so fast where u hardly changes a row that it has to stop within one interval."""


@dataclass(frozen=True, slots=True)
class PathLimits:
    """Limits ``-lower <= a s'' + b s'^2 <= upper`` at the points of a grid."""

    a: Float[np.ndarray, "points rows"]
    """Factors of s''."""

    b: Float[np.ndarray, "points rows"]
    """Factors of s'^2."""

    lower: Float[np.ndarray, "points rows"]
    """Bounds below zero without their signs; not negative."""

    upper: Float[np.ndarray, "points rows"]
    """Bounds above zero; not negative."""


class FastestSpeeds:
    """Computes the fastest motions along one path, whose bounds are fractions of the same limits.

    A fraction multiplies both bounds of all rows at a point of the grid, and so it multiplies all bounds of x there.
    They are therefore computed only once.
    """

    def __init__(self, grid: Float[np.ndarray, " points"], limits: PathLimits) -> None:
        """Compute what all motions have in common.

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

        # Upper bounds of x at each point: for some u to keep all rows there, and for the next x not to be too small.
        # The latter means u >= -drop x / (2 d), so that (b - drop rate) x <= upper. The last x is zero.
        self._bound = _largest_squares(a, b, lower, upper)
        rate = a[:-1] / (2 * np.diff(grid)[:, None])
        b = b[:-1]
        drop = np.full((len(b), 1), 1 - LEAST_RATIO)
        drop[-1] = 1.0
        self._bound[:-1] = np.minimum(
            self._bound[:-1], _least_ratio(upper[:-1], b - drop * rate, axis=1)
        )

        # The next x is at most its own bound, so that (rate - b) x <= lower + rate * bound for each row.
        slope = rate - b
        bounds_x = slope > 0
        divisor = np.where(bounds_x, slope, 1.0)
        self._back_constant = np.where(bounds_x, lower[:-1] / divisor, np.inf)
        self._back_factor = np.where(bounds_x, rate / divisor, 0.0)

        # Accelerating, the next x is x + 2 d u with rate * (2 d u) <= upper - b x for each row.
        bounds_u = rate > 0
        divisor = np.where(bounds_u, rate, 1.0)
        self._forth_constant = np.where(bounds_u, upper[:-1] / divisor, np.inf)
        self._forth_factor = np.where(bounds_u, 1 - b / divisor, 0.0)

    def speeds(
        self, fraction: Float[np.ndarray, " points"], largest: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, " points"]:
        """Return s' of the fastest motion from rest to rest at the points of the grid.

        Args:
            fraction: Fraction of the limits that may be used at each point.
            largest: Largest s' at each point; infinite where there is no such limit.
        """
        least = np.minimum.reduce
        bound = np.minimum(fraction * self._bound, largest**2).tolist()

        # Backward: the largest x from which the end is reached at rest.
        constant = fraction[:-1, None] * self._back_constant
        square = 0.0
        reachable = [square]
        backwards = zip(bound[-2:0:-1], constant[:0:-1], self._back_factor[:0:-1], strict=True)
        for at_point, row_constant, row_factor in backwards:
            least_next = square / LEAST_RATIO if square > 0 else np.inf
            square = min(at_point, least_next, float(least(row_constant + row_factor * square)))
            reachable.append(square)
        reachable.reverse()

        # Forward: as much acceleration as the limits allow.
        constant = fraction[:-1, None] * self._forth_constant
        square = 0.0
        squares = [square]
        forwards = zip(reachable, constant, self._forth_factor, strict=True)
        for next_largest, row_constant, row_factor in forwards:
            square = float(least(row_constant + row_factor * square))
            square = max(min(next_largest, square), 0.0)
            squares.append(square)
        return np.sqrt(np.array(squares))


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


def _least_ratio(
    room: Float[np.ndarray, "..."], slope: Float[np.ndarray, "..."], axis: int | tuple[int, int]
) -> Float[np.ndarray, "..."]:
    """Return the largest x with ``slope * x <= room`` along some axes, for rooms that are not negative."""
    divisor = np.where(slope > 0, slope, 1.0)
    return np.asarray(np.where(slope > 0, room / divisor, np.inf).min(axis=axis))
