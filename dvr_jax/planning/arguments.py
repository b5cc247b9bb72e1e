"""Arguments of the public functions: each is checked here, so that a wrong type is refused in one sentence."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping, Sequence

from dvr_jax.errors import OptionError
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.types import Scene


def require_scene(value: object) -> Scene:
    """Return a value that is a scene; refuse a path, a parsed file, several scenes and everything else.

    Raises:
        OptionError: The value is no `Scene`.
    """
    if isinstance(value, Scene):
        return value

    if isinstance(value, (str, os.PathLike)):
        path = os.fspath(value)
        raise OptionError(
            f"the scene is the path {path!r}; valid is a Scene, as load_scene({path!r}) returns it."
        )

    if isinstance(value, Mapping):
        raise OptionError(
            f"the scene is a {type(value).__name__}; valid is a Scene, as load_scene returns it for a file with this "
            "content."
        )

    if isinstance(value, (list, tuple)) and any(isinstance(item, Scene) for item in value):
        raise OptionError(
            f"the scene is a {type(value).__name__} of {len(value)} scenes; valid is one Scene a call."
        )

    raise OptionError(
        f"the scene is {describe_value(value)}; valid is a Scene, as load_scene returns it."
    )


LARGEST_K_MAX = 50
"""Largest number of actions that may be asked for: eight objects, each moved twice with a handover, take fewer."""


def require_integer(name: str, value: object, least: int, most: int | None = None) -> int:
    """Return a value that is a whole number of at least `least`.

    Args:
        name: What the number is, as in "the seed".
        value: Value to check; NumPy's integers are numbers too, a bool is none.
        least: Smallest valid number.
        most: Largest valid number; None if there is none.

    Returns:
        The number as a Python int.

    Raises:
        OptionError: The value is no whole number, or it is too small or too large.
    """
    valid = f"valid is a whole number from {least}" + ("" if most is None else f" to {most}")

    if isinstance(value, bool):
        raise OptionError(f"{name} is {value}; {valid}.")

    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise OptionError(f"{name} is {describe_value(value)}; {valid}.") from None

    if number < least or (most is not None and number > most):
        raise OptionError(f"{name} is {number}; {valid}.")

    return number


def require_number(name: str, value: object) -> float:
    """Return a value that is a number.

    Args:
        name: What the number is, as in "the clearance".
        value: Value to check.

    Returns:
        The number as a Python float.

    Raises:
        OptionError: The value is no number.
    """
    return _as_float(name, value, "valid is a number")


def _as_float(name: str, value: object, valid: str) -> float:
    """Return a value as a Python float, or refuse it with a sentence that says what is valid."""
    if isinstance(value, (bool, str, bytes)) or not hasattr(value, "__float__"):
        raise OptionError(f"{name} is {describe_value(value)}; {valid}.")

    try:
        return float(value)
    except (TypeError, ValueError):
        raise OptionError(f"{name} is {describe_value(value)}; {valid}.") from None


def require_positive(name: str, value: object, unit: str) -> float:
    """Return a value that is a positive number; infinity is one.

    Args:
        name: What the number is, as in "the time limit".
        value: Value to check.
        unit: Its unit.

    Returns:
        The number as a Python float.

    Raises:
        OptionError: The value is no number, or it is not positive.
    """
    valid = "valid is a positive number"

    number = _as_float(name, value, valid)
    if math.isnan(number) or number <= 0:
        raise OptionError(f"{name} is {number} {unit}; {valid}.")

    return number


def require_motion(value: object) -> Motion:
    """Return a value that is a motion.

    Raises:
        OptionError: The value is no `Motion`.
    """
    if isinstance(value, Motion):
        return value

    raise OptionError(
        f"the motion is {describe_value(value)}; valid is a Motion, such as a plan's."
    )


def parse_actions(name: str, value: object) -> tuple[Action, ...]:
    """Return a sequence of actions, of which each may be given as its text.

    Args:
        name: What the sequence is, as in "sequence 2".
        value: Sequence of `Action`, or of texts such as "grasp(left, +x, yellow)".

    Returns:
        The actions.

    Raises:
        OptionError: The value is no sequence, or holds something that is neither an action nor a text.
        LogicError: A text is not written as an action.
    """
    valid = "valid is a sequence of actions, such as ['grasp(left, +x, yellow)', 'place(left, yellow, goal)']"

    if isinstance(value, Action):
        raise OptionError(f"{name} is the single action {value}; {valid}.")
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise OptionError(f"{name} is {describe_value(value)}; {valid}.")

    actions = []
    for number, item in enumerate(value, start=1):
        if isinstance(item, str):
            actions.append(Action.parse(item))
        elif isinstance(item, Action):
            actions.append(item)
        else:
            raise OptionError(f"action {number} of {name} is {describe_value(item)}; {valid}.")

    return tuple(actions)


def describe_value(value: object) -> str:
    """Describe a value of a wrong type: a class by its name, plain values by their text, all else by its type."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, str):
        return f"the text {_shorten(value)}"
    if isinstance(value, (int, float, os.PathLike)):
        return _shorten(value)

    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        return f"an array of shape {shape}"

    return f"of the type {type(value).__name__}"


def _shorten(value: object) -> str:
    """Return the value's text, cut after 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
