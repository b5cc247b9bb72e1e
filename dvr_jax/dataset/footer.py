"""The footer of a shard: the program and the options that made it, and the scenes that it covers."""

import functools
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec

import dvr_jax
from dvr_jax.errors import DvrError
from dvr_jax.logic import domain_signature
from dvr_jax.runtime.json_text import parse_json

FIRST_SCHEMA = 1
"""The layout of `dvr_jax.dataset.first_layout`, which is still read."""

SCHEMA_VERSION = 2
"""The layout of `dvr_jax.dataset.layout`, which is written."""

PACKAGES = ("jax", "jaxlib", "mujoco", "numpy", "pyarrow")
"""Packages whose versions are written down."""


CHECKSUM = "sha256"
"""How the checksum of a file is computed: see `dvr_jax.dataset.file_checksum`."""


class Footer(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The JSON record under the key `dvr_jax` of the Parquet metadata of a shard."""

    schema: int
    """The layout of the columns: FIRST_SCHEMA or SCHEMA_VERSION."""

    first: int
    """Index of the first scene."""

    stop: int
    """Index of the last scene plus one: all scenes in between are complete, also those without a label."""

    labels: int
    """Number of labels."""

    seeds: dict[str, int]
    """The options with the name `seed` or `..._seed`."""

    options: dict[str, Any]
    """The options of the sweep; all shards of a folder have the same."""

    domain: str
    """`domain_signature` of the program that made the labels."""

    versions: dict[str, str]
    """Versions of this package, of Python and of PACKAGES."""

    checksum: str = ""
    """CHECKSUM if the file has one; shards before version 0.10 have none."""


@dataclass(frozen=True, slots=True)
class ShardInfo:
    """The place and the footer of a shard."""

    path: Path
    """The Parquet file."""

    footer: Footer
    """What the file says about itself."""

    @property
    def scenes(self) -> range:
        """Indices of the scenes that the shard covers."""
        return range(self.footer.first, self.footer.stop)

    def __str__(self) -> str:
        return f"{self.path} (scenes {self.footer.first} to {self.footer.stop - 1})"


def make_footer(scenes: range, labels: int, options: Mapping[str, Any]) -> Footer:
    """Make the footer of a shard that is about to be written.

    Args:
        scenes: indices of the scenes.
        labels: number of labels.
        options: options of the sweep; they must be JSON and hold a whole number called `seed`.

    Returns:
        The footer with the versions of this installation.

    Raises:
        DvrError: the options are no JSON, or a seed is no whole number.
    """
    # Written and read once, so that the footer holds what a reader of the file will see.
    try:
        plain = json.loads(json.dumps(dict(options), allow_nan=False, sort_keys=True))
    except (TypeError, ValueError) as error:
        raise DvrError(
            f"the sweep's options {dict(options)} cannot be written as JSON: {error}."
        ) from None

    seeds = {
        name: value for name, value in plain.items() if name == "seed" or name.endswith("_seed")
    }
    for name, value in {"seed": None, **seeds}.items():
        if type(value) is not int:
            raise DvrError(f"the sweep's option {name!r} is {value!r}; valid is a whole number.")

    return Footer(
        schema=SCHEMA_VERSION,
        first=scenes.start,
        stop=scenes.stop,
        labels=labels,
        seeds=seeds,
        options=plain,
        domain=domain_signature(),
        versions=versions(),
        checksum=CHECKSUM,
    )


def encode_footer(footer: Footer) -> bytes:
    """Write a footer as JSON; equal footers give equal bytes."""
    return msgspec.json.encode(footer, order="deterministic")


def decode_footer(text: bytes, path: Path) -> Footer:
    """Read a footer, and require that this package understands the labels that it describes.

    Args:
        text: the JSON text.
        path: the file, for error messages.

    Returns:
        The footer.

    Raises:
        DvrError: the text is broken, or the layout or the domain is another one.
    """
    try:
        schema = parse_json(text)["schema"]
        if schema not in (FIRST_SCHEMA, SCHEMA_VERSION):
            raise DvrError(
                f"{path} is a shard of schema version {schema!r}; valid are {FIRST_SCHEMA} and {SCHEMA_VERSION}."
            )
        footer = msgspec.json.decode(text, type=Footer)
        footer.versions["dvr_jax"]
    except (ValueError, LookupError, TypeError, RecursionError, msgspec.MsgspecError) as error:
        raise DvrError(
            f"{path} has a broken footer ({error}); valid is a shard of dvr_jax.dataset."
        ) from None

    if footer.domain != domain_signature():
        raise DvrError(
            f"{path} was labeled under another symbolic domain (signature {footer.domain}); "
            f"valid is {domain_signature()}: its labels speak of other actions."
        )
    return footer


def require_agreement(infos: list[ShardInfo]) -> None:
    """Require that all options are the same and that no scene is covered twice.

    Args:
        infos: shards of one folder, sorted by scene.

    Raises:
        DvrError: two shards disagree or overlap; the message names both.
    """
    for before, info in pairwise(infos):
        if info.footer.options != before.footer.options:
            difference = _difference(info.footer.options, before.footer.options)
            raise DvrError(
                f"{info.path} and {before.path} come of different sweeps: {difference}; valid is one sweep a folder."
            )
        if info.footer.first < before.footer.stop:
            raise DvrError(
                f"{info} and {before} overlap; valid is each scene in one shard: move one of both away."
            )


def _difference(own: Mapping[str, object], other: Mapping[str, object]) -> str:
    """Name the options in which two sweeps differ."""
    shown: list[str] = []
    for name in sorted(own.keys() | other.keys()):
        in_both = name in own and name in other
        if not in_both or own[name] != other[name]:
            shown.append(f"{name} is {own.get(name)!r} and {other.get(name)!r}")
    return ", ".join(shown)


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of the software that makes the labels."""
    found = {"dvr_jax": dvr_jax.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        found[name] = version(name)
    return found
