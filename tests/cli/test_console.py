"""The console command: what it lists, what it hands on, and that help is there at once."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from dvr_jax import __version__
from dvr_jax.cli.console import COMMANDS
from dvr_jax.cli.plan import PlanOptions
from dvr_jax.cli.sample import SampleOptions
from dvr_jax.cli.sweep import SweepOptions
from dvr_jax.dataset.labelling import LabelOptions
from dvr_jax.scene.files import load_scenes
from dvr_jax.scene.sampling import DEFAULT_DISTRIBUTION, ShapeChoice
from dvr_jax.search.searches import SEARCHES

HEAVY = ("jax", "numpy", "mujoco", "scipy", "pyarrow", "flax", "orbax", "PIL")

LIGHT_COMMANDS = ("plan", "execute", "export", "sample", "sweep", "dataset", "train")
"""Commands whose options live in modules that are light to import."""


def console(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dvr_jax.cli.console", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_it_lists_the_commands(arguments: list[str]) -> None:
    ended = console(*arguments)
    assert (ended.returncode, ended.stderr) == (0, "")
    listed = [line.split()[0] for line in ended.stdout.splitlines() if line.startswith("  ")]
    assert listed == [*COMMANDS, "dvr-jax"]


def test_it_has_a_version() -> None:
    assert console("--version").stdout == f"dvr-jax {__version__}\n"


def test_an_unknown_command_is_refused() -> None:
    ended = console("plann", "--help")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == f"error: there is no command 'plann'; valid: {', '.join(COMMANDS)}.\n"


def test_it_runs_a_command_with_its_options_and_exit_code(tmp_path: Path) -> None:
    file = tmp_path / "scenes.jsonl"
    assert console("sample", "--number", "2", "--out", str(file)).returncode == 0
    assert len(load_scenes(file)) == 2
    refused = console("plan", str(tmp_path / "none.json"))
    assert refused.returncode == 2 and refused.stderr.startswith("error: cannot use the file ")
    wrong = console("sample", "--numbre", "2")
    assert wrong.returncode == 2 and "Traceback" not in wrong.stderr


@pytest.mark.parametrize("name", LIGHT_COMMANDS)
def test_help_names_the_command_and_imports_nothing_heavy(name: str) -> None:
    code = f"""
import sys
from dvr_jax.cli.{name} import main
try:
    main(["--help"])
except SystemExit as ended:
    print(ended.code, [name for name in {HEAVY} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "0 []", done.stderr
    assert done.stdout.startswith(f"usage: python -m dvr_jax.{name} ")
    assert console(name, "--help").stdout.startswith(f"usage: dvr-jax {name} ")


def test_options_that_are_written_twice_agree() -> None:
    """The command lines repeat some defaults and choices, because the modules that own them are heavy to import."""
    defaults = {item.name: item.default for item in fields(SweepOptions)}
    for item in fields(LabelOptions):
        assert defaults[item.name] == item.default
    assert {item.name: item.default for item in fields(SampleOptions)}[
        "cubes"
    ] == DEFAULT_DISTRIBUTION.cube_share
    assert get_type_hints(SampleOptions)["shape"] == ShapeChoice
    assert get_args(get_type_hints(PlanOptions)["search"]) == SEARCHES


def test_each_option_is_documented() -> None:
    for kind in (PlanOptions, SampleOptions, SweepOptions):
        text = Path(sys.modules[kind.__module__].__file__ or "").read_text(encoding="utf-8")
        for item in fields(kind):
            after = text.split(f"    {item.name}: ", 1)[1].split("\n", 1)[1]
            assert after.lstrip().startswith('"""'), item.name
