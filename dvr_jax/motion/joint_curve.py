"""The curve of joint angles through the slices of a path, which a motion follows between them.

At each slice the curve has the slope of the monotone piecewise cubic interpolant of Fritsch and Butland, "A method for
constructing local monotone piecewise cubic interpolants" (SIAM Journal on Scientific and Statistical Computing 5,
1984). That interpolant has two second derivatives at a slice, one on either side. The curve takes the smaller one of
them, and zero if their signs differ, and is the polynomial of degree five that has these values at both ends of an
interval.

In some intervals an arm moves *straight* in joint space: all of its joints follow one time law, so that its hand stays
near a straight line. One end of such an interval is at rest. At the other end the slope of the arm is a multiple of the
step of the interval, by the same rule, and the second derivative is zero. A joint that turns around there would pass
the slice's angle by a little. Where it would leave its range, the arm has a smaller slope.

The second derivative of the curve is therefore continuous, so that a motion along it needs no infinite jerk. An arm
that has the same posture at two slices rests between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import PchipInterpolator, PPoly

SLOPE_FACTORS = (1.0, 0.5, 0.25, 0.0)
"""Factors of the slope of an arm at the end of a straight interval; the first one that keeps the limits is used."""

LIMIT_ROOM = 2e-4
"""Excess over a joint's limit between two slices that is tolerated [rad]; the check tolerates 1e-3."""

_BETWEEN = np.vander(np.linspace(0.0, 1.0, 17), 6)
"""Powers, the highest first, of the places in an interval at which the limits are verified."""


def joint_curve(
    home: Float[np.ndarray, " joints"],
    q: Float[np.ndarray, "slices joints"],
    straight: Bool[np.ndarray, "slices arms"] | None = None,
    limits: Float[np.ndarray, "2 joints_of_arm"] | None = None,
) -> PPoly:
    """Interpolate the joint angles of a path over its slices.

    Args:
        home: Joint angles of all arms at slice 0, the beginning of the motion [rad].
        q: Joint angles at the slices 1 to T [rad]; `dvr_jax.nlp.problem` counts these slices from 0.
        straight: Whether each arm moves straight in the interval before each of these slices; nowhere by default.
        limits: Least and largest angle of each joint of one arm [rad]; none by default.

    Returns:
        A function from slice numbers in [0, T], which need not be whole, to joint angles [rad].
    """
    # One more slice at home before slice 0 makes the arms start from rest.
    slices = np.arange(-1, len(q) + 1)
    angles = np.concatenate([home[None], home[None], q])
    cubic = PchipInterpolator(slices, angles, axis=0).c

    # Values, slopes and second derivatives at the knots; all intervals have the length 1.
    slope = np.concatenate([cubic[2], (3 * cubic[0] + 2 * cubic[1] + cubic[2])[-1:]])
    right = 2 * cubic[1]
    left = 6 * cubic[0] + 2 * cubic[1]
    bend = np.zeros_like(angles)
    bend[1:-1] = np.where(
        left[:-1] * right[1:] > 0,
        np.sign(right[1:]) * np.minimum(np.abs(left[:-1]), np.abs(right[1:])),
        0,
    )
    if straight is not None:
        ends = _align(angles, slope, bend, straight)
        if limits is not None:
            _keep_within(angles, slope, bend, ends, limits)
    return PPoly(_quintic_coefficients(angles, slope, bend), slices)


def _align(
    angles: Float[np.ndarray, "knots joints"],
    slope: Float[np.ndarray, "knots joints"],
    bend: Float[np.ndarray, "knots joints"],
    straight: Bool[np.ndarray, "slices arms"],
) -> list[tuple[int, slice]]:
    """Change slopes and second derivatives at both ends of straight intervals, in place.

    Args:
        angles: Angles at the knots; knot i + 2 is slice i.
        slope: First derivatives.
        bend: Second derivatives.
        straight: Whether each arm moves straight in the interval before each slice.

    Returns:
        For each straight interval the knot at which the arm moves, and the columns of its joints.
    """
    joints = angles.shape[1] // straight.shape[1]
    ends = []
    for index, arm in np.argwhere(straight).tolist():
        knot = index + 2
        own = slice(arm * joints, (arm + 1) * joints)
        step = angles[knot, own] - angles[knot - 1, own]

        # The arm rests on that side of the interval where its slope is smaller.
        rests_after = np.abs(slope[knot, own]).max() <= np.abs(slope[knot - 1, own]).max()
        moving = knot - 1 if rests_after else knot
        other = angles[moving - 1, own] if rests_after else angles[moving + 1, own]
        beyond = angles[moving, own] - other if rests_after else other - angles[moving, own]

        # The harmonic mean of both steps along the direction of the straight one; zero where they oppose each other.
        length = float(step @ step)
        ratio = float(beyond @ step) / length if length > 0 else 0.0
        slope[moving, own] = 2 * ratio / (1 + ratio) * step if ratio > 0 else 0.0
        bend[[knot - 1, knot], own] = 0.0
        slope[knot if rests_after else knot - 1, own] = 0.0
        ends.append((moving, own))
    return ends


def _keep_within(
    angles: Float[np.ndarray, "knots joints"],
    slope: Float[np.ndarray, "knots joints"],
    bend: Float[np.ndarray, "knots joints"],
    ends: Sequence[tuple[int, slice]],
    limits: Float[np.ndarray, "2 joints_of_arm"],
) -> None:
    """Reduce the slopes of arms at ends of straight intervals until their joints stay within their range, in place.

    Args:
        angles: Angles at the knots.
        slope: First derivatives.
        bend: Second derivatives.
        ends: For each straight interval the knot at which the arm moves, and the columns of its joints.
        limits: Least and largest angle of each joint of one arm [rad].
    """
    for knot, own in ends:
        near = slice(max(knot - 1, 0), knot + 2)
        # A path may pass a limit by its tolerance at the slices themselves.
        low = np.minimum(limits[0], angles[near, own].min(axis=0)) - LIMIT_ROOM
        high = np.maximum(limits[1], angles[near, own].max(axis=0)) + LIMIT_ROOM
        full = slope[knot, own].copy()
        for factor in SLOPE_FACTORS:
            slope[knot, own] = factor * full
            shape = _quintic_coefficients(angles[near, own], slope[near, own], bend[near, own])
            between = np.einsum("tp,pkj->tkj", _BETWEEN, shape)
            if (between >= low).all() and (between <= high).all():
                break


def _quintic_coefficients(
    value: Float[np.ndarray, "knots joints"],
    slope: Float[np.ndarray, "knots joints"],
    bend: Float[np.ndarray, "knots joints"],
) -> Float[np.ndarray, "6 intervals joints"]:
    """Return the coefficients, highest power first, of the quintic polynomials between knots at distances of 1.

    Args:
        value: Values at the knots.
        slope: First derivatives.
        bend: Second derivatives.
    """
    rise = value[1:] - value[:-1] - slope[:-1] - bend[:-1] / 2
    turn = slope[1:] - slope[:-1] - bend[:-1]
    change = bend[1:] - bend[:-1]
    return np.stack(
        [
            6 * rise - 3 * turn + change / 2,
            -15 * rise + 7 * turn - change,
            10 * rise - 4 * turn + change / 2,
            bend[:-1] / 2,
            slope[:-1],
            value[:-1],
        ]
    )
