"""Checkpoints of a training run; no other file uses orbax-checkpoint.

A checkpoint holds the parameters, the optimizer's state, the number of steps done, the seed of the order of the data
and the metadata of the network (`dvr_jax.model.metadata`). A batch is a function of seed and step, so these two are
the whole state of that order.

A checkpoint that is damaged is passed over: the latest one that is as it was written counts.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optax
import orbax.checkpoint as ocp

from dvr_jax.errors import DvrError
from dvr_jax.model.checkpoint_files import SEAL, damage_of, seal_folder, set_aside
from dvr_jax.model.metadata import NetworkMetadata, check_parameters
from dvr_jax.model.network import NetworkParameters, initial_parameters

# Names of a checkpoint's parts on disk.
_METADATA = "header"
_PARAMETERS = "parameters"
_REST = "rest"


@dataclass(frozen=True)
class TrainingState:
    """Everything from which a run continues."""

    parameters: NetworkParameters
    """Parameters of the network."""

    optimizer: optax.OptState
    """The optimizer's tree of arrays."""

    step: int
    """Number of steps done."""

    seed: int
    """Seed of the order of the data."""

    def arrays_beside_parameters(self) -> dict[str, Any]:
        """Return everything but the parameters as one tree of arrays."""
        return {
            "optimizer": self.optimizer,
            "order": np.array([self.seed, self.step], np.int64),
        }


class CheckpointFolder:
    """The checkpoints of one run; a checkpoint is there whole or not at all, and a damaged one does not count."""

    def __init__(self, folder: Path, keep: int = 2) -> None:
        """Open the folder, or make it.

        Args:
            folder: The folder.
            keep: Number of checkpoints that stay when further ones are written.
        """
        # Orbax reports every file that it writes.
        logging.getLogger("absl").setLevel(logging.CRITICAL)
        self.folder = folder
        self._keep = keep
        self._manager: Any = None
        folder.mkdir(parents=True, exist_ok=True)

    def latest(self) -> int | None:
        """Return the step of the latest checkpoint that is not damaged, or None if there is no checkpoint at all.

        Raises:
            DvrError: There are checkpoints, and all are damaged.
        """
        steps = sorted(self._steps(), reverse=True)
        for step in steps:
            if self._damage(step) is None:
                return step

        if steps:
            raise DvrError(
                f"{self._name(steps[0])}: {self._damage(steps[0])}, and no other checkpoint is intact; valid is a "
                "folder with an intact one, or a new folder."
            )
        return None

    def set_damaged_aside(self) -> list[str]:
        """Rename the damaged checkpoints behind the latest intact one, so that training can write their steps again.

        Returns:
            One sentence for each.
        """
        latest = self.latest()
        sentences = []
        for step in sorted(self._steps()):
            if latest is not None and step > latest:
                damage = self._damage(step)
                place = set_aside(self._folder_of(step))
                sentences.append(f"{self._name(step)}: {damage}; it is now {place.name}")

        return sentences

    def save(self, state: TrainingState, metadata: NetworkMetadata) -> None:
        """Write a checkpoint.

        Args:
            state: State of the training.
            metadata: Metadata of the network at this step.
        """
        parts = ocp.args.Composite(
            **{
                _PARAMETERS: ocp.args.StandardSave(state.parameters.tree),
                _REST: ocp.args.StandardSave(state.arrays_beside_parameters()),
                _METADATA: ocp.args.JsonSave({**metadata.to_json(), SEAL: True}),
            }
        )
        self._open_manager().save(state.step, args=parts)
        seal_folder(self._folder_of(state.step))

    def metadata(self, step: int) -> NetworkMetadata:
        """Return the metadata of the checkpoint of a step."""
        parts = self._restore(step, {_METADATA: ocp.args.JsonRestore()})
        return NetworkMetadata.from_json(parts[_METADATA], self._name(step))

    def restore(self, template: TrainingState, metadata: NetworkMetadata) -> TrainingState:
        """Read the latest checkpoint.

        Args:
            template: A state with the same tree of arrays.
            metadata: Metadata of the run that is to continue.

        Returns:
            The state of the training.

        Raises:
            DvrError: There is no checkpoint, it cannot be read, or it belongs to another run.
        """
        step = self._require_latest()
        metadata.require_same(self.metadata(step), self._name(step))

        # Templates of arrays put what is read onto the device of this process, whatever device wrote it.
        parts = self._restore(
            step,
            {
                _PARAMETERS: ocp.args.StandardRestore(template.parameters.tree),
                _REST: ocp.args.StandardRestore(template.arrays_beside_parameters()),
            },
        )
        seed, step = (int(number) for number in parts[_REST]["order"])
        return TrainingState(
            parameters=NetworkParameters(parts[_PARAMETERS], metadata.config),
            optimizer=parts[_REST]["optimizer"],
            step=step,
            seed=seed,
        )

    def latest_network(self) -> tuple[NetworkParameters, NetworkMetadata]:
        """Read parameters and metadata of the latest checkpoint, without the optimizer's state."""
        step = self._require_latest()
        metadata = self.metadata(step)
        template = initial_parameters(metadata.config, 0).tree
        parts = self._restore(step, {_PARAMETERS: ocp.args.StandardRestore(template)})
        return check_parameters(parts[_PARAMETERS], metadata, self._name(step)), metadata

    def close(self) -> None:
        """Release the folder."""
        if self._manager is not None:
            self._manager.close()

    def _require_latest(self) -> int:
        """Return the step of the latest checkpoint, and refuse a folder without any."""
        step = self.latest()
        if step is None:
            raise DvrError(
                f"{self.folder}: there is no checkpoint; valid is a folder that training has written."
            )
        return step

    def _restore(self, step: int, parts: dict[str, Any]) -> Any:
        """Return these parts of a checkpoint."""
        try:
            with ocp.Checkpointer(ocp.CompositeCheckpointHandler()) as checkpointer:
                return checkpointer.restore(self._folder_of(step), args=ocp.args.Composite(**parts))
        except Exception as error:
            # The libraries that read the files raise errors of a dozen kinds.
            reason = str(error).partition("\n")[0]
            raise DvrError(
                f"{self._name(step)}: the checkpoint cannot be read ({reason})."
            ) from None

    def _open_manager(self) -> Any:
        """Return orbax's manager, which writes checkpoints, and reads files of all of them when it is made."""
        if self._manager is None:
            options = ocp.CheckpointManagerOptions(
                max_to_keep=self._keep,
                enable_async_checkpointing=False,
            )
            self._manager = ocp.CheckpointManager(self.folder.absolute(), options=options)
        return self._manager

    def _steps(self) -> list[int]:
        """Return the steps of all checkpoints, damaged or not."""
        names = [path.name for path in self.folder.iterdir() if path.is_dir()]
        return [int(name) for name in names if name.isascii() and name.isdecimal()]

    def _folder_of(self, step: int) -> Path:
        """Return the folder of a checkpoint."""
        return self.folder.absolute() / str(step)

    def _damage(self, step: int) -> str | None:
        """Return what is wrong with the files of a checkpoint, or None."""
        folder = self._folder_of(step)
        return damage_of(folder, folder / _METADATA / "metadata")

    def _name(self, step: int) -> str:
        """Return the name of a checkpoint in messages."""
        return f"{self.folder}, step {step}"
