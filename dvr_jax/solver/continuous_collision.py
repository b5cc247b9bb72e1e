"""What happens between the slices of a path.

A motion must be free of collisions at all times, an NLP looks at some of them: a semi-infinite constraint, which an
exchange method meets (Hettich and Kortanek, Semi-infinite programming, SIAM Review 35, 1993). A path is solved with
`PATH_SAMPLES` samples an interval; where the motion through its solution penetrates at other times, samples move there,
and the solver goes on from where it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk

Floats = NDArray[np.float64]

PATH_SAMPLES = 3
"""Samples in the interval before each slice: one at the slice, one in either half of the interval. With the slices
alone a finger hops over an object's edge between two of them."""

SAMPLES_PER_SLICE = 10
"""Rate at which a motion is looked at, per slice of the path."""

BETWEEN_TOLERANCE = 2.5e-3
"""Deepest penetration between samples [m]; the independent check allows 3 mm."""

EXCHANGES = 4
"""How often samples of one path are moved."""


def joint_curve(home: Floats, q: Floats) -> PchipInterpolator:
    """The motion's joint angles (14,) over the slices 0 (home) to T, from those (T, 14) at the slices 1 to T.

    A monotone cubic keeps within the joint limits, and an arm that rests between two slices at rest. The arms have been
    at home before, so that they start from rest."""
    return PchipInterpolator(np.arange(-1, len(q) + 1), np.concatenate([home[None], home[None], q]), axis=0)


def place_samples(problem: Problem, q: Floats, share: Floats) -> Problem:
    """A path's NLP with samples (T, M) on the motion through q (T, 14)."""
    return problem._replace(share=share, offset=_deviation(problem.home, q, joint_curve(problem.home, q), share))


def _deviation(home: Floats, q: Floats, curve: PchipInterpolator, share: Floats) -> Floats:
    """By how much the motion through q deviates from a straight line at these shares (T, M) of the intervals."""
    times = np.arange(len(q))[:, None] + share
    before = np.concatenate([home[None], q[:-1]])[:, None]
    line = before + share[..., None] * (q[:, None] - before)
    return np.asarray(curve(times) - line)


def even_shares(T: int, samples: int = PATH_SAMPLES) -> Floats:
    """Samples (T, M) that divide each interval evenly.

    Raises:
        ValueError: where M looks at a time do not make up `sample_penetration`'s.
    """
    if (SAMPLES_PER_SLICE - 1) % samples:
        raise ValueError(f"{samples} samples a slice; valid are divisors of {SAMPLES_PER_SLICE - 1}")
    return np.tile(np.arange(1, samples + 1) / samples, (T, 1))


class PenetrationSamples(NamedTuple):
    """What lanes' motions are seen to do at L times of each interval."""

    share: Floats
    """(B, T, L) of the interval, 0 to 1."""
    depth: Floats
    """(B, T, L) deepest penetration of anything, negative where all is clear [m]."""


def sample_penetration(problems: Problem, x: Variables) -> PenetrationSamples:
    """Penetrations at the times 1/R, ..., (R - 1)/R of each interval, R = `SAMPLES_PER_SLICE`, and in the middle of
    those `PATH_SAMPLES` of the gaps between them whose ends are deepest: a finger can pass an object's edge in one."""
    B, T, M = problems.share.shape
    even = np.arange(1, SAMPLES_PER_SLICE) / SAMPLES_PER_SLICE
    home, q = np.asarray(problems.home), np.asarray(x.q)
    curves = [joint_curve(*lane) for lane in zip(home, q, strict=True)]

    def see(share: Floats) -> PenetrationSamples:
        """At as many times as the NLP has samples, so that the solver's compiled programs serve."""
        offset = np.stack([_deviation(*lane) for lane in zip(home, q, curves, share, strict=True)])
        chunks = lay_out_chunks(problems._replace(share=share, offset=offset), x)
        distance = np.concatenate([np.asarray(measure_chunk(chunk).distance).min(axis=1) for chunk in chunks])
        return PenetrationSamples(share, -distance[: B * T * M].reshape(B, T, M))

    looks = [see(np.tile(part, (B, T, 1))) for part in even.reshape(-1, M)]
    depth = np.concatenate([look.depth for look in looks], axis=2)
    ends = np.pad(depth, ((0, 0), (0, 0), (1, 1)), mode="edge")
    deepest = np.argsort(-(ends[..., :-1] + ends[..., 1:]), axis=2, kind="stable")[..., :M]
    looks.append(see((np.sort(deepest, axis=2) + 0.5) / SAMPLES_PER_SLICE))
    share, depth = (np.concatenate([look[part] for look in looks], axis=2) for part in range(2))
    return PenetrationSamples(share, depth)


def exchange_samples(problem: Problem, q: Floats, share: Floats, depth: Floats) -> Problem:
    """The NLP with its samples on the motion through q (T, 14), and where that penetrates too deep, the sample of that
    part of the interval moved to the deepest place.

    Args:
        share, depth: (T, L) of this lane's `PenetrationSamples`.
    """
    moved = np.array(problem.share)
    parts = moved.shape[1] - 1  # the last sample stays at the slice
    rows = np.arange(len(moved))
    for part in range(parts):
        within = np.where((share > part / parts) & (share <= (part + 1) / parts), depth, -np.inf)
        deepest = within.argmax(axis=1)
        too_deep = within[rows, deepest] > BETWEEN_TOLERANCE
        moved[too_deep, part] = share[rows, deepest][too_deep]
    return place_samples(problem, q, moved)
