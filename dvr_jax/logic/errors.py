"""The error of the symbolic layer, and the way its messages list valid values."""

from collections.abc import Iterable

from dvr_jax.errors import DvrError


class LogicError(DvrError, ValueError):
    """A domain, a fact, an action or a sequence of actions is not valid.

    The message names the culprit, its value and what would be valid.
    """


def listed(words: Iterable[object], limit: int = 8) -> str:
    """Join words by commas and cut the list after `limit` of them.

    A scene has dozens of actions, and an error message should stay one readable sentence.

    Args:
        words: the valid values, in the order in which they shall appear.
        limit: the largest number of words to show.

    Returns:
        The text, as in "grasp, place" or "a, b and 5 more"; "none" if there is no word.
    """
    all_words = [str(word) for word in words]
    if not all_words:
        return "none"

    text = ", ".join(all_words[:limit])
    hidden = len(all_words) - limit
    if hidden > 0:
        text += f" and {hidden} more"
    return text
