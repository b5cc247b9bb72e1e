"""Console command `dvr-jax COMMAND ...`: the same commands as `python -m dvr_jax.COMMAND ...`."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from typing import NoReturn

from dvr_jax import __version__
from dvr_jax.cli.options import CONSOLE
from dvr_jax.errors import OptionError, run_command
from dvr_jax.runtime.interruption import end_on_interrupt, end_workers, ignore_interrupts
from dvr_jax.runtime.streams import open_closed_descriptors, secure_streams

LONGEST_ARGUMENT = 1_000
"""Characters of the longest argument of a command."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command of the console command."""

    module: str
    """Module whose `main` carries the command out; it is imported when the command is called."""
    summary: str
    """One line for the list of commands."""


COMMANDS: dict[str, Command] = {
    "plan": Command("dvr_jax.cli.plan", "plan one scene: from a scene file to a checked motion"),
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
    _prepare_process()
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"

    if name in ("-h", "--help"):
        run_command(lambda: print(describe_commands()))
    if name == "--version":
        run_command(lambda: print(f"{CONSOLE} {__version__}"))
    if name not in COMMANDS:
        run_command(lambda: _refuse(name))

    # The command finds its options in sys.argv, as under `python -m`.
    sys.argv = [f"{CONSOLE} {name}", *sys.argv[2:]]
    _run(name)


def run_module(name: str) -> NoReturn:
    """Run a command as `python -m dvr_jax.COMMAND`, and end the process with its exit code.

    The modules of these names call this before they import anything else, so that Ctrl-C has its effect from the start.
    """
    _prepare_process()
    _run(name)


def _prepare_process() -> None:
    """Let nothing that happens to this process end in a traceback: neither Ctrl-C nor a stream that is closed."""
    open_closed_descriptors()
    end_on_interrupt()
    secure_streams()


def describe_commands() -> str:
    """Return the list of commands, one line each."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {command.summary}" for name, command in COMMANDS.items()]
    usage = (
        f"usage: {CONSOLE} COMMAND [OPTIONS]; {CONSOLE} COMMAND --help lists a command's options"
    )
    return "\n".join([usage, "", *lines, "", f"  {CONSOLE} --version prints the version"])


def _run(name: str) -> NoReturn:
    """Import a command, run it, and end the process with its exit code."""
    command = COMMANDS[name]

    def main() -> int | None:
        try:
            _require_short_arguments()
            module = importlib.import_module(command.module)
            exit_code: int | None = module.main()
            return exit_code
        finally:
            ignore_interrupts()
            end_workers()

    # Threads that still compile or load programs may abort a process that ends in the usual way, and nobody waits for
    # what they make. All results are written by now.
    run_command(main, at_once=True)


def _require_short_arguments() -> None:
    """Refuse arguments that are too long for the complaints that quote them to fit on a screen."""
    for number, argument in enumerate(sys.argv[1:], start=1):
        if len(argument) > LONGEST_ARGUMENT:
            raise OptionError(
                f"argument {number} has {len(argument)} characters; valid are at most {LONGEST_ARGUMENT}."
            )


def _refuse(name: str) -> NoReturn:
    """Refuse a name that is no command."""
    raise OptionError(f"there is no command {name!r}; valid: {', '.join(COMMANDS)}.")


if __name__ == "__main__":
    main()
