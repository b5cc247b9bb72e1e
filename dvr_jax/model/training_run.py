"""A whole training run: options, preparation of the data, and the loop with its reports and checkpoints.

A batch is a function of seed and step, and everything else that a step depends on is in the checkpoint, so a run that
was killed goes on to the same result.
"""

from __future__ import annotations

import hashlib
import io
import time
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import optax

from dvr_jax.dataset import Examples
from dvr_jax.errors import DvrError
from dvr_jax.model.batches import (
    BatchSampler,
    SceneTable,
    assemble_batch,
    check_examples,
    draw_mirrored,
    held_out_scenes,
    scene_table,
)
from dvr_jax.model.checkpoint import CheckpointFolder, TrainingState
from dvr_jax.model.export import export_network
from dvr_jax.model.history import History, save_curves
from dvr_jax.model.images import LARGEST_HEIGHT, UNIT_HEIGHT, WHOLE_PIXEL, ImageStack, scene_images, stack_images
from dvr_jax.model.metadata import Kind, NetworkMetadata
from dvr_jax.model.network import NetworkConfig, NetworkParameters, initial_parameters
from dvr_jax.model.training import ADAM, FeasibilityOracle, Validation, train_step
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.pinhole import SCENE_CAMERA
from dvr_jax.scene.types import Scene

Say = Callable[[str], None]

_UNITS = UNIT_HEIGHT, LARGEST_HEIGHT, WHOLE_PIXEL
"""What the numbers of rendered images mean."""


@dataclass(frozen=True)
class TrainOptions:
    """Train the network on labelled sequences; the defaults are the paper's where it states them.

    A training that was stopped goes on from its last checkpoint when the same command is given again."""

    data: tuple[Path, ...]
    """Files of labelled sequences, or folders of them."""
    out: Path
    """Folder for everything that is written; a run in it that was cut short is continued."""
    kind: Kind = "dvr"
    """dvr: whether each action is promising for the goal; classifier: whether the sequence so far is feasible."""
    validation: tuple[Path, ...] = ()
    """Held-out sequences; without it, a fraction of the scenes of --data is held out."""
    held_out: float = 0.1
    """Fraction of the scenes that is held out."""
    k_max: int = 6
    """Longer sequences of the data are left out."""
    completions: int = 3
    """Sequences drawn among those that begin with a refuted prefix, for each."""
    steps: int = 100_000
    """Batches to train on."""
    cooldown: int = 0
    """Steps before the end in which the learning rate falls evenly to 0; with 0 it is constant, as in the paper. A run
    without cooldown can go on with one."""
    image_size: int = 64
    """Height and width of the images in pixels."""
    rays: int = 4
    """Rays to a pixel along either axis, whose mean it is; with 1, the images are the paper's."""
    normals: bool = True
    """Give the normal of the grasped face with a grasp's symbol; without it, the network is the paper's."""
    pooling: bool = True
    """Give an image's code the strongest responses anywhere in the image; without it, the network is the paper's."""
    learning_rate: float = 5e-4
    """Of Adam."""
    batch: int = 48
    """Sequences in a batch."""
    least_feasible: int = 16
    """Of these, drawn from the feasible ones."""
    unknown: float = 0.1
    """Weight of targets of 0 that only say that nobody has looked; with 1 all targets count alike, as in the paper.
    A classifier's targets are all known."""
    stratified: bool = True
    """Draw the others evenly by the number of actions after which they are refuted; without it, from all evenly."""
    batch_scenes: int = 12
    """Distinct scenes in a batch; the fewer, the faster is a step."""
    mirror: bool = True
    """Show the scenes with x and y reversed at random, with x the arms exchanged."""
    positive_weight: float | None = None
    """Weight of a target of 1 in the loss; by default zeros and ones weigh the same in the mean."""
    seed: int = 0
    """Of the initial parameters and of the order of the data."""
    log_every: int = 100
    """Steps between two reports of the loss."""
    validate_every: int = 2_000
    """Steps between two looks at the held-out scenes."""
    checkpoint_every: int = 1_000
    """Steps between two checkpoints; a multiple of --log-every."""
    validation_sequences: int = 4_096
    """At most so many held-out sequences are predicted."""
    validation_scenes: int = 256
    """At most so many held-out scenes are searched greedily."""

    def check(self) -> None:
        """Refuse values that make no sense."""
        for name in (
            "steps",
            "batch",
            "batch_scenes",
            "log_every",
            "validate_every",
            "checkpoint_every",
            "validation_sequences",
        ):
            if getattr(self, name) < 1:
                raise DvrError(f"--{name.replace('_', '-')} is {getattr(self, name)}; valid is 1 or more.")
        if not 0 <= self.seed < 2**63:  # what a checkpoint can hold
            raise DvrError(f"--seed is {self.seed}; valid is 0 to 2^63 - 1.")
        if not 0 <= self.cooldown <= self.steps:
            raise DvrError(f"--cooldown is {self.cooldown}; valid is 0 to {self.steps}, the --steps.")
        if self.validation_scenes < 0:
            raise DvrError(f"--validation-scenes is {self.validation_scenes}; valid is 0 or more.")
        if not 0 <= self.least_feasible <= self.batch:
            raise DvrError(f"--least-feasible is {self.least_feasible}; valid is 0 to {self.batch}, the batch.")
        if not 0 <= self.unknown <= 1:
            raise DvrError(f"--unknown is {self.unknown}; valid is 0 to 1.")
        for name, value in (("learning-rate", self.learning_rate), ("positive-weight", self.positive_weight)):
            if value is not None and not 0 < value < float("inf"):
                raise DvrError(f"--{name} is {value}; valid is a positive number.")
        if self.checkpoint_every % self.log_every:
            raise DvrError(
                f"--checkpoint-every is {self.checkpoint_every}; valid is a multiple of --log-every {self.log_every}."
            )


