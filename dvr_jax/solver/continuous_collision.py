"""Samples of a path are moved to where its motion penetrates between them, so that the whole motion avoids collisions.

A motion must be free of collisions at all times, which is a semi-infinite constraint, but an NLP evaluates distances at
finitely many times. This module implements an exchange method (Hettich and Kortanek, Semi-infinite programming, SIAM
Review 35, 1993): a path NLP is solved with `PATH_SAMPLES` samples in each interval between two slices. If the motion
that interpolates its solution penetrates at other times, samples are moved to these times (an *exchange*), and the
solver continues from its present point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import PPoly

from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.nlp.blocks.straight_motion import StraightKind, near_and_far
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk
from dvr_jax.workcell.model import WorkcellModel

PATH_SAMPLES = 3
"""Number of samples in the interval before each slice: one at the slice, and one in each half of the interval. With
samples at the slices alone, a finger may pass through an object's edge between two slices."""

SAMPLES_PER_SLICE = 10
"""Number R of equal parts into which an interval is divided when the motion is examined."""

BETWEEN_TOLERANCE = 2.5e-3
"""Largest shortfall of a clearance between samples [m]; most clearances are larger, so that bodies do not touch."""

EXCHANGES = 4
"""Largest number of exchanges for one path."""


class PenetrationSamples(NamedTuple):
    """Penetration depths of the motions of several lanes at some times in each interval."""

    fraction: Float[np.ndarray, "lanes slices times"]
    """Position of each time in its interval, from 0 (the previous slice) to 1 (this slice)."""

    depth: Float[np.ndarray, "lanes slices times"]
    """Deepest penetration of any pair of bodies [m]; negative if all bodies are apart."""


