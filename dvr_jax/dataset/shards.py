"""Shards: Parquet files of labels, each of a contiguous range of scenes with the scenes themselves.

The columns are those of `dvr_jax.dataset.layout`, compressed with Zstandard, every page with a checksum. Nothing in a
file depends on when or where it was written, so equal sweeps give equal files as long as versions and options are the
same.
"""

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from dvr_jax.dataset import first_layout, layout
from dvr_jax.dataset.columns import Columns, columns_of, labels_in
from dvr_jax.dataset.file_checksum import BLANK, CHECKSUM_KEY, is_sealed, is_whole, seal
from dvr_jax.dataset.footer import (
    CHECKSUM,
    FIRST_SCHEMA,
    Footer,
    ShardInfo,
    decode_footer,
    encode_footer,
    make_footer,
    require_agreement,
)
from dvr_jax.dataset.labels import Label, same_label, sort_labels, validate_labels
from dvr_jax.dataset.sequence_index import sequence_index_of
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import read_whole, write_whole
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.types import Scene

KEY = b"dvr_jax"
"""Key of the footer in the Parquet metadata."""

SUFFIX = ".parquet"
"""End of the name of a shard."""

OWN_NAME = r"labels-\d{6}\.parquet"
"""Names that a sweep gives its shards."""


@dataclass(frozen=True, slots=True)
class Shard:
    """The contents of a shard."""

    info: ShardInfo
    """Place and footer."""

    scenes: tuple[Scene, ...]
    """The scenes of `info.scenes`, in order."""

    labels: tuple[Label, ...]
    """Sorted by scene, length and names; violations are rounded to VIOLATION_BITS binary digits."""


def write_shard(
    path: str | Path,
    scenes: Mapping[int, Scene],
    labels: Sequence[Label],
    options: Mapping[str, Any],
) -> ShardInfo:
    """Write a shard, whole or not at all.

    Args:
        path: the file, with the suffix `.parquet`.
        scenes: indices to scenes; they cover a range without gaps, and all of them are finished, also those without
            labels.
        labels: the labels of these scenes, in any order.
        options: the options of the sweep that its labels depend on (JSON, with the `seed` of the scenes), the same in
            all its shards.

    Returns:
        Place and footer of the shard.

    Raises:
        DvrError: scenes are missing, or labels contradict each other or the logic of their scene; nothing is written.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise DvrError(f"the shard {path} has the suffix {path.suffix!r}; valid is {SUFFIX!r}.")
    covered = range(min(scenes, default=0), max(scenes, default=-1) + 1)
    if not scenes or covered.start < 0 or len(covered) != len(scenes):
        raise DvrError(
            f"the shard's scenes are {sorted(scenes)}; valid are one or more consecutive indices from 0 on."
        )

    ordered = sort_labels(labels)
    for index, group in groupby(ordered, key=lambda label: label.scene):
        labels_of_scene = list(group)
        if index not in scenes:
            raise DvrError(
                f"{labels_of_scene[0]} is of no scene of the shard; valid are {covered.start} to {covered.stop - 1}."
            )
        validate_labels(labels_of_scene, sequence_index_of(scenes[index]))

    footer = make_footer(covered, len(ordered), options)
    texts = [scene_to_json(scenes[index]) for index in covered]
    write_whole(path, shard_content(columns_of(texts, ordered, covered.start), footer))
    return ShardInfo(path, footer)


def shard_content(columns: Columns, footer: Footer) -> bytes:
    """Encode a shard as a Parquet file.

    Args:
        columns: the labels.
        footer: says which scenes they cover and what made them.

    Returns:
        The bytes of the file.
    """
    table = layout.to_table(columns, footer.first)
    sealed = msgspec.structs.replace(footer, checksum=CHECKSUM)
    content = io.BytesIO()
    with pq.ParquetWriter(content, table.schema, **layout.PARQUET_OPTIONS) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({KEY: encode_footer(sealed), CHECKSUM_KEY: BLANK})
    return seal(content.getvalue())


def read_shard(path: str | Path) -> Shard:
    """Read the scenes and labels of a shard.

    Args:
        path: the file.

    Returns:
        Scenes and labels as objects.

    Raises:
        DvrError: the file is broken, or no shard of labels.
        OSError: the file cannot be read.
    """
    info = read_info(path)
    columns = read_columns(info)
    scenes = tuple(
        scene_from_json(text, f"{info.path}, scene {index}")
        for index, text in zip(info.scenes, columns.scene_texts, strict=True)
    )
    return Shard(info, scenes, labels_in(columns, info.footer.first))


def read_info(path: str | Path) -> ShardInfo:
    """Read place and footer of a shard; its labels are not looked at.

    Args:
        path: the file.

    Returns:
        Place and footer.

    Raises:
        DvrError: the file is broken, or no shard of labels.
        OSError: the file cannot be read.
    """
    path = Path(path)
    content = _read_whole_shard(path)
    try:
        schema = pq.read_schema(pa.BufferReader(content))
    except Exception as error:
        # Arrow's own errors are of many kinds, and bytes that are no text are one more.
        raise DvrError(_broken(path, error)) from None

    text = (schema.metadata or {}).get(KEY)
    is_known = any(schema.equals(known) for known in (first_layout.SCHEMA, layout.SCHEMA))
    if text is None or not is_known:
        raise DvrError(
            f"{path} is a Parquet file, but no shard of labels; valid are files of dvr_jax.dataset."
        )

    footer = decode_footer(text, path)
    if footer.checksum and not is_sealed(content):
        raise DvrError(_broken(path, "its checksum is missing"))
    return ShardInfo(path, footer)


def read_columns(info: ShardInfo) -> Columns:
    """Read the labels of a shard as arrays, without an object for each.

    Args:
        info: place and footer of the shard.

    Returns:
        The labels, sorted.

    Raises:
        DvrError: the file is broken.
        OSError: the file cannot be read.
    """
    own_layout = first_layout if info.footer.schema == FIRST_SCHEMA else layout
    content = _read_whole_shard(info.path)
    try:
        table = pq.read_table(pa.BufferReader(content), page_checksum_verification=True)
        table.validate(full=True)
        columns = own_layout.from_table(table)
    except Exception as error:
        raise DvrError(_broken(info.path, error)) from None

    same_scenes = table["scene"].to_pylist() == list(info.scenes)
    same_number = len(columns.bound) == info.footer.labels
    if not (same_scenes and same_number):
        raise DvrError(_broken(info.path, "its rows are not those that its footer announces"))
    return columns


def list_shards(directory: str | Path) -> list[ShardInfo]:
    """List the shards of a folder by scene; gaps between them are scenes yet to come.

    Every `*.parquet` in the folder must be a shard. Other files, hidden ones and subfolders are not looked at.

    Raises:
        DvrError: there is no such folder, a file is no shard, or shards overlap or come of different sweeps.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise DvrError(f"there is no folder {directory}; valid is a folder of shards (*{SUFFIX}).")

    paths = [path for path in sorted(directory.glob(f"*{SUFFIX}")) if not path.name.startswith(".")]
    infos = sorted((read_info(path) for path in paths), key=lambda info: info.footer.first)
    require_agreement(infos)
    return infos


