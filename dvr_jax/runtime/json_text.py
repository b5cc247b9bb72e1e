"""JSON that anybody may have written: whatever is wrong with it is a `ValueError` with a reason."""

from __future__ import annotations

import json
from typing import Any, NoReturn


def parse_json(text: str | bytes, constants: bool = False) -> Any:
    """Return the value of a JSON text.

    Args:
        text: The text, encoded in UTF-8.
        constants: Whether NaN and the infinities are numbers, as Python writes them.

    Raises:
        ValueError: The text is no JSON, is nested too deeply, or is not encoded in UTF-8.
    """
    try:
        plain = text.decode("utf-8") if isinstance(text, bytes) else text
        return json.loads(plain, parse_constant=None if constants else _refuse_constant)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _refuse_constant(name: str) -> NoReturn:
    """Refuse NaN and the infinities, which Python writes and no other reader of JSON knows."""
    raise ValueError(f"{name} is no JSON number")
