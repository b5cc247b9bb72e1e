"""Which sequences a batch of the training holds: a function of the seed and the step alone.

A run that was killed therefore goes on with the same batches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.dataset.examples import Examples
from dvr_jax.model.kind import Kind


@dataclass(frozen=True)
class BatchSampler:
    """The sequences that are trained on, by scene and stratum, and how a batch is drawn from them.

    A batch draws distinct scenes, each with the same probability. If it is to hold feasible sequences, it draws again
    until at least one scene has some. The places of a batch are dealt out evenly to its scenes, the first
    `least_feasible` places only to scenes with feasible sequences. Each place then draws, with repetition, a sequence
    of its scene: the first places a feasible one, the others any. A scene with many labels therefore counts as much as
    any other, and there are few images to encode.

    The other places draw a stratum first, all strata of a scene with the same probability. A stratum holds the
    sequences that are refuted after the same number of actions and either all end there or all do not. Nearly all
    sequences of a scene are long continuations of a refuted prefix. Without strata, a batch would hardly ever show that
    an object cannot be placed onto an occupied target, which takes a sequence of two actions.
    """

    sequences: Int[np.ndarray, " sequences"]
    """Indices of the sequences in the examples, in the order of their scenes and strata."""

    feasible: Int[np.ndarray, " feasible"]
    """Indices of the feasible ones among them, in the order of their scenes."""

    stratum_bounds: Int[np.ndarray, " stratum_bounds"]
    """Start of each stratum in `sequences`, and the number of sequences."""

    scene_bounds: Int[np.ndarray, " scene_bounds"]
    """Start of each scene's strata, and the number of strata."""

    feasible_bounds: Int[np.ndarray, " scene_bounds"]
    """Start of each scene's part of `feasible`, and the number of feasible sequences."""

    batch_scenes: int
    """Number of scenes in a batch; at most the number of scenes."""

    batch_size: int
    """Number of sequences in a batch."""

    least_feasible: int
    """Number of places of a batch that draw a feasible sequence; 0 if there are no feasible ones."""

    @staticmethod
    def from_examples(
        examples: Examples,
        sequences: Int[np.ndarray, " sequences"],
        batch_scenes: int,
        batch_size: int,
        least_feasible: int,
        stratified: bool = True,
    ) -> BatchSampler:
        """Sort sequences by scene and stratum.

        Args:
            examples: Labelled sequences.
            sequences: Indices of those that are trained on, in any order.
            batch_scenes: Number of scenes in a batch, if there are as many.
            batch_size: Number of sequences in a batch.
            least_feasible: Number of places of a batch that draw a feasible sequence, if there are any.
            stratified: Whether a scene has strata; without them, all its sequences have the same probability.

        Returns:
            The sampler.
        """
        ends_there = examples.refuted_after == examples.length
        stratum = (2 * examples.refuted_after + ends_there) * stratified

        # A stratum begins wherever scene or stratum change.
        sequences = sequences[np.lexsort((stratum[sequences], examples.scene[sequences]))]
        scene = examples.scene[sequences]
        new_scene = np.diff(scene, prepend=-1) != 0
        new_stratum = np.diff(stratum[sequences], prepend=-1) != 0
        begins = np.flatnonzero(new_scene | new_stratum)
        stratum_bounds = np.append(begins, len(sequences))

        scenes = np.unique(scene)
        feasible = sequences[examples.feasible[sequences]]
        return BatchSampler(
            sequences=sequences,
            feasible=feasible,
            stratum_bounds=stratum_bounds,
            scene_bounds=_group_bounds(scene[begins], scenes),
            feasible_bounds=_group_bounds(examples.scene[feasible], scenes),
            batch_scenes=min(batch_scenes, len(scenes)),
            batch_size=batch_size,
            least_feasible=least_feasible if len(feasible) else 0,
        )

    def draw(self, seed: int, step: int) -> Int[np.ndarray, " batch"]:
        """Draw the sequences of one batch.

        Args:
            seed: Seed of the training.
            step: Number of the training step.

        Returns:
            Indices into the examples, first those of the feasible sequences.
        """
        generator = np.random.default_rng([seed, step])
        scenes, solved = self._draw_scenes(generator)
        of_feasible = np.resize(solved, self.least_feasible)
        of_others = np.resize(scenes, self.batch_size - self.least_feasible)

        stratum = _draw_within(generator, self.scene_bounds, of_others)
        feasible = _draw_within(generator, self.feasible_bounds, of_feasible)
        others = _draw_within(generator, self.stratum_bounds, stratum)
        return np.concatenate([self.feasible[feasible], self.sequences[others]])

    def _draw_scenes(
        self,
        generator: np.random.Generator,
    ) -> tuple[Int[np.ndarray, " scenes"], Int[np.ndarray, " solved"]]:
        """Return the scenes of a batch, and those of them that have feasible sequences."""
        number_of_scenes = len(self.scene_bounds) - 1
        while True:
            scenes = generator.choice(number_of_scenes, self.batch_scenes, replace=False)
            has_feasible = self.feasible_bounds[scenes] < self.feasible_bounds[scenes + 1]
            solved = scenes[has_feasible]
            if len(solved) or not self.least_feasible:
                return scenes, solved

    def fraction_of_ones(self, examples: Examples, kind: Kind) -> float:
        """Return the fraction of ones that the targets of batches have on average.

        Args:
            examples: The examples from which the sampler was made.
            kind: Kind of the network, which decides what the targets are.

        Returns:
            Expected sum of a batch's targets divided by the expected sum of its weights.
        """
        if kind == "classifier":
            first_known = np.maximum(examples.refuted_after - 1, 0)
            ones = np.where(examples.feasible, examples.length, 0).astype(float)
            weights = (examples.length - first_known).astype(float)
        else:
            ones = examples.targets.sum(axis=1, dtype=float)
            weights = examples.weight.sum(axis=1, dtype=float)
        return self._expected_sum(ones) / self._expected_sum(weights)

    def _expected_sum(self, values: Float[np.ndarray, " examples"]) -> float:
        """Return the expected sum over a batch of a value of each sequence."""
        solved = np.diff(self.feasible_bounds) > 0
        feasible_places = self.least_feasible * solved / max(solved.sum(), 1)
        other_places = self.batch_size - self.least_feasible

        of_strata = _group_means(values[self.sequences], self.stratum_bounds)
        of_scenes = _group_means(of_strata, self.scene_bounds)
        of_feasible = _group_means(values[self.feasible], self.feasible_bounds)

        probabilities = self._scene_probabilities(solved)
        return float(other_places * probabilities @ of_scenes + feasible_places @ of_feasible)

    def _scene_probabilities(
        self,
        solved: Bool[np.ndarray, " scenes"],
    ) -> Float[np.ndarray, " scenes"]:
        """Return the probability with which a place that may draw any sequence belongs to each scene.

        Scenes with feasible sequences are equally likely, and so are those without. Batches of the latter alone are
        drawn again if a batch is to hold feasible sequences.
        """
        scenes = len(solved)
        unsolved = int((~solved).sum())

        drawn_again = 0.0
        if self.least_feasible:
            all_unsolved = math.comb(unsolved, self.batch_scenes)
            drawn_again = all_unsolved / math.comb(scenes, self.batch_scenes)

        probabilities = np.where(solved, 1 / scenes / (1 - drawn_again), 0.0)
        probabilities[~solved] = (1 - probabilities.sum()) / max(unsolved, 1)
        return probabilities


