"""Damage: bytes and JSON values that are changed at random, in the ways in which disks, editors and attackers do."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

import numpy as np

Generator = np.random.Generator

HOSTILE_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1,
    90,
    2**63,
    10**400,
    -0.0,
    1e-320,
    1e308,
    -1e308,
    "",
    " ",
    "x" * 10_000,
    "\x1b[31m",
    "\u202e",
    "a\x00b",
    "grasp(left, +x, a)",
    "object",
    "table",
    "goal",
    "left",
    "../../etc/passwd",
    [],
    {},
    [[]],
    [0.1] * 50,
    {"name": "a"},
)
"""Values that no place of a scene, or few, can have."""


def damage(content: bytes, generator: Generator) -> bytes:
    """Return content with one to three faults; it may happen to be the same.

    Args:
        content: The intact content.
        generator: Where random numbers come from.
    """
    for _ in range(int(generator.integers(1, 4))):
        fault = _FAULTS[generator.integers(len(_FAULTS))]
        content = fault(content, generator)
    return content


def damage_json(record: Any, generator: Generator) -> Any:
    """Return a JSON value with one to three of its items changed, moved, removed or doubled.

    Args:
        record: The intact value, which stays as it is.
        generator: Where random numbers come from.
    """
    record = copy.deepcopy(record)
    for _ in range(int(generator.integers(1, 4))):
        places = _places(record)
        if not places:
            break
        parent, key = places[generator.integers(len(places))]
        _change(parent, key, generator)
    return record


def to_text(record: Any) -> bytes:
    """Write a JSON value that may hold lone surrogates, NaN or infinities."""
    return json.dumps(record, ensure_ascii=True).encode()


def _places(record: Any) -> list[tuple[Any, Any]]:
    """Return parent and key of all items of a JSON value."""
    keys = (
        list(record) if isinstance(record, dict) else range(len(record) if _is_list(record) else 0)
    )
    found: list[tuple[Any, Any]] = []
    for key in keys:
        found.append((record, key))
        found += _places(record[key])
    return found


def _is_list(record: Any) -> bool:
    return isinstance(record, list)


def _is_number(value: Any) -> bool:
    """Return whether a value is a number with which one can calculate."""
    return type(value) is float or (type(value) is int and abs(value) < 2**63)


def _change(parent: Any, key: Any, generator: Generator) -> None:
    """Change one item of a JSON value."""
    kind = int(generator.integers(7))
    value = parent[key]
    if kind == 0:
        del parent[key]
    elif kind == 1 and _is_number(value):
        parent[key] = value * float(10.0 ** generator.integers(-4, 5))
    elif kind == 2 and _is_number(value):
        parent[key] = value + float(generator.normal(scale=0.1))
    elif kind == 3 and _is_list(value):
        parent[key] = value + value
    elif kind == 4 and isinstance(parent, dict):
        parent[f"{key}x"] = parent.pop(key)
    elif kind == 5 and isinstance(value, int | float):
        parent[key] = float(generator.choice([np.nan, np.inf, -np.inf]))
    else:
        parent[key] = copy.deepcopy(HOSTILE_VALUES[generator.integers(len(HOSTILE_VALUES))])


def _flip_a_bit(content: bytes, generator: Generator) -> bytes:
    if not content:
        return content
    place = int(generator.integers(len(content)))
    flipped = content[place] ^ (1 << int(generator.integers(8)))
    return content[:place] + bytes([flipped]) + content[place + 1 :]


def _cut(content: bytes, generator: Generator) -> bytes:
    return content[: generator.integers(len(content) + 1)]


def _overwrite(content: bytes, generator: Generator) -> bytes:
    start, end = _span(content, generator)
    return content[:start] + generator.bytes(end - start) + content[end:]


def _blank(content: bytes, generator: Generator) -> bytes:
    start, end = _span(content, generator)
    return content[:start] + bytes(end - start) + content[end:]


def _remove(content: bytes, generator: Generator) -> bytes:
    start, end = _span(content, generator)
    return content[:start] + content[end:]


def _double(content: bytes, generator: Generator) -> bytes:
    start, end = _span(content, generator)
    return content[:end] + content[start:end] + content[end:]


def _insert(content: bytes, generator: Generator) -> bytes:
    start, _ = _span(content, generator)
    return content[:start] + generator.bytes(int(generator.integers(1, 20))) + content[start:]


def _change_a_digit(content: bytes, generator: Generator) -> bytes:
    digits = [place for place, byte in enumerate(content) if 0x30 <= byte <= 0x39]
    if not digits:
        return content
    place = digits[generator.integers(len(digits))]
    return content[:place] + str(generator.integers(10)).encode() + content[place + 1 :]


def _encode_otherwise(content: bytes, generator: Generator) -> bytes:
    encoding = str(generator.choice(["utf-16", "utf-8-sig", "utf-32", "utf-7"]))
    return content.decode("latin-1").encode(encoding)


def _replace(content: bytes, generator: Generator) -> bytes:
    return generator.bytes(int(generator.integers(0, 200)))


def _span(content: bytes, generator: Generator) -> tuple[int, int]:
    """Return a short part of the content."""
    start = int(generator.integers(len(content) + 1))
    return start, min(len(content), start + int(generator.integers(0, 40)))


_FAULTS: tuple[Callable[[bytes, Generator], bytes], ...] = (
    _flip_a_bit,
    _flip_a_bit,
    _flip_a_bit,
    _change_a_digit,
    _cut,
    _overwrite,
    _blank,
    _remove,
    _double,
    _insert,
    _encode_otherwise,
    _replace,
)
"""Ways in which bytes are damaged; those that occur more often in the table do so in life."""