def place_samples(
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    fraction: Float[np.ndarray, "slices samples"],
) -> Problem:
    """Return a path NLP whose samples lie on the motion that interpolates given joint angles.

    Args:
        problem: The NLP, without batch axes.
        q: Joint angles at the slices [rad].
        fraction: Positions of the samples in each interval, from 0 to 1.
    """
    home = np.asarray(problem.home)
    straight = straight_intervals(problem, len(q))
    offset = _deviation(home, q, joint_curve(home, q, straight), fraction)

    # An arm that moves straight in an interval stays on the line between both slices, wherever these move.
    is_straight = np.repeat(straight, q.shape[1] // straight.shape[1], axis=1)
    offset = np.where(is_straight[:, None], 0, offset)
    return problem._replace(sample_fraction=fraction, sample_offset=offset)


def straight_intervals(problem: Problem, slices: int) -> Bool[np.ndarray, "slices arms"]:
    """Return whether each arm moves along its hand's approach axis in the interval before each slice of a path.

    Args:
        problem: The NLP, without batch axes.
        slices: Number T of slices.
    """
    distance = np.asarray(problem.straight_distance)
    is_approach = np.asarray(problem.straight_kind) == StraightKind.APPROACH
    arm = np.asarray(problem.straight_arm)
    near, far = near_and_far(len(distance), slices // len(distance))
    straight = np.zeros((slices, problem.still_arm.shape[-1]), bool)
    for phase, motion in np.argwhere(is_approach & (distance > 0)).tolist():
        later = max(near[phase, motion], far[phase, motion])
        straight[later, arm[phase, motion]] = True
    return straight


def _lane_of(problems: Problem, lane: int) -> Problem:
    """Return what `straight_intervals` needs of one problem of a batch."""
    names = ("straight_distance", "straight_arm", "straight_kind", "still_arm")
    return problems._replace(**{name: np.asarray(getattr(problems, name))[lane] for name in names})


def _deviation(
    home: Float[np.ndarray, " joints"],
    q: Float[np.ndarray, "slices joints"],
    curve: PPoly,
    fraction: Float[np.ndarray, "slices samples"],
) -> Float[np.ndarray, "slices samples joints"]:
    """Compute by how much the motion through q deviates from linear interpolation at some fractions of the intervals.

    Args:
        home: Home posture, at which the motion begins [rad].
        q: Joint angles at the slices [rad].
        curve: Interpolation of home and q, a function of the slice's number plus one.
        fraction: Positions in each interval, from 0 to 1.

    Returns:
        The deviations [rad].
    """
    times = np.arange(len(q))[:, None] + fraction
    before = np.concatenate([home[None], q[:-1]])[:, None]
    line = before + fraction[..., None] * (q[:, None] - before)
    return np.asarray(curve(times) - line)


def even_fractions(slices: int, samples: int = PATH_SAMPLES) -> Float[np.ndarray, "slices samples"]:
    """Return the positions of samples that divide each interval evenly.

    Args:
        slices: Number of intervals.
        samples: Number of samples in each interval.

    Raises:
        ValueError: The number of samples does not divide the number of times that `sample_penetration` examines.
    """
    if (SAMPLES_PER_SLICE - 1) % samples:
        raise ValueError(
            f"{samples} samples a slice; valid are divisors of {SAMPLES_PER_SLICE - 1}"
        )
    return np.tile(np.arange(1, samples + 1) / samples, (slices, 1))


def sample_penetration(model: WorkcellModel, problems: Problem, x: Variables) -> PenetrationSamples:
    """Compute penetration depths between the samples of a batch of paths.

    The motion is examined at the fractions 1/R, ..., (R - 1)/R of each interval, with R = `SAMPLES_PER_SLICE`. It is
    also examined in the middle of those gaps between them whose ends penetrate most, because a finger can pass through
    an object's edge within one gap. The number of these gaps in each interval is that of the NLP's samples.

    Args:
        model: Arms of the workcell.
        problems: A batch of path NLPs.
        x: Their solutions.
    """
    B, T, M = problems.sample_fraction.shape
    even = np.arange(1, SAMPLES_PER_SLICE) / SAMPLES_PER_SLICE
    home = np.asarray(problems.home)
    q = np.asarray(x.q)
    limits = np.asarray(model.joint_limits)
    curves = [
        joint_curve(home[lane], q[lane], straight_intervals(_lane_of(problems, lane), T), limits)
        for lane in range(B)
    ]

    def look(fraction: Float[np.ndarray, "lanes slices samples"]) -> PenetrationSamples:
        """Examine as many times as the NLP has samples, so that the solver's compiled programs can be used."""
        offset = np.stack(
            [_deviation(*lane) for lane in zip(home, q, curves, fraction, strict=True)]
        )
        moved = problems._replace(sample_fraction=fraction, sample_offset=offset)
        geometries = [measure_chunk(model, chunk) for chunk in lay_out_chunks(moved, x)]
        nearest = np.concatenate(
            [np.asarray(geometry.distance).min(axis=1) for geometry in geometries]
        )
        return PenetrationSamples(fraction, -nearest[: B * T * M].reshape(B, T, M))

    passes = [look(np.tile(part, (B, T, 1))) for part in even.reshape(-1, M)]

    # The second examination, in the middle of the gaps whose ends penetrate most.
    depth = np.concatenate([found.depth for found in passes], axis=2)
    ends = np.pad(depth, ((0, 0), (0, 0), (1, 1)), mode="edge")
    deepest = np.argsort(-(ends[..., :-1] + ends[..., 1:]), axis=2, kind="stable")[..., :M]
    passes.append(look((np.sort(deepest, axis=2) + 0.5) / SAMPLES_PER_SLICE))
    return PenetrationSamples(
        np.concatenate([found.fraction for found in passes], axis=2),
        np.concatenate([found.depth for found in passes], axis=2),
    )


def exchange_samples(
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    fraction: Float[np.ndarray, "slices times"],
    depth: Float[np.ndarray, "slices times"],
) -> Problem:
    """Return a path NLP whose samples are moved to where the motion penetrates.

    All samples are placed on the motion through `q`. The last sample of an interval stays at the slice, and each other
    sample represents an equal part of the interval. If the motion penetrates by more than `BETWEEN_TOLERANCE` in this
    part, the sample moves to the deepest penetration.

    Args:
        problem: The NLP, without batch axes.
        q: Joint angles of its solution [rad].
        fraction: Positions in each interval at which the motion was examined, from 0 to 1.
        depth: Penetration depths there [m].
    """
    moved = np.array(problem.sample_fraction)
    parts = moved.shape[1] - 1  # the last sample stays at the slice
    rows = np.arange(len(moved))
    for part in range(parts):
        is_within = (fraction > part / parts) & (fraction <= (part + 1) / parts)
        within = np.where(is_within, depth, -np.inf)
        deepest = within.argmax(axis=1)
        too_deep = within[rows, deepest] > BETWEEN_TOLERANCE
        moved[too_deep, part] = fraction[rows, deepest][too_deep]
    return place_samples(problem, q, moved)


def raised_clearance(
    clearance: Float[np.ndarray, "slices body_rows"], depth: Float[np.ndarray, "slices times"]
) -> Float[np.ndarray, "slices body_rows"]:
    """Return the clearances of an optimal path after an exchange, with those of intervals that penetrate raised.

    An optimal path runs along its constraints. Where a hand passes an edge quickly, it would penetrate just beside each
    place that a sample is moved to. A clearance that is larger by the depth guards the neighborhood of the samples.

    Args:
        clearance: Clearances in the interval before each slice [m].
        depth: Penetration depths at some times of each interval [m].
    """
    deepest = depth.max(axis=1)
    too_deep = np.where(deepest > BETWEEN_TOLERANCE, deepest, 0.0)
    return clearance + too_deep[:, None]
