"""How many slices and lanes share a call: sizes that are compiled for, by the kind of device."""

from __future__ import annotations

from dataclasses import dataclass

import jax


@dataclass(frozen=True, slots=True)
class BatchSizes:
    """Sizes of calls."""

    chunk: int
    """Slices that one call measures, or a small multiple of it; so many actions' keyframes are solved side by side."""
    largest_chunk: int
    """Most slices that one call measures."""
    path_lanes: int
    """Paths that are solved side by side."""
    beam_lanes: int
    """Prefixes whose particles are extended side by side, where there are many."""
    few: int
    """Up to so many are extended one by one."""
    near_pairs: int
    """Distances of capsules to objects that are taken in one pass. On paths one a slice is near on average."""
    active_groups: int
    """Parts of slices whose rows that push are added up in one pass. Of the slices of paths one in seven has any."""


CPU = BatchSizes(chunk=60, largest_chunk=180, path_lanes=1, beam_lanes=8, few=3, near_pairs=192, active_groups=32)
"""Keyframes of 1 to 6 actions and paths of 2, 4 and 6 fill the chunks without a rest; in one call of 180 slices, a path
of six actions, a slice takes two thirds of the time that it takes in three. One extended prefix takes a quarter of the
time of eight."""

ACCELERATOR = BatchSizes(
    chunk=1_920, largest_chunk=7_680, path_lanes=32, beam_lanes=64, few=0, near_pairs=7_680, active_groups=1_280
)
"""Chosen so that a call has work for thousands of threads; not yet measured on any."""


def batch_sizes() -> BatchSizes:
    """Sizes for the device that JAX computes on."""
    return CPU if jax.default_backend() == "cpu" else ACCELERATOR
