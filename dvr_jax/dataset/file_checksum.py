"""What is verified of a shard's file before its rows are parsed: the checksum of the whole file, and its size.

Parquet has checksums of pages only. Where its own metadata are damaged, a reader may find other numbers, or wait for
memory that no machine has. So the metadata hold, under the key `dvr_jax_sha256`, the SHA-256 of the file as it is with
zeros in the place of this checksum. Readers that do not know it need not care.
"""

import hashlib

import pyarrow as pa
import pyarrow.parquet as pq

CHECKSUM_KEY = b"dvr_jax_sha256"
"""Key of the checksum in the Parquet metadata."""

BLANK = b"0" * 64
"""What stands in the place of the checksum while it is computed."""

MOST_VALUES = 200_000_000
"""Values of the largest shard; one of 250 scenes has less than a million."""

_MARK = CHECKSUM_KEY + b"\x18\x40"
"""The key, and what Thrift's compact protocol writes between it and a value of 64 bytes."""


def seal(content: bytes) -> bytes:
    """Write the checksum of a file into its place.

    Args:
        content: the file with `BLANK` under `CHECKSUM_KEY`.

    Returns:
        The file with its checksum.
    """
    start = content.rindex(_MARK) + len(_MARK)
    assert content[start : start + len(BLANK)] == BLANK
    return _with_checksum(content, start, _digest(content))


def is_sealed(content: bytes) -> bool:
    """Return whether a file has the place of a checksum, whatever stands there."""
    return content.rfind(_MARK) >= 0


def is_whole(content: bytes) -> bool:
    """Return whether a file has the checksum that it was sealed with."""
    start = content.rfind(_MARK) + len(_MARK)
    found = content[start : start + len(BLANK)]
    return is_sealed(content) and found == _digest(_with_checksum(content, start, BLANK))


def require_moderate_size(content: bytes) -> None:
    """Refuse a file of few bytes that would unfold to more than a machine can hold.

    Raises:
        ValueError: It has too many values.
    """
    metadata = pq.ParquetFile(pa.BufferReader(content)).metadata
    groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
    number = sum(
        group.column(index).num_values for group in groups for index in range(group.num_columns)
    )
    if number > MOST_VALUES:
        raise ValueError(f"it has {number:,} values; valid are at most {MOST_VALUES:,}")


def _with_checksum(content: bytes, start: int, checksum: bytes) -> bytes:
    return content[:start] + checksum + content[start + len(checksum) :]


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()
