"""Archives of arrays (`.npz`) that anybody may have written or damaged.

NumPy's own reader believes what an array's header says before it looks at the data: a header of a few bytes makes it
allocate terabytes. Here, an array must have exactly the bytes that its header announces, and the checksum of every
array is verified.
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dvr_jax.runtime.files import LARGEST_FILE, read_whole

SUFFIX = ".npy"
"""End of the name of each array in an archive."""

KINDS = "biufU"
"""Kinds of numbers, and text; there are no objects, which could be programs."""

_FIRST_ENTRY = b"PK\x03\x04"
"""Beginning of an archive with at least one entry."""

_LAST_RECORD = b"PK\x05\x06"
"""Beginning of an archive's last record."""

_END = struct.Struct("<4sHHHHLLH")
"""An archive's last record: signature, four numbers of which the last is that of the entries, size, place, comment."""

LONGEST_HEADER = 10_000
"""Bytes of the longest header of an array."""


def read_arrays(path: Path, most: int = LARGEST_FILE) -> dict[str, np.ndarray[Any, Any]]:
    """Read all arrays of an archive.

    Args:
        path: The file.
        most: Largest number of bytes of the file, and of its arrays together.

    Returns:
        The arrays by name.

    Raises:
        ValueError: The file is no archive, or is damaged; the message says how.
        OSError: The file cannot be read.
    """
    content = read_whole(path, most)
    try:
        return _arrays_of(content, most)
    except Exception as error:
        # The archive's reader and Python's parser, which reads headers, raise errors of a dozen kinds.
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise ValueError(reason) from None


def _arrays_of(content: bytes, most: int) -> dict[str, np.ndarray[Any, Any]]:
    """Return the arrays of an archive's content."""
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    if not content.startswith(_FIRST_ENTRY):
        raise ValueError("it is no .npz archive")

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        _require_all_entries(content, len(members))
        total = sum(member.file_size for member in members)
        if total > most:
            raise ValueError(f"its arrays have {total:,} bytes; valid are at most {most:,}")

        for member in members:
            name = member.filename.removesuffix(SUFFIX)
            if name in arrays or not member.filename.endswith(SUFFIX):
                raise ValueError(f"its entry {member.filename!r} is no array, or occurs twice")
            # Read to the end, an entry's checksum is verified.
            arrays[name] = _array_of(archive.read(member))

    return arrays


def _require_all_entries(content: bytes, found: int) -> None:
    """Refuse an archive in whose directory an entry is hidden, which the archive's reader does not notice."""
    signature, *_, announced, _, _, comment = _END.unpack(content[-_END.size :].ljust(_END.size))
    if signature != _LAST_RECORD or comment or announced != found:
        raise ValueError("its directory is damaged")


def _array_of(data: bytes) -> np.ndarray[Any, Any]:
    """Return the array of an entry: a header, and as many bytes as it announces."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, is_fortran, dtype = read_header(stream, max_header_size=LONGEST_HEADER)

    if dtype.kind not in KINDS or dtype.itemsize == 0 or dtype.fields is not None:
        raise ValueError(f"an array holds {dtype}; valid are numbers and text")
    announced = math.prod(shape) * dtype.itemsize
    found = len(data) - stream.tell()
    if min(shape, default=0) < 0 or announced != found:
        raise ValueError(f"an array of shape {shape} has {found} bytes instead of {announced}")

    flat = (
        np.frombuffer(data, dtype, math.prod(shape), stream.tell()) if found else np.empty(0, dtype)
    )
    return flat.reshape(shape, order="F" if is_fortran else "C").copy()
