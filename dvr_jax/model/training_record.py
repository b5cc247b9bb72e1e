"""The record of what a trained network was made from: `manifest.json` beside `network.npz`."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

from dvr_jax.dataset.footer import ShardInfo, versions
from dvr_jax.model.export import load_parameters
from dvr_jax.model.history import read_history
from dvr_jax.model.training_data import TrainingData
from dvr_jax.runtime.files import write_whole


def write_training_record(
    folder: Path,
    data: TrainingData,
    command: Sequence[str],
    shards: Sequence[ShardInfo],
) -> None:
    """Write the record of a finished training.

    It holds the command, the network's metadata and checksum, the versions of the packages, the counts of the data, the
    versions that labelled them, and the last figures on held-out scenes.

    Args:
        folder: Folder of the run, which has `network.npz` and `history.jsonl`.
        data: The data of the run.
        command: Arguments of the training's command line.
        shards: The shards that the data were read from.
    """
    network = folder / "network.npz"
    parameters, metadata = load_parameters(network)
    trained_scenes = np.unique(data.examples.scene[data.sampler.sequences])
    history = read_history(folder / "history.jsonl")
    measured = [record for record in history if "validation/loss" in record]

    record = {
        "command": shlex.join(["python", "-m", "dvr_jax.train", *command]),
        "network": {
            "sha256": hashlib.sha256(network.read_bytes()).hexdigest(),
            **metadata.to_json(),
        },
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(parameters)),
        "versions": versions() | {name: version(name) for name in ("flax", "optax")},
        "counts": {
            "scenes": len(trained_scenes),
            "sequences": len(data.sampler.sequences),
            "feasible": len(data.sampler.feasible),
        },
        "labelled_by": sorted({info.footer.versions["dvr_jax"] for info in shards}),
        "held_out": measured[-1] if measured else None,
    }
    text = json.dumps(record, indent=1) + "\n"
    write_whole(folder / "manifest.json", text.encode())