def find_shards(paths: str | Path | Iterable[str | Path]) -> list[ShardInfo]:
    """List the shards that are named, and those of the folders that are named.

    A folder is one sweep; the shards of different sweeps may be learned from together.

    Raises:
        DvrError: there is no shard at all, a file is no shard, or a shard is named twice.
    """
    named = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    infos: list[ShardInfo] = []
    for path in named:
        if not path.exists():
            raise DvrError(
                f"there is no file or folder {path}; valid are shards (*{SUFFIX}) and folders of them."
            )
        infos += list_shards(path) if path.is_dir() else [read_info(path)]
    if not infos:
        where = f"in {', '.join(map(str, named))}" if named else "named"
        raise DvrError(f"there is no shard {where}; valid are files *{SUFFIX} and folders of them.")

    infos.sort(key=lambda info: (str(_folder_of(info)), info.footer.first, info.path.name))
    for before, info in pairwise(infos):
        if _folder_of(info) == _folder_of(before):
            require_agreement([before, info])
    return infos


def same_rows(first: Shard, second: Shard) -> bool:
    """Compare the scenes and labels of two shards, whatever made them and where they lie.

    Args:
        first: one shard.
        second: the other shard.

    Returns:
        True if all scenes and labels are equal, where NaN equals NaN.
    """
    if first.info.scenes != second.info.scenes or first.scenes != second.scenes:
        return False
    if len(first.labels) != len(second.labels):
        return False
    return all(map(same_label, first.labels, second.labels))


def _folder_of(info: ShardInfo) -> Path:
    return info.path.parent.resolve()


def _read_whole_shard(path: Path) -> bytes:
    """Return the content of a file, and refuse one that has not the checksum that it was written with."""
    content = read_whole(path)
    if is_sealed(content) and not is_whole(content):
        raise DvrError(_broken(path, "its checksum is another one"))
    return content


def _broken(path: Path, why: object) -> str:
    """Say that a file is no whole shard; only what has the name of a sweep's own file may be removed."""
    reason = " ".join(str(why).split()).rstrip(".") or type(why).__name__
    is_ours = re.fullmatch(OWN_NAME, path.name) is not None
    advice = (
        "remove it, and the sweep will write it again" if is_ours else "valid is a sweep's shard"
    )
    return f"{path} is no whole shard ({reason}); {advice}."