def draw_mirrored(scenes: int, seed: int, step: int) -> Bool[np.ndarray, "scenes 2"]:
    """Draw of which scenes one batch reverses x and y.

    The two arms stand opposite each other and each is nearly its own mirror image: the capsules of shoulder, elbow,
    wrist and flange stand to one side. A feasible sequence therefore stays feasible nearly always.

    Args:
        scenes: Number of scenes.
        seed: Seed of the training.
        step: Number of the training step.

    Returns:
        Whether the x and the y of each scene are reversed.
    """
    return np.random.default_rng([seed, step, 1]).random((scenes, 2)) < 0.5


def _draw_within(
    generator: np.random.Generator,
    bounds: Int[np.ndarray, " bounds"],
    groups: Int[np.ndarray, " drawn"],
) -> Int[np.ndarray, " drawn"]:
    """Draw one member of each of these groups, a group being what lies between two bounds."""
    return generator.integers(bounds[groups], bounds[groups + 1])


def _group_bounds(
    group_of_each: Int[np.ndarray, " members"],
    groups: Int[np.ndarray, " groups"],
) -> Int[np.ndarray, " bounds"]:
    """Return the start of each group among sorted members, and the number of members."""
    return np.append(np.searchsorted(group_of_each, groups), len(group_of_each))


def _group_means(
    values: Float[np.ndarray, " members"],
    bounds: Int[np.ndarray, " bounds"],
) -> Float[np.ndarray, " groups"]:
    """Return the mean of each group of values; the mean of an empty group is 0."""
    sums = np.append(0.0, np.cumsum(values))[bounds]
    return np.asarray(np.diff(sums) / np.maximum(np.diff(bounds), 1))
