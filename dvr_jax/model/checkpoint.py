"""Checkpoints of a training run: the only file that calls orbax-checkpoint.

A checkpoint holds parameters, optimiser state, step and the seed of the order of the data (a batch is a function of
seed and step, so the two are the whole state of that order), and the header (`dvr_jax.model.metadata`)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orbax.checkpoint as ocp

from dvr_jax.errors import DvrError
from dvr_jax.model.metadata import NetworkMetadata, check_parameters
from dvr_jax.model.network import NetworkParameters, initial_parameters

_HEADER, _PARAMETERS, _REST = "header", "parameters", "rest"
"""Parts of a checkpoint."""


@dataclass(frozen=True)
class TrainingState:
    """Everything from which a run continues."""

    weights: NetworkParameters
    optimizer: Any
    """The optimiser's tree of arrays."""
    step: int
    """Steps done."""
    seed: int
    """Of the order of the data."""

    def rest(self) -> dict[str, Any]:
        """All but the parameters, as one tree of arrays."""
        return {"optimizer": self.optimizer, "order": np.array([self.seed, self.step], np.int64)}


class CheckpointFolder:
    """The checkpoints of one run; a checkpoint is there whole or not at all."""

    def __init__(self, folder: Path, keep: int = 2) -> None:
        """Open or make the folder; the `keep` latest checkpoints stay."""
        logging.getLogger("absl").setLevel(logging.ERROR)  # orbax reports every file it writes
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        options = ocp.CheckpointManagerOptions(max_to_keep=keep, enable_async_checkpointing=False)
        self._manager = ocp.CheckpointManager(folder.absolute(), options=options)

    def latest(self) -> int | None:
        """Step of the latest checkpoint; None when there is none."""
        return self._manager.latest_step()

    def save(self, state: TrainingState, header: NetworkMetadata) -> None:
        """Write a checkpoint."""
        arguments = {
            _PARAMETERS: ocp.args.StandardSave(state.weights.tree),
            _REST: ocp.args.StandardSave(state.rest()),
            _HEADER: ocp.args.JsonSave(header.to_json()),
        }
        self._manager.save(state.step, args=ocp.args.Composite(**arguments))

    def header(self, step: int) -> NetworkMetadata:
        """What the checkpoint of a step is."""
        read = self._restore(step, **{_HEADER: ocp.args.JsonRestore()})
        return NetworkMetadata.from_json(read[_HEADER], self._name(step))

    def restore(self, template: TrainingState, header: NetworkMetadata) -> TrainingState:
        """The latest checkpoint, if it is one of the run that `header` describes; `template` is a state like it."""
        step = self.latest()
        if step is None:
            raise DvrError(f"{self.folder}: there is no checkpoint; valid is a folder that training has written.")
        header.require_same(self.header(step), self._name(step))
        # Templates of arrays put what is read onto this process' device, whatever device wrote it.
        read = self._restore(
            step,
            **{
                _PARAMETERS: ocp.args.StandardRestore(template.weights.tree),
                _REST: ocp.args.StandardRestore(template.rest()),
            },
        )
        seed, step = (int(number) for number in read[_REST]["order"])
        return TrainingState(NetworkParameters(read[_PARAMETERS], header.config), read[_REST]["optimizer"], step, seed)

    def weights(self) -> tuple[NetworkParameters, NetworkMetadata]:
        """ParameterTree of the latest checkpoint, without the optimiser's state."""
        step = self.latest()
        if step is None:
            raise DvrError(f"{self.folder}: there is no checkpoint; valid is a folder that training has written.")
        header = self.header(step)
        template = initial_parameters(header.config, 0).tree
        read = self._restore(step, **{_PARAMETERS: ocp.args.StandardRestore(template)})
        return check_parameters(read[_PARAMETERS], header, self._name(step)), header

    def close(self) -> None:
        """Let go of the folder."""
        self._manager.close()

    def _restore(self, step: int, **arguments: Any) -> Any:
        try:
            return self._manager.restore(step, args=ocp.args.Composite(**arguments))
        except (ValueError, TypeError, KeyError, FileNotFoundError) as error:
            reason = str(error).partition("\n")[0]
            raise DvrError(f"{self._name(step)}: the checkpoint cannot be read ({reason}).") from None

    def _name(self, step: int) -> str:
        return f"{self.folder}, step {step}"
