"""The exported network: one `.npz` file of parameters with its header."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from flax import traverse_util

from dvr_jax.errors import DvrError
from dvr_jax.model.metadata import NetworkMetadata, check_parameters, flatten
from dvr_jax.model.network import NetworkParameters
from dvr_jax.runtime.files import write_whole

_HEADER = "header"
"""Name of the header among the arrays of a file."""


def export_network(path: Path, weights: NetworkParameters, header: NetworkMetadata) -> None:
    """Write parameters and header as one file, whole or not at all."""
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in flatten(weights.tree, "/").items()}
    arrays[_HEADER] = np.array(json.dumps(header.to_json()))
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_whole(path, content.getvalue())


def load_parameters(path: Path) -> tuple[NetworkParameters, NetworkMetadata]:
    """ParameterTree and header of an exported file, or of the latest checkpoint in a folder."""
    if path.is_dir():
        # Here and not above: orbax takes a second to import, which plans need not wait for.
        from dvr_jax.model.checkpoint import CheckpointFolder

        inner = path / "checkpoints"
        folder = CheckpointFolder(inner if inner.is_dir() else path)
        try:
            return folder.weights()
        finally:
            folder.close()
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        record = json.loads(str(arrays.pop(_HEADER)))
    except (ValueError, KeyError, EOFError, AttributeError, TypeError, zipfile.BadZipFile):
        raise DvrError(f"{path}: this is no exported network; valid is a file that training has written.") from None
    header = NetworkMetadata.from_json(record, str(path))
    parameters = traverse_util.unflatten_dict(arrays, sep="/")  # type: ignore[no-untyped-call]
    return check_parameters(parameters, header, str(path)), header
