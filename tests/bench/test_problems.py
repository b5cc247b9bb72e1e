"""The frozen problems belong to the package, and are found from any working directory."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dvr_jax
from dvr_jax.bench.problems import PROBLEMS, read_problems
from dvr_jax.errors import DvrError

COUNT = "from dvr_jax.bench.problems import read_problems; print(len(list(read_problems())))"


def test_problems_are_found_from_another_working_directory(tmp_path: Path) -> None:
    root = Path(dvr_jax.__file__).parents[1]
    program = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(root)!r}); {COUNT}"]
    printed = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert printed.stdout.strip() == "400"


def test_problems_are_package_data() -> None:
    # What the package's build puts into a wheel; the file is found beside the module that reads it.
    assert PROBLEMS.is_file()
    configuration = Path(dvr_jax.__file__).parents[1] / "pyproject.toml"
    if configuration.exists():
        settings = tomllib.loads(configuration.read_text(encoding="utf-8"))
        data = settings["tool"]["setuptools"]["package-data"]
        assert {"problems.jsonl", "public_scenes.jsonl"} <= set(data["dvr_jax.bench"])


def test_the_first_problem_is_the_frozen_one() -> None:
    scene, actions, row = next(read_problems())
    assert (row["kind"], row["index"], row["length"], row["feasible"]) == ("keyframes", 0, 1, False)
    assert [str(action) for action in actions] == ["grasp(left, -x, yellow)"]
    assert scene.goal.object == "blue"


def test_a_file_without_problems_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="there is no file"):
        next(read_problems(tmp_path / "missing.jsonl"))
    (tmp_path / "other.jsonl").write_text('{"scene": 1}\n')
    with pytest.raises(DvrError, match="holds no problems"):
        next(read_problems(tmp_path / "other.jsonl"))
