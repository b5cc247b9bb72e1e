"""What a shard says about itself in its footer: what made it, with which options, and which scenes it covers."""

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

SCHEMA_VERSION = 1
"""Counts up whenever a reader of the old files would misread the new ones."""

PACKAGES = ("jax", "jaxlib", "mujoco", "numpy", "pyarrow")
"""Packages whose versions are written down."""


class Footer(msgspec.Struct, frozen=True, kw_only=True):
    """The JSON that lies under the key `dvr_jax` of a shard's Parquet metadata."""

    schema: int
    """SCHEMA_VERSION of the writer."""
    first: int
    """Index of the first scene."""
    stop: int
    """One more than the index of the last scene: all scenes in between are complete, also those without a label."""
    labels: int
    """Number of labels."""
    seeds: dict[str, int]
    """Those options that are called `seed` or `..._seed`."""
    options: dict[str, Any]
    """Of the sweep; all shards of a folder agree in them."""
    domain: str
    """`domain_signature` of the writer."""
    versions: dict[str, str]
    """Of this package, of Python and of PACKAGES."""


@dataclass(frozen=True, slots=True)
class ShardInfo:
    """A shard's place and footer."""

    path: Path
    footer: Footer

    @property
    def scenes(self) -> range:
        """Indices of the scenes that it covers."""
        return range(self.footer.first, self.footer.stop)

    def __str__(self) -> str:
        return f"{self.path} (scenes {self.footer.first} to {self.footer.stop - 1})"


def make_footer(scenes: range, labels: int, options: Mapping[str, Any]) -> Footer:
    """The footer of a shard that is about to be written; options must be JSON and hold a whole number called `seed`."""
    try:
        plain = json.loads(json.dumps(dict(options), allow_nan=False, sort_keys=True))
    except (TypeError, ValueError) as error:
        raise DvrError(f"the sweep's options {dict(options)} cannot be written as JSON: {error}.") from None
    seeds = {name: value for name, value in plain.items() if name == "seed" or name.endswith("_seed")}
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
    )


def decode_footer(text: bytes, path: Path) -> Footer:
    """The footer of the file at `path`, if this package can read what it describes."""
    try:
        schema = json.loads(text)["schema"]
        if schema != SCHEMA_VERSION:
            raise DvrError(f"{path} is a shard of schema version {schema!r}; valid is {SCHEMA_VERSION}.")
        footer = msgspec.json.decode(text, type=Footer)
        footer.versions["dvr_jax"]
    except (ValueError, LookupError, TypeError, msgspec.MsgspecError) as error:
        raise DvrError(f"{path} has a broken footer ({error}); valid is a shard of dvr_jax.dataset.") from None
    if footer.domain != domain_signature():
        raise DvrError(
            f"{path} was labelled under another domain.pddl (signature {footer.domain}); "
            f"valid is {domain_signature()}: its labels speak of other actions."
        )
    return footer


def require_agreement(infos: list[ShardInfo]) -> None:
    """Raise a DvrError unless all options are the same and no scene is covered twice; `infos` are sorted by scene."""
    for before, info in pairwise(infos):
        if info.footer.options != before.footer.options:
            raise DvrError(
                f"{info.path} and {before.path} come of different sweeps: {_difference(info.footer, before.footer)}; "
                "valid is one sweep a folder."
            )
        if info.footer.first < before.footer.stop:
            raise DvrError(f"{info} and {before} overlap; valid is each scene in one shard: remove one of both.")


def _difference(own: Footer, other: Footer) -> str:
    names = [name for name in own.options.keys() | other.options.keys() if not _same_option(own, other, name)]
    shown = [f"{name} is {own.options.get(name)!r} and {other.options.get(name)!r}" for name in sorted(names)]
    return ", ".join(shown)


def _same_option(own: Footer, other: Footer, name: str) -> bool:
    return name in own.options and name in other.options and bool(own.options[name] == other.options[name])


@functools.cache
def versions() -> dict[str, str]:
    """Versions of what makes the labels."""
    return {"dvr_jax": dvr_jax.__version__, "python": platform.python_version()} | {
        name: version(name) for name in PACKAGES
    }
