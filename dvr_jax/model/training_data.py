"""What a run trains on and is measured on: examples are checked, split, weighed, and their scenes rendered."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from dvr_jax.dataset.examples import Examples
from dvr_jax.errors import DvrError
from dvr_jax.model.batch_sampler import BatchSampler
from dvr_jax.model.encoding import actions_per_object
from dvr_jax.model.image_cache import cached_images
from dvr_jax.model.scene_table import SceneTable, build_scene_table
from dvr_jax.model.training_options import TrainOptions
from dvr_jax.model.validation import FeasibilityOracle, Validation
from dvr_jax.scene.files import scene_to_json
from dvr_jax.scene.types import Scene

Say = Callable[[str], None]
"""Takes a line for the user."""


@dataclass(frozen=True)
class TrainingData:
    """What a run trains on and is measured on."""

    examples: Examples
    """Labelled sequences."""

    table: SceneTable
    """The scenes of the examples."""

    sampler: BatchSampler
    """The sequences that are trained on, and how batches are drawn from them."""

    positive_weight: float
    """Weight of targets of 1 in the loss."""

    validation: Validation | None
    """Held-out sequences and scenes; None if nothing is held out."""

    fingerprint: str
    """Hash of the examples."""


def prepare_training_data(
    options: TrainOptions,
    examples: Examples,
    held_out: Examples | None,
    say: Say = print,
    oracle: FeasibilityOracle | None = None,
) -> TrainingData:
    """Check and split examples, and render their scenes.

    Args:
        options: Options of the run.
        examples: Labelled sequences.
        held_out: Separate held-out sequences; None holds out a fraction of the scenes of `examples`.
        say: Takes a line for the user.
        oracle: Decides about greedy sequences that no label knows as feasible.

    Returns:
        The data of the run.

    Raises:
        DvrError: The options or the examples make no sense.
    """
    options.check()
    examples = _weigh_unknown_targets(examples, options.unknown)
    check_examples(examples, "--data")
    table = _render(examples.scenes, options, options.out / "images.npz", say)

    # Separate held-out sequences leave all others to the training.
    trained = np.arange(len(examples.scene))
    aside = trained[:0]
    if held_out is None:
        trained, aside = _split(examples, options.held_out)

    sampler = BatchSampler.from_examples(
        examples,
        trained,
        options.batch_scenes,
        options.batch,
        options.least_feasible,
        options.stratified,
    )
    positive_weight = options.positive_weight
    if positive_weight is None:
        fraction_of_ones = sampler.fraction_of_ones(examples, options.kind)
        positive_weight = _balancing_weight(fraction_of_ones)

    validation = None
    if held_out is not None:
        held_out = _weigh_unknown_targets(held_out, options.unknown)
        held_out_table = _check_and_render_held_out(options, examples, held_out, say)
        everything = np.arange(len(held_out.scene))
        validation = _validation(
            options, held_out, held_out_table, everything, positive_weight, oracle
        )
    elif len(aside):
        validation = _validation(options, examples, table, aside, positive_weight, oracle)

    return TrainingData(
        examples=examples,
        table=table,
        sampler=sampler,
        positive_weight=positive_weight,
        validation=validation,
        fingerprint=_fingerprint(examples),
    )


def check_examples(examples: Examples, source: str) -> None:
    """Refuse examples that are empty or contradict themselves.

    Args:
        examples: Labelled sequences.
        source: Where they come from, for messages.

    Raises:
        DvrError: There is no example, or an array has a shape or a value that the others do not allow.
    """
    number = len(examples.scene)
    longest = examples.actions.shape[1] if examples.actions.ndim == 2 else 0
    if not number or not longest:
        raise DvrError(f"{source}: there is no labelled sequence; at least one is needed.")

    valid_shapes = {
        "actions": (number, longest),
        "targets": (number, longest),
        "weight": (number, longest),
        "refuted_after": (number,),
        "length": (number,),
        "feasible": (number,),
    }
    for name, valid in valid_shapes.items():
        shape = getattr(examples, name).shape
        if shape != valid:
            raise DvrError(
                f"{source}: {name} has shape {shape}; the {number} scene indices ask for {valid}."
            )

    _check_range("scene", examples.scene, 0, len(examples.scenes) - 1, source)
    _check_range("length", examples.length, 1, longest, source)
    _check_actions(examples, source)


def _check_range(
    name: str,
    values: Int[np.ndarray, " values"],
    low: int,
    high: int,
    source: str,
) -> None:
    """Refuse values outside of a range."""
    if values.min() < low or values.max() > high:
        raise DvrError(
            f"{source}: {name} goes from {values.min()} to {values.max()}; valid is {low} to {high}."
        )


def _check_actions(examples: Examples, source: str) -> None:
    """Refuse actions that the scene of their sequence does not have."""
    number_of_objects = np.array([len(scene.objects) for scene in examples.scenes])
    number_of_actions = (actions_per_object() * number_of_objects)[examples.scene]

    inside = np.arange(examples.actions.shape[1]) < examples.length[:, None]
    valid = (examples.actions >= 0) & (examples.actions < number_of_actions[:, None])
    wrong = inside & ~valid
    if wrong.any():
        row, step = np.argwhere(wrong)[0]
        raise DvrError(
            f"{source}: sequence {row} has action {examples.actions[row, step]} at step {step + 1}; "
            f"valid are 0 to {number_of_actions[row] - 1}."
        )


def held_out_scenes(scenes: Sequence[Scene], fraction: float) -> Bool[np.ndarray, " scenes"]:
    """Decide which scenes are held out, by a hash of each, so that the other scenes do not matter.

    Args:
        scenes: The scenes.
        fraction: Expected fraction of the scenes that is held out, from 0 to below 1.

    Returns:
        Whether each scene is held out.

    Raises:
        DvrError: The fraction is out of range.
    """
    if not 0 <= fraction < 1:
        raise DvrError(f"the held-out fraction is {fraction}; valid is from 0 to below 1.")

    hashes = []
    for scene in scenes:
        digest = hashlib.sha256(scene_to_json(scene).encode()).digest()
        hashes.append(int.from_bytes(digest[:4]))
    return np.array(hashes, np.int64) < fraction * 2**32


def _split(
    examples: Examples,
    fraction: float,
) -> tuple[Int[np.ndarray, " trained"], Int[np.ndarray, " held_out"]]:
    """Return the sequences that are trained on and those whose scenes are held out."""
    is_held_out = held_out_scenes(examples.scenes, fraction)[examples.scene]
    if is_held_out.all():
        raise DvrError(
            f"all {len(examples.scenes)} scenes are held out; give more scenes or a smaller --held-out."
        )
    return np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)


def _weigh_unknown_targets(examples: Examples, weight: float) -> Examples:
    """Return the examples with this weight in place of 0 for targets that are not known."""
    inside = np.arange(examples.actions.shape[1]) < examples.length[:, None]
    weights = np.where(inside, np.where(examples.weight > 0, 1, weight), 0)
    return examples._replace(weight=weights.astype(np.float32))


def _balancing_weight(fraction_of_ones: float) -> float:
    """Return the weight of ones with which ones and zeros weigh the same in the mean."""
    if 0 < fraction_of_ones < 1:
        return (1 - fraction_of_ones) / fraction_of_ones
    return 1.0


def _check_and_render_held_out(
    options: TrainOptions,
    examples: Examples,
    held_out: Examples,
    say: Say,
) -> SceneTable:
    """Return the table of separate held-out scenes, and refuse those that are trained on."""
    check_examples(held_out, "--validation")
    common = set(examples.scenes) & set(held_out.scenes)
    if common:
        raise DvrError(f"--validation has {len(common)} of the scenes of --data; valid are others.")
    return _render(held_out.scenes, options, options.out / "validation_images.npz", say)


def _validation(
    options: TrainOptions,
    examples: Examples,
    table: SceneTable,
    sequences: Int[np.ndarray, " sequences"],
    positive_weight: float,
    oracle: FeasibilityOracle | None,
) -> Validation:
    """Return the validation on these held-out sequences."""
    return Validation.from_examples(
        examples,
        table,
        sequences,
        options.kind,
        positive_weight,
        options.validation_sequences,
        options.validation_scenes,
        oracle,
    )


def _render(
    scenes: Sequence[Scene],
    options: TrainOptions,
    cache: Path,
    say: Say,
) -> SceneTable:
    """Return the table of scenes, with images from the cache if it has them."""
    images = cached_images(scenes, options.image_size, options.rays, cache, say)
    return build_scene_table(scenes, images)


def _fingerprint(examples: Examples) -> str:
    """Return a hash of scenes, sequences and labels."""
    digest = hashlib.sha256(repr(tuple(examples.scenes)).encode())
    for array in examples[1:]:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
