"""Batches of labelled sequences: which scenes are held out, what is drawn at a step, and how it becomes arrays.

A batch shows each distinct action-object image once: its sequences hold indices into the batch's list of images. What
is drawn is a function of the seed and the step alone, so a run that was killed goes on with the same batches.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dvr_jax.dataset import Examples
from dvr_jax.errors import DvrError
from dvr_jax.logic import Grounding
from dvr_jax.model.encoding import MIRRORED, ActionCodes, encode_actions, goal_tuple
from dvr_jax.model.images import ImageStack
from dvr_jax.model.metadata import Kind
from dvr_jax.scene.files import scene_to_json
from dvr_jax.scene.types import Scene

VIEW_BUCKET, IMAGE_BUCKET = 12, 16
"""The shown scenes and the images of a batch are padded to multiples of these, so that few shapes are compiled."""


class Batch(NamedTuple):
    """B sequences of at most K actions, the V views of scenes that they are of, and the M images they refer to."""

    view_scene: NDArray[np.int32]
    """Scene of each view (V,)."""
    view_mirrored: NDArray[np.bool_]
    """Whether its x and its y are reversed (V, 2)."""
    image_view: NDArray[np.int32]
    """View of each image (M,)."""
    image_pair: NDArray[np.int32]
    """Its two masks (M, 2)."""
    goal_image: NDArray[np.int32]
    """Image of the goal's tuple (B,)."""
    symbol: NDArray[np.int32]
    """(B, K)."""
    normal: NDArray[np.float32]
    """(B, K, 2)."""
    image: NDArray[np.int32]
    """Image of each action's tuple (B, K)."""
    target: NDArray[np.float32]
    """0 or 1 (B, K)."""
    mask: NDArray[np.float32]
    """How much a step counts (B, K): as its target weighs; for the classifier 1 where the verdict on the sequence so
    far is known, at all actions of a feasible sequence, else from that on which refutes it."""


@dataclass(frozen=True)
class SceneTable:
    """What batches need of S scenes with at most N objects."""

    height: jax.Array
    """Heights (S, H, W), on the device."""
    masks: jax.Array
    """0 or 1 (S, N + 2, H, W), on the device."""
    groundings: tuple[Grounding, ...]
    symbol: NDArray[np.int32]
    """By scene and action (S, 12 N)."""
    normal: NDArray[np.float32]
    """By scene and action (S, 12 N, 2)."""
    tuple_index: NDArray[np.int32]
    """By scene and action (S, 12 N)."""
    pairs: NDArray[np.int32]
    """By scene and tuple (S, 2 N, 2)."""
    goal_tuple: NDArray[np.int32]
    """(S,)."""


def scene_table(scenes: Sequence[Scene], images: ImageStack) -> SceneTable:
    """The table of scenes with their images."""
    rows: list[tuple[Grounding, ActionCodes]] = []
    for scene in scenes:
        grounding = ground_scene(scene)
        rows.append((grounding, encode_actions(grounding, scene.objects)))
    most = max(len(codes.pairs) for _, codes in rows)
    actions = max(len(codes.symbol) for _, codes in rows)
    symbol, tuple_index = np.zeros((2, len(scenes), actions), np.int32)
    normal = np.zeros((len(scenes), actions, 2), np.float32)
    pairs = np.zeros((len(scenes), most, 2), np.int32)
    for i, (_, codes) in enumerate(rows):
        symbol[i, : len(codes.symbol)], tuple_index[i, : len(codes.symbol)] = codes.symbol, codes.tuple_index
        normal[i, : len(codes.normal)] = codes.normal
        pairs[i, : len(codes.pairs)] = codes.pairs
    return SceneTable(
        jnp.asarray(images.height),
        jnp.asarray(images.masks),
        tuple(grounding for grounding, _ in rows),
        symbol,
        normal,
        tuple_index,
        pairs,
        np.array([goal_tuple(scene) for scene in scenes], np.int32),
    )


