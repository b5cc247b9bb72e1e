"""What a file of a network says about the network: kind, sizes, signature of the inputs, options of the training.

Exported networks and checkpoints carry these metadata, and what does not fit them is refused with the culprit's name.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
from flax import traverse_util

from dvr_jax.errors import DvrError
from dvr_jax.model.encoding import input_signature
from dvr_jax.model.kind import Kind
from dvr_jax.model.network import NetworkParameters, ParameterTree, parameter_shapes
from dvr_jax.model.network_config import NetworkConfig

FORMAT = 2
"""Version of the files' format."""


@dataclass(frozen=True)
class NetworkMetadata:
    """Description of a network in a file."""

    kind: Kind
    """What the network predicts."""

    config: NetworkConfig
    """Sizes of the network."""

    domain: str = field(default_factory=input_signature)
    """`dvr_jax.model.encoding.input_signature()` of the code that trained the network."""

    training: dict[str, Any] = field(default_factory=dict)
    """Options on which the course of the training depends, by name."""

    def to_json(self) -> dict[str, Any]:
        """Return the metadata as a JSON object."""
        return {"format": FORMAT, **asdict(self)}

    @staticmethod
    def from_json(record: Any, source: str) -> NetworkMetadata:
        """Read metadata that this code can use.

        Args:
            record: A JSON object, as `to_json` gives it.
            source: Name of the file, for messages.

        Returns:
            The metadata.

        Raises:
            DvrError: The record is incomplete, or describes a network that this code cannot use.
        """
        metadata = _parse(record, source)
        if metadata.kind not in get_args(Kind):
            raise DvrError(
                f"{source}: the kind is {metadata.kind!r}; valid: {', '.join(get_args(Kind))}."
            )
        if metadata.domain != input_signature():
            raise DvrError(
                f"{source}: it was trained for another symbolic domain (signature {metadata.domain}); valid is "
                f"{input_signature()}: train again, or use the domain.pddl that it was trained with."
            )
        return metadata

    def require_same(self, other: NetworkMetadata, source: str) -> None:
        """Refuse to continue a training from a checkpoint with other metadata.

        Args:
            other: Metadata of the checkpoint.
            source: Name of the checkpoint, for messages.

        Raises:
            DvrError: The metadata differ; the message names the first difference.
        """
        mine = self._flat()
        theirs = other._flat()
        for name in sorted(mine.keys() | theirs.keys()):
            if mine.get(name) != theirs.get(name):
                raise DvrError(
                    f"{source}: it was trained with {name} = {theirs.get(name)}, this run has {mine.get(name)}; "
                    "use the same value to continue it, or another --out."
                )

    def _flat(self) -> dict[str, Any]:
        """Return the metadata by dotted names, with values as JSON gives them back."""
        return flatten(json.loads(json.dumps(self.to_json())), ".")


def _parse(record: Any, source: str) -> NetworkMetadata:
    """Return the metadata of a JSON object, whatever network it describes."""
    try:
        if record["format"] != FORMAT:
            raise DvrError(f"the format is {record['format']!r}; valid is {FORMAT}.")
        sizes = dict(record["config"])
        sizes["channels"] = tuple(sizes["channels"])
        return NetworkMetadata(
            kind=record["kind"],
            config=NetworkConfig(**sizes),
            domain=record["domain"],
            training=dict(record["training"]),
        )
    except DvrError as error:
        raise DvrError(f"{source}: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise DvrError(
            f"{source}: the metadata are incomplete or of another program ({error})."
        ) from None


def check_parameters(
    tree: ParameterTree,
    metadata: NetworkMetadata,
    source: str,
) -> NetworkParameters:
    """Check that arrays are the parameters of the network that the metadata describe.

    Args:
        tree: Arrays by layer and name.
        metadata: Metadata of the network.
        source: Name of the file, for messages.

    Returns:
        The parameters, as float32 arrays on the device.

    Raises:
        DvrError: An array is missing, superfluous, of another shape, or not finite.
    """
    wanted = flatten(parameter_shapes(metadata.config), "/")
    found = flatten(tree, "/")
    for name in sorted(wanted.keys() | found.keys()):
        shape = tuple(found[name].shape) if name in found else None
        valid = tuple(wanted[name].shape) if name in wanted else None
        if shape != valid:
            raise DvrError(
                f"{source}: the array {name} has shape {shape}; its sizes ask for {valid}."
            )
        if found[name].dtype.kind != "f" or not np.isfinite(found[name]).all():
            raise DvrError(
                f"{source}: the array {name} has values that are not finite numbers; train again."
            )

    on_device = jax.tree.map(lambda value: jnp.asarray(value, "float32"), tree)
    return NetworkParameters(on_device, metadata.config)


def flatten(tree: ParameterTree, separator: str) -> dict[str, Any]:
    """Turn nested dictionaries into one.

    Args:
        tree: Nested dictionaries with strings as keys.
        separator: What joins the keys of a leaf to its name.

    Returns:
        The leaves by name.
    """
    return dict(traverse_util.flatten_dict(tree, sep=separator))  # type: ignore[no-untyped-call]
