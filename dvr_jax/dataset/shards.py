"""Shards: Parquet files of labels, each of a contiguous range of scenes with the scenes themselves.

One row a scene, so that a scene is stored once and one without labels has its place too:

    scene   int64                     index of the scene
    json    string                    the scene as in a scene file
    labels  list<struct<
        actions         list<string>  dictionary-encoded: a byte or less each
        feasible        bool
        refuted_prefix  bool
        bound           string        dictionary-encoded
        violation       float>>       rounded to VIOLATION_BITS binary digits, about three decimal ones

Compressed with Zstandard, every page with a checksum. Labels are sorted by length and then by name, nothing in a file
depends on when or where it was written, so equal sweeps give equal files as long as versions and options are the same.
Any Parquet reader shows one label a row with, for instance, `SELECT scene, unnest(labels) FROM 'folder/*.parquet'`.
"""

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dvr_jax.dataset.footer import Footer, ShardInfo, decode_footer, make_footer, require_agreement
from dvr_jax.dataset.labels import Label, same_label, sort_labels, validate_labels
from dvr_jax.dataset.symbols import sequence_index
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.types import Scene

KEY = b"dvr_jax"
"""Of the footer in the Parquet metadata."""

SUFFIX = ".parquet"

VIOLATION_BITS = 10
"""Binary digits kept of a violation: a verdict is in `feasible`, and noise does not compress."""

FLOAT32_EXPONENT = 127
"""Violations from 2^127 on count as infinite."""

LABEL = pa.struct(
    [
        ("actions", pa.list_(pa.string())),
        ("feasible", pa.bool_()),
        ("refuted_prefix", pa.bool_()),
        ("bound", pa.string()),
        ("violation", pa.float32()),
    ]
)
SCHEMA = pa.schema([("scene", pa.int64()), ("json", pa.string()), ("labels", pa.list_(LABEL))])


@dataclass(frozen=True, slots=True)
class Shard:
    """What a shard holds."""

    info: ShardInfo
    scenes: tuple[Scene, ...]
    """Those of `info.scenes`, in order."""
    labels: tuple[Label, ...]
    """Sorted by scene, length and names; a violation is what was written rounded to VIOLATION_BITS."""


class Columns(NamedTuple):
    """A shard's labels as flat arrays: L labels, A actions in all, N scenes."""

    json: list[str]
    """Scenes (N)."""
    label_ends: NDArray[np.int64]
    """First label of each scene, and L (N + 1,)."""
    action_ends: NDArray[np.int64]
    """First action of each label, and A (L + 1,)."""
    names: list[str]
    """Distinct names of actions."""
    action: NDArray[np.int64]
    """Index into `names` (A,)."""
    feasible: NDArray[np.bool_]
    """(L,)"""
    refuted_prefix: NDArray[np.bool_]
    """(L,)"""
    bound: list[str]
    """(L,)"""
    violation: NDArray[np.float32]
    """Multiples of the tolerance (L,)."""


