"""What may happen when something damaged is read: it is refused in one sentence, or it is accepted and equal."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from dvr_jax.errors import LONGEST_MESSAGE, DvrError, describe_os_error

LONGEST_CASE = 30
"""Longest time that one case may take [s]."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A case that ended as none may."""

    kind: str
    """What was damaged."""

    number: int
    """Number of the case, which with the seed draws it anew."""

    what: str
    """What happened."""

    def __str__(self) -> str:
        return f"{self.kind} {self.number}: {self.what}"


@dataclass(slots=True)
class Tally:
    """How the cases of one kind ended."""

    refused: int = 0
    """Cases that were refused in one sentence."""

    accepted: int = 0
    """Cases that were accepted, with equal content."""


class HangError(Exception):
    """Raised when a case takes too long."""


def judge(read: Callable[[], str | None], name: str | None, tally: Tally) -> str | None:
    """Read something damaged, and say what is wrong with how that ended.

    Args:
        read: Reads; returns what is wrong with what was accepted, or None.
        name: What a refusal has to name; None if nothing.
        tally: Takes the case.

    Returns:
        What is wrong; None if nothing is.
    """
    try:
        with _time_limit():
            wrong = read()
    except HangError:
        return f"it takes more than {LONGEST_CASE} s"
    except (DvrError, OSError) as error:
        tally.refused += 1
        text = describe_os_error(error) if isinstance(error, OSError) else str(error)
        return _fault_of_sentence(text, name)
    except BaseException as error:
        lines = traceback.format_exc().splitlines()
        return f"{type(error).__name__} in {lines[-3].strip() if len(lines) > 2 else ''}: {error}"

    tally.accepted += 1
    return wrong


def _fault_of_sentence(text: str, name: str | None) -> str | None:
    """Say what is wrong with the sentence of a refusal."""
    if not text.isprintable() or len(text) > LONGEST_MESSAGE:
        return f"the message does not fit on a screen: {text!r}"
    if name is not None and name not in text:
        return f"the message does not name {name}: {text}"
    return None


@contextmanager
def _time_limit() -> Iterator[None]:
    """Raise `HangError` in the block when it takes too long; works in the main thread only."""

    def stop(*_: Any) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST_CASE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
