"""The error of the symbolic layer: bad domain files, unknown names, inapplicable actions."""

from collections.abc import Iterable

from dvr_jax.errors import DvrError


class LogicError(DvrError, ValueError):
    """A domain, a fact or an action that makes no sense; the message names the culprit and what would be valid."""


def listed(words: Iterable[object], limit: int = 8) -> str:
    """The words separated by commas, cut after `limit` of them (a scene has dozens of actions)."""
    shown = [str(word) for word in words]
    rest = len(shown) - limit
    return ", ".join(shown[:limit]) + (f" and {rest} more" if rest > 0 else "") if shown else "none"
