"""Batches of labelled sequences: which scenes are held out, what is drawn at a step, and how it becomes arrays.

A batch shows each distinct action-object image once: its sequences hold indices into the batch's list of images. What
is drawn is a function of the seed and the step alone, so a run that was killed goes on with the same batches.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.logic import Grounding, ground_actions
from dvr_jax.model.checkpoint import Kind
from dvr_jax.model.encoding import TURNED, ActionCodes, encode_actions, goal_tuple
from dvr_jax.model.images import ImageStack
from dvr_jax.scene.types import Scene

IMAGE_BUCKET = 32
"""The images of a batch are padded to a multiple of this, so that few shapes are compiled."""


class ExamplesLike(Protocol):
    """Labelled sequences, as `dvr_jax.dataset.Examples` holds them."""

    @property
    def scenes(self) -> Sequence[Scene]:
        """The distinct scenes."""

    @property
    def scene(self) -> NDArray[np.int32]:
        """Index into `scenes` (n,)."""

    @property
    def actions(self) -> NDArray[np.int32]:
        """Indices into the scene's `Grounding.actions` (n, K); -1 behind the end."""

    @property
    def targets(self) -> NDArray[np.float32]:
        """Whether each step is promising (n, K); 0 behind the end."""

    @property
    def length(self) -> NDArray[np.int32]:
        """Number of actions (n,)."""

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Whether the whole sequence is feasible (n,)."""


class Batch(NamedTuple):
    """B sequences of at most K actions, and the M images they refer to."""

    image_scene: NDArray[np.int32]
    """Scene of each image (M,)."""
    image_pair: NDArray[np.int32]
    """Its two masks (M, 2)."""
    image_turned: NDArray[np.bool_]
    """Whether it is turned by 180 degrees (M,)."""
    goal_image: NDArray[np.int32]
    """Image of the goal's tuple (B,)."""
    symbol: NDArray[np.int32]
    """(B, K)."""
    image: NDArray[np.int32]
    """Image of each action's tuple (B, K)."""
    target: NDArray[np.float32]
    """0 or 1 (B, K)."""
    mask: NDArray[np.float32]
    """1 where a step counts (B, K): before a sequence's end, or (classifier) at its last action and, where it is
    feasible, at all of them."""


@dataclass(frozen=True)
class SceneTable:
    """What batches need of S scenes with at most N objects."""

    depth: jax.Array
    """Normalised depth (S, H, W), on the device."""
    masks: jax.Array
    """0 or 1 (S, N + 2, H, W), on the device."""
    groundings: tuple[Grounding, ...]
    symbol: NDArray[np.int32]
    """By scene and action (S, 12 N)."""
    tuple_index: NDArray[np.int32]
    """By scene and action (S, 12 N)."""
    pairs: NDArray[np.int32]
    """By scene and tuple (S, 2 N, 2)."""
    goal_tuple: NDArray[np.int32]
    """(S,)."""


def scene_table(scenes: Sequence[Scene], images: ImageStack) -> SceneTable:
    """The table of scenes with their images."""
    # Grounding costs more than all the rest of a scene; names and goal repeat among sampled scenes.
    known: dict[tuple[tuple[str, ...], str], Grounding] = {}
    rows: list[tuple[Grounding, ActionCodes]] = []
    for scene in scenes:
        names = tuple(item.name for item in scene.objects)
        if (names, scene.goal.object) not in known:
            known[names, scene.goal.object] = ground_actions(names, scene.goal.object)
        grounding = known[names, scene.goal.object]
        rows.append((grounding, encode_actions(grounding, scene.objects)))
    most = max(len(codes.pairs) for _, codes in rows)
    actions = max(len(codes.symbol) for _, codes in rows)
    symbol, tuple_index = np.zeros((2, len(scenes), actions), np.int32)
    pairs = np.zeros((len(scenes), most, 2), np.int32)
    for i, (_, codes) in enumerate(rows):
        symbol[i, : len(codes.symbol)], tuple_index[i, : len(codes.symbol)] = codes.symbol, codes.tuple_index
        pairs[i, : len(codes.pairs)] = codes.pairs
    return SceneTable(
        jnp.asarray(images.depth),
        jnp.asarray(images.masks),
        tuple(grounding for grounding, _ in rows),
        symbol,
        tuple_index,
        pairs,
        np.array([goal_tuple(scene) for scene in scenes], np.int32),
    )


def check_examples(examples: ExamplesLike, source: str) -> None:
    """Refuse examples that are empty or contradict themselves."""
    number, longest = len(examples.scene), examples.actions.shape[1] if examples.actions.ndim == 2 else 0
    if not number or not longest:
        raise DvrError(f"{source}: there is no labelled sequence; at least one is needed.")
    shapes = {
        "actions": (examples.actions.shape, (number, longest)),
        "targets": (examples.targets.shape, (number, longest)),
        "length": (examples.length.shape, (number,)),
        "feasible": (examples.feasible.shape, (number,)),
    }
    for name, (shape, wanted) in shapes.items():
        if shape != wanted:
            raise DvrError(f"{source}: {name} has shape {shape}; the {number} scene indices ask for {wanted}.")
    counts = np.array([12 * len(scene.objects) for scene in examples.scenes])
    ranges = {"scene": (examples.scene, 0, len(counts) - 1), "length": (examples.length, 1, longest)}
    for name, (values, low, high) in ranges.items():
        if values.min() < low or values.max() > high:
            raise DvrError(f"{source}: {name} goes from {values.min()} to {values.max()}; valid is {low} to {high}.")
    inside = np.arange(longest) < examples.length[:, None]
    wrong = inside & ((examples.actions < 0) | (examples.actions >= counts[examples.scene][:, None]))
    if wrong.any():
        row, step = np.argwhere(wrong)[0]
        last = counts[examples.scene[row]] - 1
        raise DvrError(
            f"{source}: sequence {row} has action {examples.actions[row, step]} at step {step + 1}; "
            f"valid are 0 to {last}."
        )


