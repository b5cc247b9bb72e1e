"""The checksum of a whole shard, verified before anything of the file is parsed.

Parquet has checksums of pages only. Where its own metadata are damaged, a reader may find other numbers, or wait for
memory that no machine has. So the metadata hold, under the key `dvr_jax_sha256`, the SHA-256 of the file as it is with
zeros in the place of this checksum. Readers that do not know it need not care.
"""

import hashlib

CHECKSUM_KEY = b"dvr_jax_sha256"
"""Key of the checksum in the Parquet metadata."""

BLANK = b"0" * 64
"""What stands in the place of the checksum while it is computed."""

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


def _with_checksum(content: bytes, start: int, checksum: bytes) -> bytes:
    return content[:start] + checksum + content[start + len(checksum) :]


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()
