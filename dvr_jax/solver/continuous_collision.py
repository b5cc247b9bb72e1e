"""Collisions between the samples of a path.

A motion must be free of collisions at all times, an NLP looks at some of them: a semi-infinite constraint, which an
exchange method meets (Hettich and Kortanek, Semi-infinite programming, SIAM Review 35, 1993). A path is solved with
`PATH_SAMPLES` samples an interval; where the motion through its solution penetrates at other times, samples move
there, and the solver goes on from where it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from dvr_jax.motion.joint_curve import joint_curve
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk
from dvr_jax.workcell.model import WorkcellModel

PATH_SAMPLES = 3
"""Samples in the interval before each slice: one at the slice, one in either half of the interval. With the slices
alone a finger hops over an object's edge between two of them."""

SAMPLES_PER_SLICE = 10
"""Rate at which a motion is looked at, per slice of the path."""

BETWEEN_TOLERANCE = 2.5e-3
"""Deepest penetration between samples [m]; the independent check allows 3 mm."""

EXCHANGES = 4
"""How often samples of one path are moved."""


class PenetrationSamples(NamedTuple):
    """How deep lanes' motions penetrate at R times of each interval."""

    fraction: Float[np.ndarray, "lanes slices times"]
    """Where in the interval, 0 to 1."""

    depth: Float[np.ndarray, "lanes slices times"]
    """Deepest penetration of anything, negative where all is clear [m]."""


def place_samples(
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    fraction: Float[np.ndarray, "slices samples"],
) -> Problem:
    """A path's NLP with its samples on the motion through a point.

    Args:
        problem: The NLP, without batch axes.
        q: Joint angles of the point [rad].
        fraction: Where in each interval the samples are.
    """
    home = np.asarray(problem.home)
    offset = _deviation(home, q, joint_curve(home, q), fraction)
    return problem._replace(sample_fraction=fraction, sample_offset=offset)


def _deviation(
    home: Float[np.ndarray, " joints"],
    q: Float[np.ndarray, "slices joints"],
    curve: PchipInterpolator,
    fraction: Float[np.ndarray, "slices samples"],
) -> Float[np.ndarray, "slices samples joints"]:
    """By how much the motion through q deviates from a straight line at these fractions of the intervals [rad]."""
    times = np.arange(len(q))[:, None] + fraction
    before = np.concatenate([home[None], q[:-1]])[:, None]
    line = before + fraction[..., None] * (q[:, None] - before)
    return np.asarray(curve(times) - line)


def even_fractions(slices: int, samples: int = PATH_SAMPLES) -> Float[np.ndarray, "slices samples"]:
    """Samples that divide each interval evenly.

    Args:
        slices: Number of intervals.
        samples: Samples of each.

    Raises:
        ValueError: Whole passes of so many samples do not make up what `sample_penetration` looks at.
    """
    if (SAMPLES_PER_SLICE - 1) % samples:
        raise ValueError(
            f"{samples} samples a slice; valid are divisors of {SAMPLES_PER_SLICE - 1}"
        )
    return np.tile(np.arange(1, samples + 1) / samples, (slices, 1))


def sample_penetration(model: WorkcellModel, problems: Problem, x: Variables) -> PenetrationSamples:
    """Look for penetrations between the samples of a batch of paths.

    Looked at are the times 1/R, ..., (R - 1)/R of each interval, R = `SAMPLES_PER_SLICE`, and the middles of those
    gaps between them whose ends are deepest, as many as a slice has samples: a finger can pass an object's edge within
    one gap.

    Args:
        model: Arms of the workcell.
        problems: A batch of path NLPs.
        x: Their solutions.
    """
    B, T, M = problems.sample_fraction.shape
    even = np.arange(1, SAMPLES_PER_SLICE) / SAMPLES_PER_SLICE
    home = np.asarray(problems.home)
    q = np.asarray(x.q)
    curves = [joint_curve(*lane) for lane in zip(home, q, strict=True)]

    def look(fraction: Float[np.ndarray, "lanes slices samples"]) -> PenetrationSamples:
        """At as many times as the NLP has samples, so that the solver's compiled programs serve."""
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

    # A second look at the gaps whose ends are deepest.
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
    """Move samples to where the motion penetrates.

    All samples are placed on the motion through `q`; where the motion penetrates too deep within the part of an
    interval that a sample stands for, the sample moves to the deepest place.

    Args:
        problem: The NLP, without batch axes.
        q: Joint angles of its solution [rad].
        fraction: Where in each interval the motion was looked at.
        depth: How deep it penetrates there [m].
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
