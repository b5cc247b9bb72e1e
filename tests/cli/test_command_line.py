"""How a command ends: `run_command` for every kind of failure, and `python -m dvr_jax.sample` as a person runs it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dvr_jax.errors import DvrError, run_command
from dvr_jax.scene.files import load_scenes


def raise_(error: BaseException) -> int:
    raise error


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (
            DvrError("the seed is -1; valid is 0 or more."),
            2,
            "error: the seed is -1; valid is 0 or more.\n",
        ),
        (
            FileNotFoundError(2, "No such file or directory", "a.json"),
            2,
            "error: cannot use the file 'a.json': No such",
        ),
        (OSError("odd"), 2, "error: the operating system refused: odd.\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
)
def test_failures(
    error: BaseException, code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: raise_(error))
    assert ended.value.code == code
    assert capsys.readouterr().err.startswith(message)


@pytest.mark.parametrize(("result", "code"), [(0, 0), (1, 1), (None, 0)])
def test_results(result: int | None, code: int) -> None:
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: result)
    assert ended.value.code == code


def test_a_defect_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run_command(lambda: 1 // 0)


@pytest.mark.parametrize(
    ("main", "ended"),
    [
        ("print('done') or print('and said', file=sys.stderr) or 1", (1, "done\n", "and said\n")),
        (
            "open('missing.json')",
            (2, "", "error: cannot use the file 'missing.json': No such file or directory.\n"),
        ),
    ],
)
def test_a_command_may_end_without_waiting_for_its_threads(
    main: str, ended: tuple[int, str, str]
) -> None:
    code = (
        "import sys, threading, time; from dvr_jax.errors import run_command\n"
        "threading.Thread(target=time.sleep, args=(600,)).start()\n"
        f"run_command(lambda: {main}, at_once=True)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert (run.returncode, run.stdout, run.stderr) == ended


def sample(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dvr_jax.sample", *options]
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)


def test_sample_writes_scenes(tmp_path: Path) -> None:
    file = tmp_path / "scenes.jsonl"
    ended = sample(
        "--number", "3", "--objects", "2", "--seed", "1", "--out", str(file), "--shape", "mixed"
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert len(load_scenes(file)) == 3
    assert "3 scenes of 2 objects" in ended.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--number", "2", "--objects", "9"], "number of objects is 9; valid are 1 to 8"),
        (["--number", "x"], "--number"),
        (["--number", "1", "--shape", "ball"], "ball"),
    ],
)
def test_sample_refuses(options: list[str], message: str, tmp_path: Path) -> None:
    ended = sample(*options, "--out", str(tmp_path / "scenes.jsonl"))
    assert ended.returncode == 2
    assert message in ended.stdout + ended.stderr and "Traceback" not in ended.stderr
    assert not list(tmp_path.iterdir())


def test_sample_makes_its_folder_and_names_a_file_in_the_way(tmp_path: Path) -> None:
    file = tmp_path / "new" / "scenes.jsonl"
    assert (
        sample("--number", "1", "--out", str(file)).returncode == 0 and len(load_scenes(file)) == 1
    )
    ended = sample("--number", "1", "--out", str(file / "more.jsonl"))
    assert ended.returncode == 2
    assert f"'{file}'" in ended.stderr and "Traceback" not in ended.stderr
