"""How every command reads its options, and the name that its help shows."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TypeVar

from dvr_jax.errors import OptionError

CONSOLE = "dvr-jax"
"""Name of the console command; `dvr_jax.cli.console` puts "dvr-jax COMMAND" into `sys.argv[0]`."""

LARGEST = {"k_max": 50, "workers": 1_024}
"""Largest valid number of some options; more is a slip of the keyboard, and would never end."""

LARGEST_NUMBER = 10_000_000
"""Largest valid number of all others."""

_Options = TypeVar("_Options")


def parse_options(
    kind: type[_Options], command: str, arguments: Sequence[str] | None = None
) -> _Options:
    """Read the options of a command; print its help or a complaint and end the process where they ask for it.

    Args:
        kind: Dataclass of the options.
        command: Name of the command, as in "plan".
        arguments: Options as text; None for those of the process.

    Returns:
        The options.

    Raises:
        SystemExit: The help was printed (code 0), or an option is wrong (code 2).
    """
    # Imported here, because the console command and its list of commands do without.
    import tyro

    return tyro.cli(kind, prog=program_name(command), args=arguments)


def program_name(command: str) -> str:
    """Return how this process was called: "dvr-jax COMMAND" or "python -m dvr_jax.COMMAND"."""
    console_name = f"{CONSOLE} {command}"
    return console_name if sys.argv[0] == console_name else f"python -m dvr_jax.{command}"


def require_range(name: str, value: int, least: int, most: int) -> None:
    """Refuse a number that makes no sense.

    Args:
        name: Field of the option, as in "k_max".
        value: Its value.
        least: Smallest valid number.
        most: Largest valid number.

    Raises:
        OptionError: The number is smaller or larger.
    """
    if not least <= value <= most:
        option = f"--{name.replace('_', '-')}"
        raise OptionError(f"{option} is {value}; valid is {least} to {most:,}.")
