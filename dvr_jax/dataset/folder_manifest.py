"""The file `_manifest.json` of a folder of shards: its contents in numbers and checksums."""

import hashlib
import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from dvr_jax.dataset.counts import count_labels
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.shards import SUFFIX, list_shards
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import read_whole, write_whole
from dvr_jax.runtime.json_text import parse_json

MANIFEST = "_manifest.json"
"""Readers of Parquet folders (pyarrow, pandas, DuckDB's and Spark's) take no file for data whose name begins so."""


def write_manifest(directory: str | Path, command: Sequence[str] | None = None) -> Path:
    """Write `_manifest.json`: command, seeds, options, versions, counts and checksums.

    The file depends on nothing else than the shards and the command, so equal shards give an equal file.

    Args:
        directory: the folder of shards.
        command: the command that made them; by default the command line of this process.

    Returns:
        The path of the file.

    Raises:
        DvrError: there is no shard in the folder, or a shard is broken.
    """
    directory = Path(directory)
    infos = list_shards(directory)
    if not infos:
        raise DvrError(f"there is no shard in {directory}; valid are files *{SUFFIX}.")

    footer = infos[0].footer
    manifest = {
        "command": shlex.join(["python", *sys.orig_argv[1:]] if command is None else command),
        "seeds": footer.seeds,
        "options": footer.options,
        "domain": footer.domain,
        "versions": {name: _versions_of(name, infos) for name in footer.versions},
        "counts": asdict(count_labels(infos)),
        "shards": [_entry(info) for info in infos],
    }
    return _write(directory, manifest)


def renew_checksums(directory: Path) -> None:
    """Write the shards of a folder anew into its `_manifest.json`; nothing else in it changes.

    Raises:
        DvrError: a shard is broken, or the file is no JSON object.
        OSError: there is no such file.
    """
    path = directory / MANIFEST
    try:
        manifest = parse_json(read_whole(path))
    except ValueError as error:
        raise DvrError(f"{path} is no JSON ({error}); move it away to go on without it.") from None
    if not isinstance(manifest, dict):
        raise DvrError(f"{path} is no JSON object; move it away to go on without it.")

    manifest["shards"] = [_entry(info) for info in list_shards(directory)]
    _write(directory, manifest)


def _write(directory: Path, manifest: Mapping[str, object]) -> Path:
    path = directory / MANIFEST
    text = json.dumps(manifest, indent=1, sort_keys=True)
    write_whole(path, (text + "\n").encode())
    return path


def _entry(info: ShardInfo) -> dict[str, object]:
    """Return what the manifest says of one shard."""
    return {
        "file": info.path.name,
        "scenes": [info.footer.first, info.footer.stop],
        "labels": info.footer.labels,
        "sha256": hashlib.sha256(info.path.read_bytes()).hexdigest(),
    }


def _versions_of(name: str, infos: Sequence[ShardInfo]) -> list[str]:
    """Return the versions of a package that made the shards."""
    return sorted({info.footer.versions.get(name, "unknown") for info in infos})
