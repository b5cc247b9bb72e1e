"""The header of a network: kind, sizes, signature of the domain, options of the training.

Exports and checkpoints carry it; what does not fit is refused with the culprit's name."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

import jax
import numpy as np
from flax import traverse_util

from dvr_jax.errors import DvrError
from dvr_jax.model.encoding import input_signature
from dvr_jax.model.network import NetworkConfig, NetworkParameters, parameter_shapes

FORMAT = 2

Kind = Literal["dvr", "classifier"]
"""What the network predicts: whether a step is promising, or whether the sequence so far is feasible."""


@dataclass(frozen=True)
class NetworkMetadata:
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
    def from_json(record: Any, source: str) -> NetworkMetadata:
        """The header of a file that this code can use; a DvrError names `source` and what does not fit."""
        try:
            if record["format"] != FORMAT:
                raise DvrError(f"the format is {record['format']!r}; valid is {FORMAT}.")
            sizes = dict(record["config"])
            header = NetworkMetadata(
                record["kind"],
                NetworkConfig(**{**sizes, "channels": tuple(sizes["channels"])}),
                record["domain"],
                dict(record["training"]),
            )
        except DvrError as error:
            raise DvrError(f"{source}: {error}") from None
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

    def require_same(self, other: NetworkMetadata, source: str) -> None:
        """Refuse to continue from a checkpoint with another header, naming the first difference."""
        mine, theirs = _flat(self), _flat(other)
        for name in sorted(mine.keys() | theirs.keys()):
            if mine.get(name) != theirs.get(name):
                raise DvrError(
                    f"{source}: it was trained with {name} = {theirs.get(name)}, this run has {mine.get(name)}; "
                    "use the same value to continue it, or another --out."
                )


def check_parameters(parameters: Any, header: NetworkMetadata, source: str) -> NetworkParameters:
    """ParameterTree as weights, if they are finite, with the names and shapes of the header's network."""
    wanted, found = flatten(parameter_shapes(header.config), "/"), flatten(parameters, "/")
    for name in sorted(wanted.keys() | found.keys()):
        shapes = [tuple(tree[name].shape) if name in tree else None for tree in (found, wanted)]
        if shapes[0] != shapes[1]:
            raise DvrError(f"{source}: the array {name} has shape {shapes[0]}; its sizes ask for {shapes[1]}.")
        if found[name].dtype.kind != "f" or not np.isfinite(found[name]).all():
            raise DvrError(f"{source}: the array {name} has values that are not finite numbers; train again.")
    return NetworkParameters(jax.tree.map(lambda value: jax.numpy.asarray(value, "float32"), parameters), header.config)


def _flat(header: NetworkMetadata) -> dict[str, Any]:
    """NetworkMetadata by dotted names, as JSON gives it back."""
    return flatten(json.loads(json.dumps(header.to_json())), ".")


def flatten(tree: Any, separator: str) -> dict[str, Any]:
    """Nested dictionaries as one, names joined."""
    return dict(traverse_util.flatten_dict(tree, sep=separator))  # type: ignore[no-untyped-call]
