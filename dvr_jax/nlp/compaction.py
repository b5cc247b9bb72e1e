"""The few active rows of each slice, gathered from all slices and visited some at a time.

Most distances of most slices are neither near nor in contact. To compute a number of rows in every slice, enough for
the fullest one, is ten times the work on a path; so the active rows of all slices are counted through, and a loop
visits a fixed number of them in each pass. What is computed for a row depends on that row alone, wherever in a pass it
is.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize


class ActiveRows(NamedTuple):
    """The active rows of L slices, in groups of up to ``group_size`` rows of one slice, slice after slice.

    Counts are float32 numbers, which are exact here and the quickest.
    """

    mask: Bool[Array, "rows slices"]
    """True where a row is active."""

    running_count: Float[Array, "rows slices"]
    """Active rows of the slice up to and including this one."""

    groups_so_far: Float[Array, " slices"]
    """Groups of all slices up to and including this one."""

    group_size: int
    """Most rows of a group."""


class RowChunk(NamedTuple):
    """Some groups of active rows."""

    slices: Int[Array, " groups"]
    """Slice of each group; L where there is no group left."""

    rows: Int[Array, "group_size groups"]
    """Rows of the groups."""

    valid: Bool[Array, "group_size groups"]
    """False where a group has fewer rows."""


def count_active(mask: Bool[Array, "rows slices"], group_size: int) -> ActiveRows:
    """Count the active rows of all slices.

    Args:
        mask: True where a row is active.
        group_size: Most rows of a group.
    """
    running = _running_sum(mask.astype(jnp.float32))
    groups = _running_sum(materialize(jnp.ceil(running[-1] / group_size)))
    return ActiveRows(mask, running, groups, group_size)


def _running_sum(value: Array) -> Array:
    """Sums along the first axis up to and including each entry, by doubling: XLA's `cumsum` takes ten times as long."""
    reach = 1
    while reach < len(value):
        padding = [(reach, 0), *[(0, 0)] * (value.ndim - 1)]
        value = materialize(value + jnp.pad(value[:-reach], padding))
        reach *= 2
    return value


def number_of_groups(active: ActiveRows) -> Float[Array, ""]:
    """Number of groups of all slices, a float32."""
    return active.groups_so_far[-1]


def gather_chunk(active: ActiveRows, first: Float[Array, ""], number: int) -> RowChunk:
    """Gather consecutive groups of active rows.

    Args:
        active: The counted rows.
        first: Number of the first group.
        number: How many groups, a static number.
    """
    P, L = active.mask.shape
    group = first + jnp.arange(number, dtype=jnp.float32)

    # The slice of a group is the first one up to which there are more groups than its number.
    slices = materialize((active.groups_so_far[None] <= group[:, None]).sum(1))
    mask = materialize(take_slices(active.mask, slices))
    count = materialize(take_slices(active.running_count, slices))

    # A group holds the rows whose running count within the slice falls into its range.
    own_groups = jnp.ceil(active.running_count[-1] / active.group_size)
    groups_before = take_slices(active.groups_so_far - own_groups, slices)
    place = jnp.arange(1, active.group_size + 1, dtype=jnp.float32)[:, None]
    wanted = (group - groups_before) * active.group_size + place
    taken = materialize(mask & (count == wanted[:, None]) & (slices < L))

    rows = (jnp.arange(P)[:, None] * taken).sum(1)
    rows, valid = materialize((rows, taken.any(1)))
    return RowChunk(slices, rows, valid)


def slot(active: ActiveRows) -> Int[Array, "rows slices"]:
    """Number of each active row's group, for groups of a single row; without meaning for the other rows."""
    first = active.groups_so_far - active.running_count[-1]
    return (first + active.running_count - 1).astype(jnp.int32)


def take_slices(value: Array, slices: Int[Array, " groups"]) -> Array:
    """Entries of the last axis; those of the last slice where there is no group left.

    Args:
        value: Something for each slice, on the last axis.
        slices: Slices of the groups.
    """
    return jnp.take(value, jnp.minimum(slices, value.shape[-1] - 1), axis=-1)