def write_shard(
    path: str | Path, scenes: Mapping[int, Scene], labels: Sequence[Label], options: Mapping[str, Any]
) -> ShardInfo:
    """Write a shard, whole or not at all, and return its place and footer.

    `scenes` maps indices to scenes and covers a range without gaps, all of it finished, also scenes without labels.
    `options` are those of the sweep that its labels depend on (JSON, with the scenes' `seed`), the same in all its
    shards. Labels that contradict each other or the scene's logic raise a DvrError and nothing is written.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise DvrError(f"the shard {path} has the suffix {path.suffix!r}; valid is {SUFFIX!r}.")
    covered = range(min(scenes, default=0), max(scenes, default=-1) + 1)
    if not scenes or covered.start < 0 or len(covered) != len(scenes):
        raise DvrError(f"the shard's scenes are {sorted(scenes)}; valid are one or more consecutive indices from 0 on.")
    of_scene = {index: list(group) for index, group in groupby(sort_labels(labels), key=lambda label: label.scene)}
    for index, group in of_scene.items():
        if index not in scenes:
            raise DvrError(f"{group[0]} is of no scene of the shard; valid are {covered.start} to {covered.stop - 1}.")
        validate_labels(group, sequence_index(scenes[index]))
    footer = make_footer(covered, len(labels), options)
    table = pa.table(
        {
            "scene": list(covered),
            "json": [scene_to_json(scenes[index]) for index in covered],
            "labels": [[_record(label) for label in of_scene.get(index, [])] for index in covered],
        },
        schema=SCHEMA.with_metadata({KEY: _encode(footer)}),
    )
    content = io.BytesIO()
    # The flat columns are told apart by their path: violations do not repeat, so a dictionary of them is of no use.
    pq.write_table(
        table,
        content,
        compression="zstd",
        compression_level=9,
        use_dictionary=["labels.list.element.actions.list.element", "labels.list.element.bound"],
        column_encoding={"labels.list.element.violation": "BYTE_STREAM_SPLIT"},
        write_statistics=False,
        write_page_checksum=True,
    )
    write_whole(path, content.getvalue())
    return ShardInfo(path, footer)


def read_shard(path: str | Path) -> Shard:
    """The scenes and labels of a shard; a file that is broken, or none of ours, raises a DvrError that names it."""
    info = read_info(path)
    columns = read_columns(info)
    scenes = tuple(
        scene_from_json(text, f"{info.path}, scene {index}")
        for index, text in zip(info.scenes, columns.json, strict=True)
    )
    names = [columns.names[code] for code in columns.action.tolist()]
    ends = columns.action_ends.tolist()
    labels = tuple(
        Label(int(scene), tuple(names[start:stop]), *verdict)
        for scene, start, stop, *verdict in zip(
            np.repeat(info.scenes, np.diff(columns.label_ends)).tolist(),
            ends,
            ends[1:],
            columns.feasible.tolist(),
            columns.refuted_prefix.tolist(),
            columns.bound,
            columns.violation.tolist(),
            strict=False,  # ends has one more
        )
    )
    return Shard(info, scenes, labels)


def read_info(path: str | Path) -> ShardInfo:
    """Place and footer of a shard; its labels are not looked at."""
    path = Path(path)
    try:
        metadata = pq.read_schema(path)
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise _refusal(path, error) from None
    footer = (metadata.metadata or {}).get(KEY)
    if footer is None or not metadata.remove_metadata().equals(SCHEMA):
        raise DvrError(f"{path} is a Parquet file, but no shard of labels; valid are files of dvr_jax.dataset.")
    return ShardInfo(path, decode_footer(footer, path))


def read_columns(info: ShardInfo) -> Columns:
    """A shard's labels as arrays, without an object for each."""
    try:
        table = pq.read_table(info.path, page_checksum_verification=True)
        table.validate(full=True)
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise _refusal(info.path, error) from None
    per_scene = table["labels"].combine_chunks()
    per_label = per_scene.flatten()
    actions = per_label.field("actions")
    words = actions.flatten().dictionary_encode()
    covered = table["scene"].to_pylist()
    nulls = sum(
        array.null_count for array in (table["json"], per_scene, per_label, actions, words, *per_label.flatten())
    )
    if covered != list(info.scenes) or len(per_label) != info.footer.labels or nulls:
        raise DvrError(_broken(info.path, "its rows are not those that its footer announces"))
    return Columns(
        json=table["json"].to_pylist(),
        label_ends=_ends(per_scene),
        action_ends=_ends(actions),
        names=words.dictionary.to_pylist(),
        action=words.indices.to_numpy(zero_copy_only=False).astype(np.int64),
        feasible=per_label.field("feasible").to_numpy(zero_copy_only=False),
        refuted_prefix=per_label.field("refuted_prefix").to_numpy(zero_copy_only=False),
        bound=per_label.field("bound").to_pylist(),
        violation=per_label.field("violation").to_numpy(zero_copy_only=False),
    )


def list_shards(directory: str | Path) -> list[ShardInfo]:
    """The shards of a folder by scene, one sweep's, none overlapping; gaps between them are scenes yet to come.

    Every `*.parquet` there must be a shard; other files, hidden ones and subfolders are not looked at.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise DvrError(f"there is no folder {directory}; valid is a folder of shards (*{SUFFIX}).")
    paths = [path for path in sorted(directory.glob(f"*{SUFFIX}")) if not path.name.startswith(".")]
    infos = sorted((read_info(path) for path in paths), key=lambda info: info.footer.first)
    require_agreement(infos)
    return infos


def same_rows(a: Shard, b: Shard) -> bool:
    """Whether two shards hold the same scenes and labels, NaN equal to NaN, whatever made them and where they lie."""
    if a.info.scenes != b.info.scenes or a.scenes != b.scenes or len(a.labels) != len(b.labels):
        return False
    return all(map(same_label, a.labels, b.labels))


def round_violation(violation: float) -> float:
    """A violation as a shard keeps it: VIOLATION_BITS binary digits; NaN and infinity stay what they are."""
    mantissa, exponent = math.frexp(violation)
    if not math.isfinite(violation) or exponent > FLOAT32_EXPONENT:
        return violation if math.isnan(violation) else math.inf
    return float(np.float32(math.ldexp(round(mantissa * 2**VIOLATION_BITS), exponent - VIOLATION_BITS)))


def _record(label: Label) -> dict[str, object]:
    return {
        "actions": label.actions,
        "feasible": label.feasible,
        "refuted_prefix": label.refuted_prefix,
        "bound": label.bound,
        "violation": round_violation(label.violation),
    }


def _encode(footer: Footer) -> bytes:
    return msgspec.json.encode(footer, order="deterministic")


def _ends(lists: Any) -> NDArray[np.int64]:
    """Where each list of an array starts in its flattened values, and their number (n + 1,)."""
    ends = lists.offsets.to_numpy().astype(np.int64)
    return ends - ends[0]


def _refusal(path: Path, error: Exception) -> Exception:
    """What to raise for an error of Arrow: its complaints of content, wrong checksums among them, have no errno."""
    if isinstance(error, OSError) and error.errno is not None:
        return error
    return DvrError(_broken(path, error))


def _broken(path: Path, why: object) -> str:
    reason = " ".join(str(why).split()).rstrip(".")
    return f"{path} is no whole shard ({reason}); remove it, and the sweep will write it again."
