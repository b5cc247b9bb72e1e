"""Standard output that is closed, full, or knows no umlauts: results are there, and the exit code stays the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dvr_jax.scene.files import load_scenes, save_scene
from dvr_jax.scene.random_scenes import sample_scenes


def shell(line: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """A line for the shell, in which $DVR is the console command, with the exit code of its first command."""
    command = f"{sys.executable} -m dvr_jax.cli.console"
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line.replace('$DVR', command)}"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.getcwd(), **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


SAMPLE = "$DVR sample --number 3 --out s.jsonl"


@pytest.mark.parametrize(
    "line",
    [
        f"{SAMPLE} | true",
        f"{SAMPLE} >&-",
        f"{SAMPLE} 2>&- >&-",
        f"{SAMPLE} <&- 2>&- >&-",
        "PYTHONUNBUFFERED=1 " + SAMPLE + " | true",
    ],
)
def test_a_closed_output_changes_nothing(line: str, tmp_path: Path) -> None:
    ended = shell(line, tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert len(load_scenes(tmp_path / "s.jsonl")) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["s.jsonl"]


def test_refusals_keep_their_exit_code_without_a_reader(tmp_path: Path) -> None:
    for redirection in ("2>&1 | true", "2>&-", "2>/dev/full"):
        assert shell(f"$DVR plan none.json {redirection}", tmp_path).returncode == 2


def test_a_full_output_is_named(tmp_path: Path) -> None:
    ended = shell(f"{SAMPLE} >/dev/full", tmp_path)
    assert ended.returncode == 2
    assert ended.stderr == (
        "error: cannot use the file 'standard output': No space left on device.\n"
    )
    assert len(load_scenes(tmp_path / "s.jsonl")) == 3


def test_an_encoding_without_umlauts_loses_nothing(tmp_path: Path) -> None:
    ended = shell("$DVR sample --number 3 --out ü.jsonl", tmp_path, PYTHONIOENCODING="ascii")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "written to \\xfc.jsonl" in ended.stdout and (tmp_path / "ü.jsonl").exists()


def test_no_name_commands_the_terminal(tmp_path: Path) -> None:
    for line in (
        "$DVR plan $'\\e[31mnone'",
        "$DVR $'\\e[31mnone'",
        "$DVR sample --number $'\\e[31mnone' --out s.jsonl",
        "$DVR sample --nix $'\\e[31m\\u202enone' --out s.jsonl",
        "$DVR sample --number 1 --out $'\\e[31mnone.jsonl'",
    ):
        ended = shell(line, tmp_path)
        output = ended.stdout + ended.stderr
        assert "none" in output and output.replace("\n", "").isprintable(), output


def test_an_argument_that_fills_the_screen_is_refused(tmp_path: Path) -> None:
    ended = shell(f"$DVR sample --number {'1' * 5000} --out s.jsonl", tmp_path)
    assert ended.returncode == 2
    assert ended.stderr == "error: argument 2 has 5000 characters; valid are at most 1000.\n"


def test_the_plan_is_written_before_it_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The goal of the scene holds already, so nothing is compiled."""
    from dvr_jax.cli import plan as command
    from dvr_jax.goals import OnRegion, Region
    from dvr_jax.scene.validation import make_scene

    (scene,) = sample_scenes(1, 1, 3)
    item = scene.objects[0]
    region = Region(item.position, item.yaw, (0.3, 0.3))
    save_scene(tmp_path / "s.json", make_scene(scene.objects, OnRegion(item.name, region)))

    def refuse(*_: object) -> None:
        assert (tmp_path / "out" / "plan.json").exists()
        raise BrokenPipeError

    monkeypatch.setattr(command, "_print_plan", refuse)
    with pytest.raises(BrokenPipeError):
        command.main([str(tmp_path / "s.json"), "--out", str(tmp_path / "out")])


@pytest.mark.parametrize("out", ["/proc/dvr_jax", "file/out"])
def test_a_folder_that_cannot_be_written_is_refused_at_once(out: str, tmp_path: Path) -> None:
    (scene,) = sample_scenes(1, 1, 3)
    save_scene(tmp_path / "s.json", scene)
    (tmp_path / "file").write_text("")
    ended = shell(f"$DVR plan s.json --out {out}", tmp_path)
    assert ended.returncode == 2 and ended.stderr.startswith("error: cannot use the file ")
    assert out.partition("/out")[0] in ended.stderr
