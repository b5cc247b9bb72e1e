"""The exported network: one `.npz` file with the parameters and the metadata."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from flax import traverse_util

from dvr_jax.errors import DvrError
from dvr_jax.model.metadata import NetworkMetadata, check_parameters, flatten
from dvr_jax.model.network import NetworkParameters
from dvr_jax.runtime.archives import read_arrays
from dvr_jax.runtime.files import write_whole
from dvr_jax.runtime.json_text import parse_json

LARGEST_NETWORK = 1 << 31
"""Bytes of the largest network that is read."""

METADATA_ENTRY = "header"
"""Name of the metadata among the arrays of a file."""


def export_network(
    path: Path,
    parameters: NetworkParameters,
    metadata: NetworkMetadata,
) -> None:
    """Write a network to a file, which is written whole or not at all.

    Args:
        path: The file; missing folders are made.
        parameters: Parameters of the network.
        metadata: Metadata of the network.
    """
    arrays: dict[str, Any] = {}
    for name, value in flatten(parameters.tree, "/").items():
        arrays[name] = np.asarray(value)
    arrays[METADATA_ENTRY] = np.array(json.dumps(metadata.to_json()))

    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_whole(path, content.getvalue())


def load_parameters(path: Path) -> tuple[NetworkParameters, NetworkMetadata]:
    """Read a network from an exported file, or from the latest checkpoint of a training's folder.

    Args:
        path: The file, the folder that a training writes to, or the folder of its checkpoints.

    Returns:
        Parameters and metadata of the network.

    Raises:
        DvrError: There is no network, or this code cannot use it.
    """
    if path.is_dir():
        return _load_latest_checkpoint(path)
    try:
        arrays: dict[str, Any] = read_arrays(path, LARGEST_NETWORK)
        record = parse_json(str(arrays.pop(METADATA_ENTRY)))
    except (ValueError, KeyError) as error:
        raise DvrError(
            f"{path}: this is no exported network ({error}); valid is a file that training has written."
        ) from None

    metadata = NetworkMetadata.from_json(record, str(path))
    tree = traverse_util.unflatten_dict(arrays, sep="/")  # type: ignore[no-untyped-call]
    return check_parameters(tree, metadata, str(path)), metadata


def _load_latest_checkpoint(folder: Path) -> tuple[NetworkParameters, NetworkMetadata]:
    """Return parameters and metadata of the latest checkpoint in a folder."""
    # Imported here, because orbax takes a second to import and plans need not wait for it.
    from dvr_jax.model.checkpoint import CheckpointFolder

    inner = folder / "checkpoints"
    checkpoints = CheckpointFolder(inner if inner.is_dir() else folder)
    try:
        return checkpoints.latest_network()
    finally:
        checkpoints.close()
