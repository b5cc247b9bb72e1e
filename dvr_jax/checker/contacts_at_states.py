"""Which bodies touch or are near in the states of a motion, without looking at every pair in every state.

A motion is divided into blocks of consecutive states within which no geom moves far. Of a pair of geoms, let

- d(s) be the distance in state s,
- h be the first state of a block, and m(s) a bound of how far the two move relative to each other from h to s.

Distances change by no more than the geoms move relative to each other, so that ``d(h) - m(s) <= d(s) <= d(h) + m(s)``.
The collision detection looks only at the first state of each block, with margins that make it find every pair that can
come near in the block. For these pairs, m(s) tells in which states the distance has to be computed: not where they are
still too far apart, and not where they have not moved relative to each other, as a hand and the object that it holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.checker.collision_model import CollisionModel
from dvr_jax.checker.contacts import (
    Contacts,
    contacts_of,
    joined_contacts,
    near_contacts,
)
from dvr_jax.checker.geom_poses import GeomPoses, farthest_move, relative_poses
from dvr_jax.checker.pair_distances import PairsInStates, pair_distances

BLOCK_WAY = 0.04
"""Way that the fastest geoms move within a block [m], apart from a step that is longer."""

SAME_PLACE = 1e-6
"""Two geoms that move relative to each other by no more than this keep their distance [m]."""

SLACK = 1e-4
"""How much MuJoCo's distance of two geoms may be in error [m]."""


