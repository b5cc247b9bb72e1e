"""Console command `dvr-jax COMMAND ...`: the same commands as `python -m dvr_jax.COMMAND ...`."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from typing import NoReturn

from dvr_jax import __version__
from dvr_jax.cli.options import CONSOLE
from dvr_jax.errors import OptionError, run_command


@dataclass(frozen=True, slots=True)
class Command:
    """One command of the console command."""

    module: str
    """Module whose `main` carries the command out; it is imported when the command is called."""
    summary: str
    """One line for the list of commands."""
    at_once: bool = False
    """Whether the process ends without waiting for its other threads."""


COMMANDS: dict[str, Command] = {
    # What the warm-up of a plan still compiles when the plan is written, nobody waits for.
    "plan": Command(
        "dvr_jax.cli.plan", "plan one scene: from a scene file to a checked motion", at_once=True
    ),
    "check": Command("dvr_jax.cli.check", "check a plan's motion anew, also its jerks and torques"),
    "execute": Command("dvr_jax.cli.execute", "execute a plan in a physics simulation"),
    "export": Command("dvr_jax.cli.export", "write a plan's motion for robot controllers"),
    "sample": Command("dvr_jax.cli.sample", "draw random scenes into a file"),
    "sweep": Command(
        "dvr_jax.cli.sweep", "label action sequences of many scenes as feasible or not"
    ),
    "dataset": Command("dvr_jax.cli.dataset", "count the labels and training targets of a sweep"),
    "train": Command("dvr_jax.cli.train", "train the network, or the feasibility classifier"),
    "bench": Command("dvr_jax.cli.bench", "run a benchmark"),
}


def main() -> NoReturn:
    """Run the command that the process names, and end the process with its exit code."""
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"

    if name in ("-h", "--help"):
        print(describe_commands())
        sys.exit(0)
    if name == "--version":
        print(f"{CONSOLE} {__version__}")
        sys.exit(0)
    if name not in COMMANDS:
        run_command(lambda: _refuse(name))

    # The command finds its options in sys.argv, as under `python -m`.
    command = COMMANDS[name]
    sys.argv = [f"{CONSOLE} {name}", *sys.argv[2:]]
    run_command(lambda: _run(command), at_once=command.at_once)


def describe_commands() -> str:
    """Return the list of commands, one line each."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {command.summary}" for name, command in COMMANDS.items()]
    usage = (
        f"usage: {CONSOLE} COMMAND [OPTIONS]; {CONSOLE} COMMAND --help lists a command's options"
    )
    return "\n".join([usage, "", *lines, "", f"  {CONSOLE} --version prints the version"])


def _run(command: Command) -> int | None:
    """Import a command and run it."""
    module = importlib.import_module(command.module)
    exit_code: int | None = module.main()
    return exit_code


def _refuse(name: str) -> NoReturn:
    """Refuse a name that is no command."""
    raise OptionError(f"there is no command {name!r}; valid: {', '.join(COMMANDS)}.")


if __name__ == "__main__":
    main()
