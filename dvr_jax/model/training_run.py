"""The loop of a training run, with its reports and checkpoints.

A batch is a function of seed and step, and everything else that a step depends on is in the checkpoint, so a run that
was killed continues to the same result.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from jaxtyping import Float

from dvr_jax.errors import DvrError
from dvr_jax.model.batch_sampler import draw_mirrored
from dvr_jax.model.batches import assemble_batch
from dvr_jax.model.checkpoint import CheckpointFolder, TrainingState
from dvr_jax.model.export import export_network
from dvr_jax.model.history import History, Record, save_curves
from dvr_jax.model.metadata import NetworkMetadata
from dvr_jax.model.network import NetworkParameters, initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.training import ADAM, train_step
from dvr_jax.model.training_data import Say, TrainingData
from dvr_jax.model.training_options import TrainOptions

_COURSE_OPTIONS = (
    "learning_rate",
    "batch",
    "least_feasible",
    "unknown",
    "stratified",
    "batch_scenes",
    "mirror",
    "seed",
)
"""Options on which the course of a training depends."""


def train(
    options: TrainOptions,
    data: TrainingData,
    config: NetworkConfig,
    say: Say = print,
    reach: Callable[[int], None] | None = None,
) -> NetworkParameters:
    """Train from the start, or from the latest checkpoint in `options.out`.

    The folder `options.out` then has the network, the checkpoints, the history and the curves.

    Args:
        options: Options of the run.
        data: Data of the run.
        config: Sizes of the network.
        say: Takes a line for the user.
        reach: Takes the number of each step that is done.

    Returns:
        The parameters after the last step.

    Raises:
        DvrError: The checkpoint belongs to another run, or the loss is no longer finite.
    """
    checkpoints = CheckpointFolder(options.out / "checkpoints")
    state = _initial_state(options, data, config, checkpoints, say)

    with History(options.out, state.step) as history:
        report = _Report(options, history, say)
        for step in range(state.step + 1, options.steps + 1):
            state, loss = _train_on_batch(options, data, state, step)
            report.add_loss(step, loss)
            if reach is not None:
                reach(step)

            if data.validation is not None and _is_due(step, options.validate_every, options.steps):
                report.add_validation(step, data.validation.measure(state.parameters))
            if _is_due(step, options.checkpoint_every, options.steps):
                _save_checkpoint(checkpoints, state, _metadata(options, data, config, step))

    checkpoints.close()
    metadata = _metadata(options, data, config, options.steps)
    export_network(options.out / "network.npz", state.parameters, metadata)
    _draw_curves(options, history.records, say)
    return state.parameters


class _Report:
    """Records losses and figures of the validation, and tells the user."""

    def __init__(self, options: TrainOptions, history: History, say: Say) -> None:
        self._log_every = options.log_every
        self._history = history
        self._say = say
        self._losses: list[Float[Array, ""]] = []
        self._clock = time.monotonic()

    def add_loss(self, step: int, loss: Float[Array, ""]) -> None:
        """Take the loss of a step; the mean is reported every few steps."""
        self._losses.append(loss)
        if step % self._log_every:
            return

        mean = float(np.mean(jnp.stack(self._losses)))
        speed = len(self._losses) / (time.monotonic() - self._clock)
        _require_finite("loss", mean, step)
        self._history.add(step, "train", {"loss": mean})
        self._say(f"step {step:>7}  loss {mean:.4f}  {speed:.1f} steps/s")
        self._losses = []
        self._clock = time.monotonic()

    def add_validation(self, step: int, figures: Mapping[str, float]) -> None:
        """Report figures of the validation, whose time does not count as that of steps."""
        self._history.add(step, "validation", figures)
        words = "  ".join(f"{name} {value:.4f}" for name, value in figures.items())
        self._say(f"step {step:>7}  held out: {words}")
        self._clock = time.monotonic()


def _initial_state(
    options: TrainOptions,
    data: TrainingData,
    config: NetworkConfig,
    checkpoints: CheckpointFolder,
    say: Say,
) -> TrainingState:
    """Return the state of the latest checkpoint, or that of a new run."""
    parameters = initial_parameters(config, options.seed)
    optimizer = ADAM.init(parameters.tree)
    state = TrainingState(parameters, optimizer, step=0, seed=options.seed)

    latest = checkpoints.latest()
    if latest is None:
        return state

    if latest > options.steps:
        raise DvrError(
            f"--steps is {options.steps}; the run in {options.out} is already at step {latest}."
        )
    for sentence in checkpoints.set_damaged_aside():
        say(sentence)
    state = checkpoints.restore(state, _metadata(options, data, config, latest))
    say(f"continues at step {state.step}")
    return state


def _train_on_batch(
    options: TrainOptions,
    data: TrainingData,
    state: TrainingState,
    step: int,
) -> tuple[TrainingState, Float[Array, ""]]:
    """Return the state after a step and the loss before it; the arrays of the old state are consumed."""
    sequences = data.sampler.draw(options.seed, step)
    mirrored = None
    if options.mirror:
        mirrored = draw_mirrored(len(data.examples.scenes), options.seed, step)
    batch = assemble_batch(data.examples, data.table, sequences, options.kind, mirrored)

    parameters, optimizer, loss = train_step(
        state.parameters,
        state.optimizer,
        data.table.height,
        data.table.masks,
        batch,
        jnp.float32(options.learning_rate_at(step)),
        jnp.float32(data.positive_weight),
    )
    return TrainingState(parameters, optimizer, step, options.seed), loss


def _is_due(step: int, every: int, last_step: int) -> bool:
    """Return whether something happens at a step that happens every few steps and at the last one."""
    return step % every == 0 or step == last_step


def _save_checkpoint(
    checkpoints: CheckpointFolder,
    state: TrainingState,
    metadata: NetworkMetadata,
) -> None:
    """Write a checkpoint, unless the parameters are no longer finite."""
    norm = float(optax.tree.norm(state.parameters.tree))
    _require_finite("norm of the parameters", norm, state.step)
    checkpoints.save(state, metadata)


def _require_finite(name: str, value: float, step: int) -> None:
    """Refuse to go on with a number that is not finite."""
    if not np.isfinite(value):
        raise DvrError(f"the {name} is {value} at step {step}; a smaller --learning-rate may help.")


def _metadata(
    options: TrainOptions,
    data: TrainingData,
    config: NetworkConfig,
    step: int,
) -> NetworkMetadata:
    """Return the metadata of the network after a step, with everything on which the course up to there depends.

    The number of steps is part of it only once the learning rate falls towards the last step, so that a run can be
    made longer before.
    """
    course: dict[str, Any] = {name: getattr(options, name) for name in _COURSE_OPTIONS}
    course["positive_weight"] = data.positive_weight
    course["held_out"] = "separate" if options.validation else options.held_out
    course["data"] = data.fingerprint
    if options.learning_rate_at(step) < options.learning_rate:
        course["cooldown"] = f"{options.cooldown} of {options.steps} steps"
    return NetworkMetadata(options.kind, config, training=course)


def _draw_curves(options: TrainOptions, records: list[Record], say: Say) -> None:
    """Draw the curves of the run, if matplotlib is installed."""
    if not save_curves(options.out / "curves.png", records):
        say("no curves.png: matplotlib is not installed (pip install '.[plots]' in the repository)")
