"""Every script in `examples/` runs, from any directory."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))

SLOW = ("sweep_and_train",)
"""Scripts that take longer than a minute while their programs are compiled for the first time."""


def script_parameter(script: Path) -> object:
    """Return the script as a test's parameter, marked as slow if it is."""
    marks = [pytest.mark.slow] if script.stem in SLOW else []
    return pytest.param(script, id=script.stem, marks=marks)


@pytest.mark.parametrize("script", [script_parameter(script) for script in EXAMPLES])
def test_an_example_runs(script: Path, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_there_are_six() -> None:
    assert len(EXAMPLES) >= 6