def check_examples(examples: Examples, source: str) -> None:
    """Refuse examples that are empty or contradict themselves."""
    number, longest = len(examples.scene), examples.actions.shape[1] if examples.actions.ndim == 2 else 0
    if not number or not longest:
        raise DvrError(f"{source}: there is no labelled sequence; at least one is needed.")
    shapes = {
        "actions": (examples.actions.shape, (number, longest)),
        "targets": (examples.targets.shape, (number, longest)),
        "weight": (examples.weight.shape, (number, longest)),
        "refuted_after": (examples.refuted_after.shape, (number,)),
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


def held_out_scenes(scenes: Sequence[Scene], fraction: float) -> NDArray[np.bool_]:
    """Which scenes (S,) are held out: by a hash of each, so what stands beside it does not matter."""
    if not 0 <= fraction < 1:
        raise DvrError(f"the held-out fraction is {fraction}; valid is from 0 to below 1.")
    hashes = [int.from_bytes(hashlib.sha256(scene_to_json(scene).encode()).digest()[:4]) for scene in scenes]
    return np.array(hashes, np.int64) < fraction * 2**32


@dataclass(frozen=True)
class BatchSampler:
    """What batches are drawn from: the n sequences that are trained on, m of them feasible, by their G scenes.

    A batch draws distinct scenes, each with the same probability; if it is to hold feasible sequences, it draws again
    until a scene has some. The sequences are dealt out evenly to the scenes, the `least_feasible` first ones to those
    that have feasible sequences, and each is drawn, with repetition, from its scene's. So a scene with many labels
    counts no more than another, and there are few images to encode.

    The others are drawn by stratum, each of a scene's as likely as another: how many actions it takes until a sequence
    is refuted, and whether it ends there. Among all sequences of a scene nearly every one is a long continuation of a
    refuted prefix; that the object cannot be put onto an occupied target, which is a sequence of two actions, would
    hardly ever be seen."""

    rows: NDArray[np.integer]
    """Sequences in the order of their scenes and strata (n,)."""
    feasible: NDArray[np.integer]
    """Of these, the feasible ones (m,)."""
    strata: NDArray[np.integer]
    """Where each stratum's part of `rows` begins, and n (T + 1,)."""
    bounds: NDArray[np.integer]
    """Where each scene's part of the strata begins, and T (G + 1,)."""
    feasible_bounds: NDArray[np.integer]
    """The same for `feasible` (G + 1,)."""
    scenes: int
    """Scenes of a batch; at most G."""
    batch: int
    """Sequences of a batch."""
    least_feasible: int
    """Of these, drawn from the feasible ones; 0 if there are none."""

    @staticmethod
    def of(
        examples: Examples,
        rows: NDArray[np.integer],
        scenes: int,
        batch: int,
        least_feasible: int,
        stratified: bool = True,
    ) -> BatchSampler:
        """BatchSampler of these sequences (n,); without strata all sequences of a scene are as likely as each other."""
        scene, refuted = np.asarray(examples.scene), np.asarray(examples.refuted_after)
        stratum = (2 * refuted + (refuted == examples.length)) * stratified
        rows = rows[np.lexsort((stratum[rows], scene[rows]))]
        feasible = rows[np.asarray(examples.feasible)[rows]]
        known = np.unique(scene[rows])
        begins = (np.diff(scene[rows], prepend=-1) != 0) | (np.diff(stratum[rows], prepend=-1) != 0)
        strata = np.append(np.flatnonzero(begins), len(rows))
        bounds = np.append(np.searchsorted(scene[rows[strata[:-1]]], known), len(strata) - 1)
        feasible_bounds = np.append(np.searchsorted(scene[feasible], known), len(feasible))
        least_feasible = least_feasible if len(feasible) else 0
        return BatchSampler(
            rows, feasible, strata, bounds, feasible_bounds, min(scenes, len(known)), batch, least_feasible
        )

    def draw(self, seed: int, step: int) -> NDArray[np.integer]:
        """The sequences of one batch (B,); a function of its arguments."""
        generator = np.random.default_rng([seed, step])
        while True:
            chosen = generator.choice(len(self.bounds) - 1, self.scenes, replace=False)
            solved = chosen[self.feasible_bounds[chosen] < self.feasible_bounds[chosen + 1]]
            if len(solved) or not self.least_feasible:
                break
        first = np.resize(solved, self.least_feasible)
        rest = np.resize(chosen, self.batch - self.least_feasible)
        stratum = generator.integers(self.bounds[rest], self.bounds[rest + 1])
        return np.concatenate(
            [
                self.feasible[generator.integers(self.feasible_bounds[first], self.feasible_bounds[first + 1])],
                self.rows[generator.integers(self.strata[stratum], self.strata[stratum + 1])],
            ]
        )

    def share_of_ones(self, examples: Examples, kind: Kind) -> float:
        """Expected ones among a batch's targets, divided by the expected steps that count."""
        length = np.asarray(examples.length)
        if kind == "classifier":
            ones = np.where(examples.feasible, length, 0).astype(float)
            steps = (length - np.maximum(np.asarray(examples.refuted_after) - 1, 0)).astype(float)
        else:
            ones = np.asarray(examples.targets).sum(axis=1, dtype=float)
            steps = np.asarray(examples.weight).sum(axis=1, dtype=float)
        solved = np.diff(self.feasible_bounds) > 0
        # Scenes with feasible sequences are as likely as each other, and so are those without; batches of the latter
        # alone are drawn again if they are to hold feasible sequences.
        groups, others = len(solved), int((~solved).sum())
        refused = math.comb(others, self.scenes) / math.comb(groups, self.scenes) if self.least_feasible else 0.0
        weight = np.where(solved, 1 / groups / (1 - refused), 0.0)
        weight[~solved] = (1 - weight.sum()) / max(others, 1)
        rest, first = self.batch - self.least_feasible, self.least_feasible * solved / max(solved.sum(), 1)

        def expected(values: NDArray[np.floating]) -> float:
            """Expected sum over a batch of a value of each sequence."""
            of_all = _means(_means(values[self.rows], self.strata), self.bounds)
            of_feasible = _means(values[self.feasible], self.feasible_bounds)
            return float(rest * weight @ of_all + first @ of_feasible)

        return expected(ones) / expected(steps)


def _means(values: NDArray[np.floating], bounds: NDArray[np.integer]) -> NDArray[np.floating]:
    """Mean of each part of values (n,) between bounds (G + 1,); 0 of an empty one."""
    sums = np.append(0.0, np.cumsum(values))[bounds]
    return np.diff(sums) / np.maximum(np.diff(bounds), 1)


def draw_mirrored(scenes: int, seed: int, step: int) -> NDArray[np.bool_]:
    """Of which scenes one batch reverses x and y (S, 2). The two arms stand opposite each other, and but for housings
    at forearm and flange each is its own mirror image: what is feasible stays so."""
    return np.random.default_rng([seed, step, 1]).random((scenes, 2)) < 0.5


def assemble_batch(
    examples: Examples,
    table: SceneTable,
    rows: NDArray[np.integer],
    kind: Kind,
    mirrored: NDArray[np.bool_] | None = None,
) -> Batch:
    """The batch of these sequences (B,), some of the scenes' x and y reversed (S, 2)."""
    scene, actions = np.asarray(examples.scene)[rows], np.asarray(examples.actions)[rows]
    length, steps = np.asarray(examples.length)[rows][:, None], np.arange(actions.shape[1])
    inside = steps < length
    actions = np.where(inside, actions, 0)
    # Padding repeats the goal's tuple: no image is encoded for it.
    tuples = np.where(inside, table.tuple_index[scene[:, None], actions], table.goal_tuple[scene][:, None])
    tuples = np.concatenate([tuples, table.goal_tuple[scene][:, None]], axis=1)
    view_scene, view = np.unique(scene, return_inverse=True)
    count = table.pairs.shape[1]
    distinct, place = np.unique(view[:, None] * count + tuples, return_inverse=True)
    image: NDArray[np.int32] = place.reshape(tuples.shape).astype(np.int32)
    view_scene, distinct = _filled(view_scene, VIEW_BUCKET), _filled(distinct, IMAGE_BUCKET)
    view_mirrored = np.zeros((len(view_scene), 2), np.bool_) if mirrored is None else mirrored[view_scene]
    here = view_mirrored[view][:, None]
    image_view, image_tuple = np.divmod(distinct, count)
    symbol, normal = table.symbol[scene[:, None], actions], table.normal[scene[:, None], actions]
    if kind == "classifier":
        target = np.broadcast_to(np.asarray(examples.feasible)[rows][:, None], actions.shape)
        mask = inside & (steps >= np.asarray(examples.refuted_after)[rows][:, None] - 1)
    else:
        mask, target = np.asarray(examples.weight)[rows], np.asarray(examples.targets)[rows]
    return Batch(
        view_scene.astype(np.int32),
        view_mirrored,
        image_view.astype(np.int32),
        table.pairs[view_scene[image_view], image_tuple],
        image[:, -1],
        MIRRORED[here[..., 0].astype(int), here[..., 1].astype(int), symbol],
        np.where(here, -normal, normal),
        image[:, :-1],
        np.where(mask, target, 0).astype(np.float32),
        mask.astype(np.float32),
    )


def _filled(values: NDArray[np.integer], unit: int) -> NDArray[np.integer]:
    """The values (n,) and the first one again, as often as a multiple of `unit` needs."""
    return np.append(values, np.repeat(values[:1], -len(values) % unit))