@dataclass(frozen=True)
class TrainingData:
    """What a run trains on and is measured on."""

    examples: Examples
    table: SceneTable
    sampler: BatchSampler
    """Sequences that are trained on."""
    positive_weight: float
    validation: Validation | None
    fingerprint: str
    """Hash of the examples."""


def prepare(
    options: TrainOptions,
    examples: Examples,
    held_out: Examples | None,
    say: Say = print,
    judge: FeasibilityOracle | None = None,
) -> TrainingData:
    """Check, split, render; `held_out` are separate held-out examples, and the judge is asked about greedy sequences of
    which labels say nothing."""
    options.check()
    examples = _weigh_unknown(examples, options.unknown)
    held_out = None if held_out is None else _weigh_unknown(held_out, options.unknown)
    check_examples(examples, "--data")
    table = _table(examples.scenes, options, options.out / "images.npz", say)
    rows = np.arange(len(examples.scene))
    validation_rows = rows[:0]
    if held_out is None:
        aside = held_out_scenes(examples.scenes, options.held_out)[examples.scene]
        rows, validation_rows = rows[~aside], rows[aside]
        if not len(rows):
            raise DvrError(f"all {len(examples.scenes)} scenes are held out; give more scenes or a smaller --held-out.")
    sampler = BatchSampler.of(
        examples, rows, options.batch_scenes, options.batch, options.least_feasible, options.stratified
    )
    weight = options.positive_weight
    if weight is None:
        share = sampler.share_of_ones(examples, options.kind)
        weight = (1 - share) / share if 0 < share < 1 else 1.0
    limits = options.kind, weight, options.validation_sequences, options.validation_scenes
    validation = None
    if held_out is not None:
        check_examples(held_out, "--validation")
        if seen := set(examples.scenes) & set(held_out.scenes):
            raise DvrError(f"--validation has {len(seen)} of the scenes of --data; valid are others.")
        other = _table(held_out.scenes, options, options.out / "validation_images.npz", say)
        validation = Validation.of(held_out, other, np.arange(len(held_out.scene)), *limits, judge)
    elif len(validation_rows):
        validation = Validation.of(examples, table, validation_rows, *limits, judge)
    return TrainingData(examples, table, sampler, weight, validation, _fingerprint(examples))


