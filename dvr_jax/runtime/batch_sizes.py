"""How many slices and solver lanes share one call, by the kind of device. Programs are compiled for these sizes."""

from __future__ import annotations

from dataclasses import dataclass

import jax


@dataclass(frozen=True, slots=True)
class BatchSizes:
    """Sizes of the solver's calls on one kind of device."""

    chunk: int
    """Slices that one call evaluates, or a small multiple of it. Keyframes of as many actions are solved together."""
    largest_chunk: int
    """Largest number of slices that one call evaluates."""
    path_lanes: int
    """Paths that are solved side by side."""
    beam_lanes: int
    """Prefixes whose keyframe candidates are extended by one call."""
    near_pairs: int
    """Distances of capsules to objects that one pass computes. On paths, on average one capsule a slice is near."""
    active_groups: int
    """Parts of slices whose active constraint rows one pass adds up. Of a path's slices, one in seven has any."""


CPU = BatchSizes(
    chunk=60,
    largest_chunk=180,
    path_lanes=1,
    beam_lanes=1,
    near_pairs=192,
    active_groups=32,
)
"""Sizes for a CPU.

Keyframes of 1 to 6 actions and paths of 2, 4 and 6 actions fill chunks of 60 without a rest. In one call of 180 slices
(a path of six actions) a slice takes two thirds of the time that it takes in three calls. Eight prefixes in one call
take 12 to 28 ms, in eight calls 21 to 33 ms, but most requests are for fewer prefixes.
"""

ACCELERATOR = BatchSizes(
    chunk=1_920,
    largest_chunk=7_680,
    path_lanes=32,
    beam_lanes=64,
    near_pairs=7_680,
    active_groups=1_280,
)
"""Sizes for a GPU or TPU, chosen so that one call has work for thousands of threads; not yet tuned on a device."""


def batch_sizes() -> BatchSizes:
    """Return the sizes for the device that JAX computes on."""
    return CPU if jax.default_backend() == "cpu" else ACCELERATOR
