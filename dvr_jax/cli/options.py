"""How every command reads its options, and the name that its help shows."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TypeVar

CONSOLE = "dvr-jax"
"""Name of the console command; `dvr_jax.cli.console` puts "dvr-jax COMMAND" into `sys.argv[0]`."""

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