def contacts_at_states(
    scene_model: CollisionModel,
    states: Float[np.ndarray, "states nq"],
    poses: GeomPoses,
    reach: Float[np.ndarray, "steps geoms"],
    accepted: Float[np.ndarray, "geoms geoms"],
) -> Contacts:
    """Find the pairs of geoms that touch in each state, or that could meet within half of an adjacent step.

    Args:
        scene_model: Model of the scene; its margins and its data are overwritten.
        states: States in the order of time.
        poses: Poses of the geoms in these states.
        reach: How far any point of a geom moves in the step after each state, at most [m].
        accepted: Depth up to which two geoms may penetrate each other [m].

    Returns:
        The contacts. Depths of at most the accepted ones are exact to `SAME_PLACE`.
    """
    # A pair is near if its geoms could meet within half of the longer of the two adjacent steps.
    padded = np.pad(reach, ((1, 1), (0, 0)))
    margins = np.maximum(padded[:-1], padded[1:]) / 2
    way = np.cumsum(padded[:-1], axis=0)

    blocks = _divide(way, margins)
    heads = blocks.first
    found = contacts_of(scene_model, states[heads], poses.at(heads), blocks.margins)
    at_heads, candidates = _candidates(found, blocks, way, margins)

    moved = _relative_move(scene_model.model, poses, candidates)
    pairs = candidates.pairs
    limit = pairs.limit

    # A pair that is too deep is looked at in every state, so that the deepest one is found.
    is_accepted = candidates.distance > SAME_PLACE - accepted[pairs.first, pairs.second]
    keeps = (moved <= SAME_PLACE) & is_accepted
    is_doubtful = ~keeps & (candidates.distance - moved < limit + SLACK)

    distance = np.where(keeps, candidates.distance, np.inf)
    doubtful = pairs.only(is_doubtful)
    distance[is_doubtful] = pair_distances(scene_model, poses, doubtful)
    return joined_contacts(at_heads, near_contacts(pairs, distance))


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Blocks of consecutive states."""

    first: Int[np.ndarray, " blocks"]
    """First state of each block."""

    length: Int[np.ndarray, " blocks"]
    """Number of its states."""

    margins: Float[np.ndarray, "blocks geoms"]
    """Margin of each geom in the first state, with which every pair is found that is near in any state of the block
    [m]."""


def _divide(
    way: Float[np.ndarray, "states geoms"], margins: Float[np.ndarray, "states geoms"]
) -> _Blocks:
    """Divide a motion into blocks.

    Args:
        way: Way of each geom from the first state on [m].
        margins: Margin of each geom in each state [m].

    Returns:
        The blocks.
    """
    fastest = np.diff(way, axis=0, prepend=0.0).max(axis=1)
    number = np.floor(np.cumsum(fastest) / BLOCK_WAY)
    first = np.flatnonzero(np.diff(number, prepend=-1.0))
    length = np.diff(first, append=len(way))

    # Two geoms that are near in a state are nearer in the first state than their ways until then and their margins.
    last = first + length - 1
    largest = np.maximum.reduceat(margins, first, axis=0)
    return _Blocks(first, length, way[last] - way[first] + largest)


@dataclass(frozen=True, slots=True)
class _Candidates:
    """Pairs of geoms that may be near, each in one state of a block."""

    pairs: PairsInStates
    """The pairs; their limits are the sums of their margins."""

    head: Int[np.ndarray, " pairs"]
    """First state of the block."""

    distance: Float[np.ndarray, " pairs"]
    """Distance in that state [m]."""


def _candidates(
    found: Contacts,
    blocks: _Blocks,
    way: Float[np.ndarray, "states geoms"],
    margins: Float[np.ndarray, "states geoms"],
) -> tuple[Contacts, _Candidates]:
    """Collect the pairs that are near in the first state of a block, or may be near in a later one.

    Args:
        found: Contacts in the first states of the blocks; their states are the numbers of the blocks.
        blocks: The blocks.
        way: Way of each geom from the first state on [m].
        margins: Margin of each geom in each state [m].

    Returns:
        The contacts in the first states, and each pair that may be near once for each later state of the block.
    """
    block, first, second, distance = _deepest_of_pairs(found, way.shape[1])

    # The first states of the blocks, whose distances are known.
    head = blocks.first[block]
    limit = margins[head, first] + margins[head, second]
    at_heads = near_contacts(PairsInStates(head, first, second, limit), distance)

    # The pairs of each block in its other states.
    length = blocks.length[block] - 1
    entry = np.repeat(np.arange(len(block)), length)
    offset = np.arange(len(entry)) - np.repeat(np.cumsum(length) - length, length)
    start = head[entry]
    state = start + 1 + offset
    first = first[entry]
    second = second[entry]
    limit = margins[state, first] + margins[state, second]

    # Their ways alone show that most of them are still too far apart.
    moved = way[state, first] - way[start, first] + way[state, second] - way[start, second]
    kept = distance[entry] - moved < limit + SLACK
    pairs = PairsInStates(state, first, second, limit).only(kept)
    return at_heads, _Candidates(pairs, start[kept], distance[entry][kept])


def _deepest_of_pairs(
    found: Contacts, geoms: int
) -> tuple[
    Int[np.ndarray, " pairs"],
    Int[np.ndarray, " pairs"],
    Int[np.ndarray, " pairs"],
    Float[np.ndarray, " pairs"],
]:
    """Return the states, the two geoms and the least distance [m] of each pair that has contacts.

    Args:
        found: Contacts; a pair can have several in a state, of which the deepest one counts.
        geoms: Number of geoms of the model.
    """
    lower, higher = np.sort(found.geoms, axis=1).T
    keys, index = np.unique((found.state * geoms + lower) * geoms + higher, return_inverse=True)
    distance = np.full(len(keys), np.inf)
    np.minimum.at(distance, index, found.distance)
    return keys // geoms**2, keys // geoms % geoms, keys % geoms, distance


def _relative_move(
    model: mujoco.MjModel, poses: GeomPoses, candidates: _Candidates
) -> Float[np.ndarray, " pairs"]:
    """Bound how far two geoms move relative to each other from the first state of their block on [m]."""
    pairs = candidates.pairs
    p, R = relative_poses(poses, candidates.head, pairs.first, pairs.second)
    p_after, R_after = relative_poses(poses, pairs.state, pairs.first, pairs.second)
    return farthest_move(p_after - p, R_after - R, model.geom_rbound[pairs.second])