def held_out_scenes(number: int, fraction: float) -> NDArray[np.bool_]:
    """Which of the scenes 0 to number - 1 are held out: by a hash of the index, so more scenes move none."""
    if not 0 <= fraction < 1:
        raise DvrError(f"the held-out fraction is {fraction}; valid is from 0 to below 1.")
    hashes = [int.from_bytes(hashlib.sha256(f"scene {i}".encode()).digest()[:4]) for i in range(number)]
    return np.array(hashes, np.int64) < fraction * 2**32


def draw_rows(
    rows: NDArray[np.integer], feasible: NDArray[np.integer], batch: int, least_feasible: int, seed: int, step: int
) -> NDArray[np.integer]:
    """The sequences of one batch: `least_feasible` of the feasible ones, the others of all, each uniform and with
    repetition; a function of its arguments."""
    generator = np.random.default_rng([seed, step])
    chosen = [feasible[generator.integers(len(feasible), size=least_feasible)]] if len(feasible) else []
    rest = batch - least_feasible if len(feasible) else batch
    return np.concatenate([*chosen, rows[generator.integers(len(rows), size=rest)]])


def draw_turned(batch: int, seed: int, step: int) -> NDArray[np.bool_]:
    """Which sequences of one batch are shown turned by 180 degrees (B,): the two arms stand opposite each other, so
    what is feasible stays so when they change places."""
    return np.random.default_rng([seed, step, 1]).random(batch) < 0.5


def assemble_batch(
    examples: ExamplesLike,
    table: SceneTable,
    rows: NDArray[np.integer],
    kind: Kind,
    turned: NDArray[np.bool_] | None = None,
) -> Batch:
    """The batch of these sequences, some of them turned (B,) by 180 degrees."""
    turned = np.zeros(len(rows), np.bool_) if turned is None else turned
    scene, actions = np.asarray(examples.scene)[rows], np.asarray(examples.actions)[rows]
    length, steps = np.asarray(examples.length)[rows][:, None], np.arange(actions.shape[1])
    inside = steps < length
    actions = np.where(inside, actions, 0)
    # Padding repeats the goal's tuple: no image is encoded for it.
    tuples = np.where(inside, table.tuple_index[scene[:, None], actions], table.goal_tuple[scene][:, None])
    tuples = np.concatenate([tuples, table.goal_tuple[scene][:, None]], axis=1)
    count = table.pairs.shape[1]
    shown = (2 * scene[:, None].astype(np.int64) + turned[:, None]) * count + tuples
    distinct, place = np.unique(shown, return_inverse=True)
    place = place.reshape(tuples.shape)
    distinct = np.concatenate([distinct, np.repeat(distinct[:1], -len(distinct) % IMAGE_BUCKET)])
    image_scene, image_tuple = np.divmod(distinct, count)
    image_scene, image_turned = np.divmod(image_scene, 2)
    symbol = table.symbol[scene[:, None], actions]
    if kind == "classifier":
        # All prefixes of a feasible sequence are feasible; of an infeasible one only the whole is known to be not.
        target = np.broadcast_to(np.asarray(examples.feasible)[rows][:, None], actions.shape)
        mask = (steps == length - 1) | (target & inside)
    else:
        mask, target = inside, np.asarray(examples.targets)[rows]
    return Batch(
        image_scene.astype(np.int32),
        table.pairs[image_scene, image_tuple],
        image_turned > 0,
        place[:, -1].astype(np.int32),
        np.where(turned[:, None], TURNED[symbol], symbol),
        place[:, :-1].astype(np.int32),
        np.where(mask, target, 0).astype(np.float32),
        mask.astype(np.float32),
    )


def share_of_ones(
    examples: ExamplesLike,
    rows: NDArray[np.integer],
    feasible: NDArray[np.integer],
    least_feasible: float,
    kind: Kind,
) -> float:
    """Expected share of ones among a batch's targets, if a share `least_feasible` of it is drawn of the feasible."""
    length = np.asarray(examples.length)
    if kind == "classifier":
        ones = np.where(examples.feasible, length, 0).astype(float)
        steps = np.where(examples.feasible, length, 1).astype(float)
    else:
        ones, steps = np.asarray(examples.targets).sum(axis=1, dtype=float), length.astype(float)
    parts = [(1 - least_feasible, rows), (least_feasible, feasible)] if len(feasible) else [(1.0, rows)]
    number = sum(weight * steps[part].mean() for weight, part in parts)
    return float(sum(weight * ones[part].mean() for weight, part in parts) / number)
