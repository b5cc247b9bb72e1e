"""What happens between the slices of a path.

A motion must be free of collisions at all times, an NLP looks at some of them: a semi-infinite constraint, which an
exchange method meets (Hettich and Kortanek, Semi-infinite programming, SIAM Review 35, 1993). A path is solved with
`PATH_SAMPLES` samples an interval; where the motion through its solution penetrates at other times, samples move there,
and the solver goes on from where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from dvr_jax.komo.augmented import Lane
from dvr_jax.komo.problem import Problem
from dvr_jax.komo.solver import lay_out_trial, measure_chunk

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
    times = np.arange(len(q))[:, None] + share
    before = np.concatenate([problem.home[None], q[:-1]])[:, None]
    line = before + share[..., None] * (q[:, None] - before)
    return problem._replace(share=share, offset=joint_curve(problem.home, q)(times) - line)


def even_shares(T: int) -> Floats:
    """Samples (T, M) that divide each interval evenly."""
    return np.tile(np.arange(1, PATH_SAMPLES + 1) / PATH_SAMPLES, (T, 1))


def depths_between(problems: Problem, lanes: Lane) -> Floats:
    """Deepest penetrations (B, T, R - 1) [m] of lanes' points at the times 1/R, ..., (R - 1)/R of each interval,
    R = `SAMPLES_PER_SLICE`."""
    B, T, M = problems.share.shape
    lanes = lanes._replace(step=lanes.step._replace(q=np.zeros_like(lanes.x.q), m=np.zeros_like(lanes.x.m)))
    depths = []
    # M at a time, so that the compiled programs of the solver serve.
    for first in range(1, SAMPLES_PER_SLICE, M):
        share = np.tile(np.minimum(np.arange(first, first + M), SAMPLES_PER_SLICE) / SAMPLES_PER_SLICE, (T, 1))
        placed = [place_samples(Problem(*(leaf[b] for leaf in problems)), lanes.x.q[b], share) for b in range(B)]
        batch = problems._replace(
            share=np.stack([problem.share for problem in placed]), offset=np.stack([p.offset for p in placed])
        )
        distance = [np.asarray(measure_chunk(chunk).distance).min(axis=1) for chunk in lay_out_trial(batch, lanes)]
        depths.append(-np.concatenate(distance)[: B * T * M].reshape(B, T, M))
    return np.maximum(np.concatenate(depths, axis=2)[..., : SAMPLES_PER_SLICE - 1], 0)


def move_samples(problem: Problem, q: Floats, depth: Floats) -> Problem:
    """The NLP with its samples on the motion through q (T, 14), and where that penetrates too deep, the sample of that
    part of the interval moved to the deepest place.

    Args:
        depth: (T, R - 1) of `depths_between`.
    """
    share = np.array(problem.share)
    zones = np.array_split(np.arange(SAMPLES_PER_SLICE - 1), share.shape[1] - 1)
    for sample, zone in enumerate(zones):
        within = depth[:, zone]
        moved = within.max(axis=1) > BETWEEN_TOLERANCE
        share[moved, sample] = (zone[within.argmax(axis=1)[moved]] + 1) / SAMPLES_PER_SLICE
    return place_samples(problem, q, share)
