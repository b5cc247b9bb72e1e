"""Figures of merit of predictions: average precision, and the sequences that the network takes without any search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.logic import Grounding
from dvr_jax.model.batches import SceneTable
from dvr_jax.model.network import NetworkParameters, encode_images, encode_symbols, step

SCENES_AT_ONCE = 32

_ROWS = 256
"""Candidates are padded to a multiple of this, so that few shapes are compiled."""


def average_precision(labels: NDArray[np.bool_], scores: NDArray[np.floating]) -> float:
    """Sum over the distinct thresholds of (recall gained) x precision; nan without any positive label.

    Labels and scores have the same shape; equal scores share a threshold, so their order does not matter.
    """
    order = np.argsort(-scores.ravel(), kind="stable")
    sorted_scores, hits = scores.ravel()[order], np.cumsum(labels.ravel()[order])
    if not len(hits) or hits[-1] == 0:
        return float("nan")
    last = np.append(np.flatnonzero(np.diff(sorted_scores)), len(hits) - 1)  # last of each run of equal scores
    gained = np.diff(hits[last], prepend=0)
    return float(np.sum(gained * hits[last] / (last + 1)) / hits[-1])


def greedy_sequences(weights: NetworkParameters, table: SceneTable, scenes: Sequence[int], k_max: int) -> list[tuple[int, ...]]:
    """For each scene the sequence of at most k_max actions that takes, at each step, the action with the highest
    prediction among those from which the goal can still be reached; empty where there is none."""
    result: list[tuple[int, ...]] = []
    for first in range(0, len(scenes), SCENES_AT_ONCE):
        result += _greedy(weights, table, np.asarray(scenes[first : first + SCENES_AT_ONCE]), k_max)
    return result


def _greedy(weights: NetworkParameters, table: SceneTable, scenes: NDArray[np.int_], k_max: int) -> list[tuple[int, ...]]:
    groundings = [table.groundings[scene] for scene in scenes]
    # Image codes of all tuples of all scenes, one after the other; too few scenes are repeated.
    count = table.pairs.shape[1]
    full = np.resize(scenes, SCENES_AT_ONCE)
    plain, view = np.zeros((SCENES_AT_ONCE, 2), np.bool_), np.repeat(np.arange(SCENES_AT_ONCE, dtype=np.int32), count)
    shown = full.astype(np.int32), plain, view, table.pairs[full].reshape(-1, 2)
    codes = _encode(weights, table.height, table.masks, *shown)
    states = [grounding.initial_state for grounding in groundings]
    sequences: list[list[int]] = [[] for _ in scenes]
    running = [i for i, grounding in enumerate(groundings) if not grounding.is_goal(grounding.initial_state)]
    hidden = np.zeros((len(scenes), weights.config.hidden), np.float32)
    for depth in range(k_max):
        candidates = [(i, action) for i in running for action in _open_actions(groundings[i], states[i], k_max - depth)]
        if not candidates:
            break
        place, actions = (np.array(column) for column in zip(*candidates, strict=True))
        scene = scenes[place]
        logits, after = _advance_rows(
            weights,
            codes,
            hidden[place],
            table.symbol[scene, actions],
            table.normal[scene, actions],
            place * count + table.tuple_index[scene, actions],
            place * count + table.goal_tuple[scene],
        )
        next_hidden, running = hidden.copy(), []
        for i in np.unique(place):
            rows = np.flatnonzero(place == i)
            best = rows[np.argmax(logits[rows])]
            action = int(actions[best])
            sequences[i].append(action)
            states[i], next_hidden[i] = groundings[i].successor(states[i], action), after[best]
            if not groundings[i].is_goal(states[i]):
                running.append(int(i))
        hidden = next_hidden
    return [tuple(sequence) for sequence in sequences]


def _open_actions(grounding: Grounding, state: int, remaining: int) -> list[int]:
    """Applicable actions after which the goal can be reached within `remaining` actions, this one included."""
    return [
        action
        for action in grounding.applicable(state)
        if grounding.can_reach_goal(grounding.successor(state, action), remaining - 1)
    ]


def _advance_rows(
    weights: NetworkParameters, codes: jax.Array, hidden: NDArray[np.float32], *columns: NDArray[Any]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`_advance` of rows, padded to few sizes."""
    count = len(hidden)
    padding = -count % _ROWS
    rows = [np.pad(column, [(0, padding), *[(0, 0)] * (column.ndim - 1)]) for column in columns]
    logits, after = _advance(weights, codes, np.pad(hidden, ((0, padding), (0, 0))), *rows)
    return np.asarray(logits)[:count], np.asarray(after)[:count]


_encode = jax.jit(encode_images)


@jax.jit
def _advance(
    weights: NetworkParameters,
    codes: jax.Array,
    hidden: jax.Array,
    symbol: jax.Array,
    normal: jax.Array,
    image: jax.Array,
    goal: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Logits (B,) and states (B, H) after actions with symbols (B,), normals (B, 2) of their faces and rows (B,) of
    image and goal codes."""
    return step(weights, hidden, encode_symbols(weights, symbol, normal), codes[image], jnp.asarray(codes[goal]))
