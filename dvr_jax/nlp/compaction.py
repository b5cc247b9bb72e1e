"""The few rows of each slice that matter, gathered from all slices and visited so many at a time.

Most distances of most slices are neither near nor push. To compute a number of rows in every slice, enough for the
fullest one, is ten times the work on a path; so the marked rows of all slices are counted through, and a loop visits
a fixed number of them in each pass. What is computed for a row depends on that row alone, wherever in a pass it is."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import materialize


class ActiveRows(NamedTuple):
    """The marked rows of L slices, in parts of up to ``size`` rows of one slice, slice after slice. (Numbers are
    float32, exact for these and the quickest.)"""

    mask: Array
    """(P, L) True where a row is marked."""
    running: Array
    """(P, L) marked rows of the slice up to and with this one."""
    end: Array
    """(L,) parts of all slices up to and with this one."""
    size: int


class Visit(NamedTuple):
    """Some parts."""

    slices: Array
    """(E,) slice of each part; L where there is none left."""
    rows: Array
    """(size, E) its rows."""
    there: Array
    """(size, E) False where a part has fewer rows."""


def mark(mask: Array, size: int) -> ActiveRows:
    """Count a mask (P, L) through."""
    running = _running_sum(mask.astype(jnp.float32))
    return ActiveRows(mask, running, _running_sum(materialize(jnp.ceil(running[-1] / size))), size)


def _running_sum(value: Array) -> Array:
    """Sums along the first axis up to and with each entry, by doubling: XLA's `cumsum` takes ten times as long."""
    reach = 1
    while reach < len(value):
        before = jnp.pad(value[:-reach], [(reach, 0), *[(0, 0)] * (value.ndim - 1)])
        value = materialize(value + before)
        reach *= 2
    return value


def number_of_parts(marked: ActiveRows) -> Array:
    """Number of parts of all slices, a float32."""
    return marked.end[-1]


def visit(marked: ActiveRows, first: Array, number: int) -> Visit:
    """The parts ``first``, ``first + 1``, ... of a static ``number``."""
    P, L = marked.mask.shape
    part = first + jnp.arange(number, dtype=jnp.float32)
    slices = materialize((marked.end[None] <= part[:, None]).sum(1))
    mask, count = materialize(tuple(take_slices(value, slices) for value in (marked.mask, marked.running)))
    before = take_slices(marked.end - jnp.ceil(marked.running[-1] / marked.size), slices)
    slot = (part - before) * marked.size + jnp.arange(1, marked.size + 1, dtype=jnp.float32)[:, None]
    taken = materialize(mask & (count == slot[:, None]) & (slices < L))
    return Visit(slices, *materialize(((jnp.arange(P)[:, None] * taken).sum(1), taken.any(1))))


def place(marked: ActiveRows) -> Array:
    """(P, L) number of each marked row's part, where a part is one row; anything for the other rows."""
    start = marked.end - marked.running[-1]
    return (start + marked.running - 1).astype(jnp.int32)


def take_slices(value: Array, slices: Array) -> Array:
    """Entries of the last axis; of the last slice where there is none left."""
    return jnp.take(value, jnp.minimum(slices, value.shape[-1] - 1), axis=-1)
