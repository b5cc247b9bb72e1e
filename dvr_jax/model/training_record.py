"""What a trained network comes of: `manifest.json` beside `network.npz`."""

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
from dvr_jax.model.training_run import TrainingData
from dvr_jax.runtime.files import write_whole


def write_training_record(folder: Path, data: TrainingData, command: Sequence[str], shards: Sequence[ShardInfo]) -> None:
    """Command, options, versions, counts of the data and the versions that labelled them, the last figures on held-out
    scenes, and the checksum."""
    network = folder / "network.npz"
    weights, header = load_parameters(network)
    drawn, examples = data.sampler.rows, data.examples
    trained = np.unique(examples.scene[drawn])
    measured = [record for record in read_history(folder / "history.jsonl") if "validation/loss" in record]
    manifest = {
        "command": shlex.join(["python", "-m", "dvr_jax.train", *command]),
        "network": {"sha256": hashlib.sha256(network.read_bytes()).hexdigest(), **header.to_json()},
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(weights.tree)),
        "versions": versions() | {name: version(name) for name in ("flax", "optax")},
        "counts": {
            "scenes": len(trained),
            "sequences": len(drawn),
            "feasible": len(data.sampler.feasible),
        },
        "labelled_by": sorted({info.footer.versions["dvr_jax"] for info in shards}),
        "held_out": measured[-1] if measured else None,
    }
    write_whole(folder / "manifest.json", (json.dumps(manifest, indent=1) + "\n").encode())