def train(options: TrainOptions, data: TrainingData, network: NetworkConfig, say: Say = print) -> NetworkParameters:
    """Train from the start or from the latest checkpoint in `options.out`; returns the last weights."""
    checkpoints = CheckpointFolder(options.out / "checkpoints")
    weights = initial_parameters(network, options.seed)
    state = TrainingState(weights, ADAM.init(weights.tree), 0, options.seed)
    latest = checkpoints.latest()
    if latest is not None:
        if latest > options.steps:
            raise DvrError(f"--steps is {options.steps}; the run in {options.out} is already at step {latest}.")
        state = checkpoints.restore(state, _header(options, data, network, latest))
        say(f"continues at step {state.step}")
    weights, optimizer = state.weights, state.optimizer
    positive = jnp.float32(data.positive_weight)
    with History(options.out, state.step) as history:
        losses, clock = [], time.monotonic()
        for step in range(state.step + 1, options.steps + 1):
            rows = data.sampler.draw(options.seed, step)
            mirrored = draw_mirrored(len(data.examples.scenes), options.seed, step) if options.mirror else None
            batch = assemble_batch(data.examples, data.table, rows, options.kind, mirrored)
            rate = jnp.float32(_learning_rate(options, step))
            weights, optimizer, loss = train_step(
                weights, optimizer, data.table.height, data.table.masks, batch, rate, positive
            )
            losses.append(loss)
            if step % options.log_every == 0:
                mean = float(np.mean(jnp.stack(losses)))
                speed = len(losses) / (time.monotonic() - clock)
                _require_finite("loss", mean, step)
                history.add(step, "train", {"loss": mean})
                say(f"step {step:>7}  loss {mean:.4f}  {speed:.1f} steps/s")
                losses, clock = [], time.monotonic()
            if data.validation is not None and (step % options.validate_every == 0 or step == options.steps):
                figures = data.validation.measure(weights)
                history.add(step, "validation", figures)
                say(f"step {step:>7}  held out: " + "  ".join(f"{name} {value:.4f}" for name, value in figures.items()))
                clock = time.monotonic()
            if step % options.checkpoint_every == 0 or step == options.steps:
                _require_finite("norm of the weights", float(optax.tree.norm(weights.tree)), step)
                state = TrainingState(weights, optimizer, step, options.seed)
                checkpoints.save(state, _header(options, data, network, step))
        records = history.records
    checkpoints.close()
    export_network(options.out / "network.npz", weights, _header(options, data, network, options.steps))
    if not save_curves(options.out / "curves.png", records):
        say("no curves.png: matplotlib is not installed (pip install '.[plots]' in the repository)")
    return weights


def _learning_rate(options: TrainOptions, step: int) -> float:
    """Of step 1 to `options.steps`."""
    left = options.steps + 1 - step
    return options.learning_rate * (left / options.cooldown if left < options.cooldown else 1.0)


def _require_finite(name: str, value: float, step: int) -> None:
    if not np.isfinite(value):
        raise DvrError(f"the {name} is {value} at step {step}; a smaller --learning-rate may help.")


def _weigh_unknown(examples: Examples, weight: float) -> Examples:
    """The examples, where targets that are not known have this weight in place of 0."""
    inside = np.arange(examples.actions.shape[1]) < examples.length[:, None]
    weights = np.where(inside, np.where(examples.weight > 0, 1, weight), 0)
    return examples._replace(weight=weights.astype(np.float32))


def _header(options: TrainOptions, data: TrainingData, network: NetworkConfig, step: int) -> NetworkMetadata:
    """What the run is after a step: with all on which its course up to there depends. That is not when it ends, unless
    the learning rate has begun to fall towards it."""
    names = ("learning_rate", "batch", "least_feasible", "unknown", "stratified", "batch_scenes", "mirror", "seed")
    course: dict[str, Any] = {
        **{name: getattr(options, name) for name in names},
        "positive_weight": data.positive_weight,
        "held_out": "separate" if options.validation else options.held_out,
        "data": data.fingerprint,
    }
    if _learning_rate(options, step) < options.learning_rate:
        course["cooldown"] = f"{options.cooldown} of {options.steps} steps"
    return NetworkMetadata(options.kind, network, training=course)


def _fingerprint(examples: Examples) -> str:
    """Hash of scenes, sequences and labels."""
    digest = hashlib.sha256(repr(tuple(examples.scenes)).encode())
    for array in examples[1:]:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _table(scenes: Sequence[Scene], options: TrainOptions, cache: Path, say: Say) -> SceneTable:
    """Table of the scenes; their images are read from `cache` if they are there, else rendered and kept there."""
    chosen = options.image_size, options.rays
    key = hashlib.sha256(repr((tuple(scenes), chosen, SCENE_CAMERA, _UNITS)).encode()).hexdigest()
    images = _read_images(cache, key)
    if images is None:
        say(f"rendering {len(scenes)} scenes")
        most = max(len(scene.objects) for scene in scenes)
        images = stack_images([scene_images(scene, *chosen) for scene in scenes], most)
        cache.parent.mkdir(parents=True, exist_ok=True)
        content = io.BytesIO()
        np.savez_compressed(content, key=np.array(key), height=images.height, masks=images.masks)
        write_whole(cache, content.getvalue())
    return scene_table(scenes, images)


def _read_images(cache: Path, key: str) -> ImageStack | None:
    """Images kept under this key; None where there are none."""
    try:
        with np.load(cache, allow_pickle=False) as file:
            return ImageStack(file["height"], file["masks"]) if str(file["key"]) == key else None
    except (FileNotFoundError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
