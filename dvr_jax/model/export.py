"""The exported network: one `.npz` file of parameters with a header that says what they are.

Kind, sizes of the network, signature of the domain, options of the training: what does not fit is refused with the
culprit's name."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import jax
import numpy as np
from flax import traverse_util

from dvr_jax.errors import DvrError
from dvr_jax.files import write_whole
from dvr_jax.model.encoding import input_signature
from dvr_jax.model.network import NetworkConfig, Weights, parameter_shapes

FORMAT = 2

Kind = Literal["dvr", "classifier"]
"""What the network predicts: whether a step is promising, or whether the sequence so far is feasible."""

_HEADER = "header"
"""Name of the header among the arrays of a file."""


@dataclass(frozen=True)
class Header:
    """What a checkpoint is."""

    kind: Kind
    config: NetworkConfig
    domain: str = field(default_factory=input_signature)
    """`encoding.input_signature()` of the code that trained it."""
    training: dict[str, Any] = field(default_factory=dict)
    """Options on which the course of the training depends, by name."""

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return {"format": FORMAT, **asdict(self)}

    @staticmethod
    def from_json(record: Any, source: str) -> Header:
        """The header of a file that this code can use; a DvrError names `source` and what does not fit."""
        try:
            if record["format"] != FORMAT:
                raise DvrError(f"{source}: the format is {record['format']!r}; valid is {FORMAT}.")
            sizes = dict(record["config"])
            header = Header(
                record["kind"],
                NetworkConfig(**{**sizes, "channels": tuple(sizes["channels"])}),
                record["domain"],
                dict(record["training"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise DvrError(f"{source}: the header is incomplete or of another program ({error}).") from None
        if header.kind not in get_args(Kind):
            raise DvrError(f"{source}: the kind is {header.kind!r}; valid: {', '.join(get_args(Kind))}.")
        if header.domain != input_signature():
            raise DvrError(
                f"{source}: it was trained for another symbolic domain (signature {header.domain}); valid is "
                f"{input_signature()}: train again, or use the domain.pddl that it was trained with."
            )
        return header

    def require_same(self, other: Header, source: str) -> None:
        """Refuse to continue from a checkpoint with another header, naming the first difference."""
        mine, theirs = _flat(self), _flat(other)
        for name in sorted(mine.keys() | theirs.keys()):
            if mine.get(name) != theirs.get(name):
                raise DvrError(
                    f"{source}: it was trained with {name} = {theirs.get(name)}, this run has {mine.get(name)}; "
                    "use the same value to continue it, or another --out."
                )


def export_weights(path: Path, weights: Weights, header: Header) -> None:
    """Write parameters and header as one file, whole or not at all."""
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in _flatten(weights.parameters, "/").items()}
    arrays[_HEADER] = np.array(json.dumps(header.to_json()))
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_whole(path, content.getvalue())


def load_weights(path: Path) -> tuple[Weights, Header]:
    """Parameters and header of an exported file, or of the latest checkpoint in a folder."""
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
    header = Header.from_json(record, str(path))
    parameters = traverse_util.unflatten_dict(arrays, sep="/")  # type: ignore[no-untyped-call]
    return checked_weights(parameters, header, str(path)), header


def checked_weights(parameters: Any, header: Header, source: str) -> Weights:
    """Parameters as weights, if their names and shapes are those of the header's network."""
    wanted, found = _flatten(parameter_shapes(header.config), "/"), _flatten(parameters, "/")
    for name in sorted(wanted.keys() | found.keys()):
        shapes = [tuple(tree[name].shape) if name in tree else None for tree in (found, wanted)]
        if shapes[0] != shapes[1]:
            raise DvrError(f"{source}: the array {name} has shape {shapes[0]}; its sizes ask for {shapes[1]}.")
    return Weights(jax.tree.map(lambda value: jax.numpy.asarray(value, "float32"), parameters), header.config)


def _flat(header: Header) -> dict[str, Any]:
    """Header by dotted names, as JSON gives it back."""
    return _flatten(json.loads(json.dumps(header.to_json())), ".")


def _flatten(tree: Any, separator: str) -> dict[str, Any]:
    """Nested dictionaries as one, names joined."""
    return dict(traverse_util.flatten_dict(tree, sep=separator))  # type: ignore[no-untyped-call]
