"""The sequences that a network takes without any search: the action with the highest prediction at each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from dvr_jax.logic import Grounding
from dvr_jax.model.forward import advance, encode_images, encode_symbols
from dvr_jax.model.network import NetworkParameters
from dvr_jax.model.scene_table import SceneTable

SCENES_AT_ONCE = 32
"""Number of scenes whose images are encoded together."""

ROW_MULTIPLE = 256
"""Candidates are padded to a multiple of this number, so that few shapes are compiled."""


def greedy_sequences(
    parameters: NetworkParameters,
    table: SceneTable,
    scenes: Sequence[int],
    k_max: int,
) -> list[tuple[int, ...]]:
    """Follow the network's predictions in each scene.

    At each step the sequence takes the action with the highest prediction among those after which the goal can still be
    reached within `k_max` actions.

    Args:
        parameters: Parameters of the network.
        table: Table of scenes.
        scenes: Indices of the scenes in the table.
        k_max: Largest number of actions of a sequence.

    Returns:
        The sequence of each scene, as indices into the actions of its grounding; empty where there is none.
    """
    result: list[tuple[int, ...]] = []
    for first in range(0, len(scenes), SCENES_AT_ONCE):
        some_scenes = np.asarray(scenes[first : first + SCENES_AT_ONCE])
        result += _GreedySearch(parameters, table, some_scenes).run(k_max)
    return result


class _Candidates(NamedTuple):
    """Actions that may come next in the scenes of a greedy search."""

    place: Int[np.ndarray, " candidates"]
    """Place of each candidate's scene among the scenes of the search."""

    action: Int[np.ndarray, " candidates"]
    """The action, as an index into the actions of the scene's grounding."""


class _GreedySearch:
    """Greedy sequences of a few scenes, which go on side by side."""

    def __init__(
        self,
        parameters: NetworkParameters,
        table: SceneTable,
        scenes: Int[np.ndarray, " scenes"],
    ) -> None:
        self._parameters = parameters
        self._table = table
        self._scenes = scenes
        self._groundings = [table.groundings[scene] for scene in scenes]
        self._states = [grounding.initial_state for grounding in self._groundings]
        self._sequences: list[list[int]] = [[] for _ in scenes]
        self._hidden = np.zeros((len(scenes), parameters.config.hidden), np.float32)
        self._tuples_of_scene = table.pairs.shape[1]
        self._image_codes = self._encode_all_tuples()

    def run(self, k_max: int) -> list[tuple[int, ...]]:
        """Return the sequence of each scene."""
        for remaining in range(k_max, 0, -1):
            candidates = self._candidates(remaining)
            if not len(candidates.place):
                break
            self._take_best(candidates)
        return [tuple(sequence) for sequence in self._sequences]

    def _encode_all_tuples(self) -> Float[Array, "tuples dense"]:
        """Return the image codes of all tuples of all scenes, scene after scene."""
        # Scenes are repeated until there are as many as always, so that one shape is compiled.
        scenes = np.resize(self._scenes, SCENES_AT_ONCE)
        view = np.repeat(np.arange(SCENES_AT_ONCE, dtype=np.int32), self._tuples_of_scene)
        return _encode_images(
            self._parameters,
            self._table.height,
            self._table.masks,
            scenes.astype(np.int32),
            np.zeros((SCENES_AT_ONCE, 2), np.bool_),
            view,
            self._table.pairs[scenes].reshape(-1, 2),
        )

    def _candidates(self, remaining: int) -> _Candidates:
        """Return the actions that may come next in scenes that are not yet at their goal."""
        places: list[int] = []
        actions: list[int] = []
        for place, grounding in enumerate(self._groundings):
            state = self._states[place]
            if not grounding.is_goal(state):
                of_scene = _open_actions(grounding, state, remaining)
                places += [place] * len(of_scene)
                actions += of_scene
        return _Candidates(np.array(places, np.int64), np.array(actions, np.int64))

    def _take_best(self, candidates: _Candidates) -> None:
        """Take the most promising candidate of each scene that has any."""
        logits, hidden_after = self._predict(candidates)
        hidden = self._hidden.copy()
        for place in np.unique(candidates.place):
            rows = np.flatnonzero(candidates.place == place)
            best = rows[np.argmax(logits[rows])]
            action = int(candidates.action[best])

            grounding = self._groundings[place]
            self._states[place] = grounding.successor(self._states[place], action)
            self._sequences[place].append(action)
            hidden[place] = hidden_after[best]
        self._hidden = hidden

    def _predict(
        self,
        candidates: _Candidates,
    ) -> tuple[Float[np.ndarray, " candidates"], Float[np.ndarray, "candidates hidden"]]:
        """Return the logits of candidates and the hidden states after them."""
        scene = self._scenes[candidates.place]
        first_image = candidates.place * self._tuples_of_scene
        rows = [
            self._hidden[candidates.place],
            self._table.symbol[scene, candidates.action],
            self._table.normal[scene, candidates.action],
            first_image + self._table.tuple_index[scene, candidates.action],
            first_image + self._table.goal_tuple[scene],
        ]

        count = len(scene)
        padded = [_pad_rows(column, -count % ROW_MULTIPLE) for column in rows]
        logits, hidden = _advance_rows(self._parameters, self._image_codes, *padded)
        return np.asarray(logits)[:count], np.asarray(hidden)[:count]


def _open_actions(grounding: Grounding, state: int, remaining: int) -> list[int]:
    """Return the applicable actions that begin a way to the goal of at most `remaining` actions."""
    return [
        action
        for action in grounding.applicable(state)
        if grounding.can_reach_goal(grounding.successor(state, action), remaining - 1)
    ]


def _pad_rows(column: np.ndarray, padding: int) -> np.ndarray:
    """Return an array with so many rows of zeros behind it."""
    return np.pad(column, [(0, padding), *[(0, 0)] * (column.ndim - 1)])


_encode_images = jax.jit(encode_images)


@jax.jit
def _advance_rows(
    parameters: NetworkParameters,
    image_codes: Float[Array, "images dense"],
    hidden: Float[Array, "rows hidden"],
    symbol: Int[Array, " rows"],
    normal: Float[Array, "rows 2"],
    image: Int[Array, " rows"],
    goal_image: Int[Array, " rows"],
) -> tuple[Float[Array, " rows"], Float[Array, "rows hidden"]]:
    """Return the logits of actions and the hidden states after them."""
    symbol_code = encode_symbols(parameters, symbol, normal)
    return advance(
        parameters,
        hidden,
        symbol_code,
        image_codes[image],
        image_codes[goal_image],
    )
