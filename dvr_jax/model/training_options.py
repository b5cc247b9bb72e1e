"""Options of a training run, which are those of its command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dvr_jax.errors import DvrError
from dvr_jax.model.kind import Kind

_AT_LEAST_ONE = (
    "k_max",
    "steps",
    "batch",
    "batch_scenes",
    "log_every",
    "validate_every",
    "checkpoint_every",
    "validation_sequences",
)
"""Options that are numbers from 1."""

_AT_MOST = {"k_max": 50, "batch": 65_536, "batch_scenes": 65_536}
"""Largest values of some of them; more takes more memory than any machine has."""

LARGEST_NUMBER = 1_000_000_000
"""Largest value of the others."""


@dataclass(frozen=True)
class TrainOptions:
    """Train the network on labelled sequences; the defaults are the paper's where it states them.

    A training that was stopped goes on from its last checkpoint when the same command is given again."""

    data: tuple[Path, ...]
    """Files of labelled sequences, or folders of them."""

    out: Path
    """Folder for everything that is written; a run in it that was cut short is continued."""

    kind: Kind = "dvr"
    """dvr: predict whether each action is promising for the goal; classifier: whether the sequence so far is
    feasible."""

    validation: tuple[Path, ...] = ()
    """Held-out sequences; without them, a fraction of the scenes of --data is held out."""

    held_out: float = 0.1
    """Fraction of the scenes that is held out."""

    k_max: int = 6
    """Largest number of actions; longer sequences of the data are left out."""

    completions: int = 3
    """Number of sequences that are drawn for each refuted prefix among those that begin with it."""

    steps: int = 100_000
    """Number of batches to train on."""

    cooldown: int = 0
    """Number of steps before the end in which the learning rate falls linearly to 0. With 0 the learning rate is
    constant, as in the paper. A run without cooldown can go on with one."""

    image_size: int = 64
    """Height and width of the images in pixels."""

    rays: int = 4
    """Rays to a pixel along either axis, of which a pixel is the mean; with 1, the images are the paper's."""

    normals: bool = True
    """Give the normal of the grasped face with a grasp's symbol; without it, the network is the paper's."""

    pooling: bool = True
    """Give an image's code the strongest responses anywhere in the image; without it, the network is the paper's."""

    learning_rate: float = 5e-4
    """Learning rate of Adam."""

    batch: int = 48
    """Number of sequences in a batch."""

    least_feasible: int = 16
    """Number of these sequences that are drawn from the feasible ones."""

    unknown: float = 0.1
    """Weight of targets of 0 that only mean that nobody has looked. With 1 all targets count alike, as in the paper.
    The targets of a classifier are all known."""

    stratified: bool = True
    """Draw the other sequences evenly by the number of actions after which they are refuted; without it, all sequences
    are drawn evenly."""

    batch_scenes: int = 12
    """Number of distinct scenes in a batch; the fewer, the faster is a step."""

    mirror: bool = True
    """Show the scenes with x and y reversed at random; with x, the arms are exchanged."""

    positive_weight: float | None = None
    """Weight of a target of 1 in the loss; by default zeros and ones weigh the same in the mean."""

    seed: int = 0
    """Seed of the initial parameters and of the order of the data."""

    log_every: int = 100
    """Number of steps between two reports of the loss."""

    validate_every: int = 2_000
    """Number of steps between two measurements on the held-out scenes."""

    checkpoint_every: int = 1_000
    """Number of steps between two checkpoints; a multiple of --log-every."""

    validation_sequences: int = 4_096
    """Largest number of held-out sequences that are predicted."""

    validation_scenes: int = 256
    """Largest number of held-out scenes that are searched greedily."""

    def check(self) -> None:
        """Refuse values that make no sense.

        Raises:
            DvrError: An option has such a value.
        """
        self._check_numbers()
        self._check_weights_and_rates()
        if self.checkpoint_every % self.log_every:
            raise DvrError(
                f"--checkpoint-every is {self.checkpoint_every}; valid is a multiple of --log-every {self.log_every}."
            )

    def learning_rate_at(self, step: int) -> float:
        """Return the learning rate of a step, from 1 to `steps`."""
        steps_left = self.steps + 1 - step
        if steps_left < self.cooldown:
            return self.learning_rate * (steps_left / self.cooldown)
        return self.learning_rate

    def _check_numbers(self) -> None:
        """Refuse numbers of things that make no sense."""
        for name in _AT_LEAST_ONE:
            value = getattr(self, name)
            most = _AT_MOST.get(name, LARGEST_NUMBER)
            if not 1 <= value <= most:
                raise DvrError(f"--{name.replace('_', '-')} is {value}; valid is 1 to {most:,}.")
        # A checkpoint holds the seed as a signed number of 64 bits.
        if not 0 <= self.seed < 2**63:
            raise DvrError(f"--seed is {self.seed}; valid is 0 to 2^63 - 1.")
        if not 0 <= self.cooldown <= self.steps:
            raise DvrError(
                f"--cooldown is {self.cooldown}; valid is 0 to {self.steps}, the --steps."
            )
        if self.validation_scenes < 0:
            raise DvrError(f"--validation-scenes is {self.validation_scenes}; valid is 0 or more.")
        if not 0 <= self.least_feasible <= self.batch:
            raise DvrError(
                f"--least-feasible is {self.least_feasible}; valid is 0 to {self.batch}, the batch."
            )

    def _check_weights_and_rates(self) -> None:
        """Refuse weights and rates that make no sense."""
        if not 0 <= self.unknown <= 1:
            raise DvrError(f"--unknown is {self.unknown}; valid is 0 to 1.")
        for name in ("learning_rate", "positive_weight"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise DvrError(
                    f"--{name.replace('_', '-')} is {value}; valid is a positive number."
                )
