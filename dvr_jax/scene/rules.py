"""Rules that several parts of a scene share: what a name is, what a number is, and how messages print them."""

import math
from collections.abc import Sequence

from dvr_jax.errors import SceneError

RESERVED_CHARACTERS = "(),"
"""Characters that no name has: actions are written as in "place(left, yellow, goal)"."""

OVERLAP_TOLERANCE = 1e-9
"""Bodies may overlap by this much [m]: bodies that touch exactly are valid in spite of rounding."""

CONTACT_TOLERANCE = 9e-4
"""Objects may overlap each other and fixed bodies, and reach off the table, by this much [m]: a plan may leave them so.
The planner and the check tolerate 1 mm."""

SMALLEST_SIZE = 1e-3
"""No body is thinner than this [m]: below, the physics and the distances lose their meaning."""

LARGEST_SIZE = 2.0
"""No body is longer than this, and none reaches higher [m]: the camera hangs above."""

LONGEST_NAME = 100
"""Characters of the longest name."""

LARGEST_YAW = 2 * math.pi
"""A larger turn is an angle in degrees, or none at all [rad]."""

YAW_RANGE = (-LARGEST_YAW, LARGEST_YAW)
"""Valid yaws [rad]."""

DENSITY_RANGE = (1.0, 25_000.0)
"""Valid densities of objects [kg/m^3], up to more than that of any metal."""

FRICTION_RANGE = (0.01, 10.0)
"""Valid coefficients of friction of objects."""

SIZE_RANGE = (SMALLEST_SIZE, LARGEST_SIZE)
"""Valid numbers of a body's size [m]."""

ANY_NUMBER = (-math.inf, math.inf)
"""Valid is every finite number."""


def require_name(kind: str, name: str, reserved: str = RESERVED_CHARACTERS) -> None:
    """Refuse a value that is no name.

    Args:
        kind: What the name belongs to, as in "an object".
        name: The name.
        reserved: Characters that a name of this kind does not have.

    Raises:
        SceneError: The value is no text, is empty or too long, has a reserved character or one that cannot be printed,
            or begins or ends with a blank.
    """
    if not isinstance(name, str) or not name:
        raise SceneError(f"{kind}'s name is {name!r}; a name is a text of at least one character.")
    if len(name) > LONGEST_NAME:
        raise SceneError(
            f"{kind}'s name has {len(name)} characters; valid are at most {LONGEST_NAME}."
        )
    if not name.isprintable():
        raise SceneError(f"{kind}'s name is {name!r}; valid are printable characters only.")
    if set(name) & set(reserved) or name != name.strip():
        raise SceneError(
            f"{kind}'s name is {name!r}; a name has none of {' '.join(reserved)}, no blanks around it."
        )


def require_unique(kinds: str, names: Sequence[str]) -> None:
    """Refuse names of which two are equal.

    Args:
        kinds: What has the names, as in "objects".
        names: The names.

    Raises:
        SceneError: A name occurs twice.
    """
    for name in names:
        if names.count(name) > 1:
            raise SceneError(
                f"{names.count(name)} {kinds} are called {name!r}; each name may occur once."
            )


def require_numbers(
    what: str,
    values: Sequence[float],
    count: int,
    valid: tuple[float, float] = ANY_NUMBER,
    unit: str = "",
) -> None:
    """Refuse values that are not finite numbers of a range.

    Args:
        what: What the values are, as in "the yaw of the object 'yellow'".
        values: The values.
        count: How many numbers there must be.
        valid: Least and largest valid number.
        unit: Unit of the numbers in messages.

    Raises:
        SceneError: There are more or fewer values, one is no finite number, or one is out of range.
    """
    if len(values) != count:
        raise SceneError(f"{what} is {in_words(values)}, {len(values)} numbers; valid are {count}.")

    lower, upper = valid

    for value in values:
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, float))
            or not math.isfinite(value)
        ):
            raise SceneError(f"{what} is {in_words(values)}; valid are finite numbers.")
        if not lower <= value <= upper:
            most = f" and at most {upper:g}" if math.isfinite(upper) else ""
            raise SceneError(
                f"{what} is {in_words(values)}; valid is at least {lower:g}{most} {unit}."
            )


def in_words(values: Sequence[float]) -> str:
    """Print numbers for a message, as in "(0.1, 0.2)"."""
    return (
        "("
        + ", ".join(f"{value:g}" if isinstance(value, float) else repr(value) for value in values)
        + ")"
    )
