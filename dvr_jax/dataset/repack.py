"""Repacking: shards of an earlier layout written in the present one, with the same scenes, labels and footers."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from dvr_jax.dataset.folder_manifest import MANIFEST, renew_checksums
from dvr_jax.dataset.footer import CHECKSUM, SCHEMA_VERSION, ShardInfo
from dvr_jax.dataset.shards import list_shards, read_columns, read_shard, same_rows, shard_content
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole


@dataclass(frozen=True, slots=True)
class RepackedShard:
    """A shard that was written anew, and its size."""

    info: ShardInfo
    """Place and new footer."""

    bytes_before: int
    """Size of the file before."""

    bytes_after: int
    """Size of the file now."""


def repack_folder(directory: Path) -> Iterator[RepackedShard]:
    """Write all shards of a folder in the present layout, and renew the checksums of its manifest.

    A process that is killed leaves every shard whole, in the one layout or the other; the same command completes the
    work.

    Args:
        directory: the folder of shards.

    Yields:
        Each shard after it was written.

    Raises:
        DvrError: there is no shard in the folder, or a shard is broken.
    """
    infos = list_shards(directory)
    if not infos:
        raise DvrError(f"there is no shard in {directory}; valid is a folder of shards.")

    for info in infos:
        yield repack_shard(info)
    if (directory / MANIFEST).exists():
        renew_checksums(directory)


def repack_shard(info: ShardInfo) -> RepackedShard:
    """Write a shard in the present layout.

    The footer keeps the versions and options that made the labels; only the number of the layout changes, and a
    checksum is added. The new file is read beside the old one and must hold the same rows before it takes the old
    one's place.

    Args:
        info: place and footer of the shard.

    Returns:
        Place, new footer and sizes.

    Raises:
        DvrError: the shard is broken.
    """
    before = read_shard(info.path)
    bytes_before = info.path.stat().st_size
    footer = msgspec.structs.replace(info.footer, schema=SCHEMA_VERSION, checksum=CHECKSUM)
    content = shard_content(read_columns(info), footer)

    # Written beside the old file, under a name that no reader of the folder looks at.
    trial = info.path.with_name(f".{info.path.name}")
    write_whole(trial, content)
    try:
        if not same_rows(before, read_shard(trial)):
            raise DvrError(f"{info.path} cannot be repacked without loss; it stays as it is.")
        trial.replace(info.path)
    finally:
        trial.unlink(missing_ok=True)
    return RepackedShard(replace(info, footer=footer), bytes_before, len(content))
