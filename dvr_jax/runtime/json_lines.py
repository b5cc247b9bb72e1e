"""Lines of JSON with a checksum each, so that what is read again is what was written."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

from dvr_jax.runtime.json_text import parse_json

CHECKSUM = "crc32"
"""Key of the checksum of all else in a line."""


def checked_line(record: Mapping[str, Any]) -> bytes:
    """Return a record as one line of JSON with its checksum; NaN is written as Python reads it."""
    checksum = zlib.crc32(json.dumps(record).encode())
    return json.dumps({**record, CHECKSUM: checksum}).encode() + b"\n"


def parse_checked_line(line: bytes) -> dict[str, Any]:
    """Return the record of a line.

    Raises:
        ValueError: The line is no JSON object, or not the one that was written.
    """
    record = parse_json(line, constants=True)
    if not isinstance(record, dict):
        raise ValueError("a line is no JSON object")
    if record.pop(CHECKSUM, None) != zlib.crc32(json.dumps(record).encode()):
        raise ValueError("the checksum of a line is another one")
    return record
