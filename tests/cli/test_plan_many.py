"""The command `plan` on a file of many scenes: folders, table and summary, also after it was killed."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvr_jax.planning.planner import Plan
from dvr_jax.scene.files import OnRegion, Region, SceneObject, make_scene, save_scenes
from dvr_jax.scene.sampling import sample_scenes

NEAR = make_scene(
    [SceneObject("tile", "box", (0.05, 0.05, 0.08), (-0.35, 0.2), 0.2)],
    OnRegion("tile", Region((-0.35, -0.2), 0.0, (0.12, 0.12))),
)
"""One arm does it alone."""

KILLED_SCENES = 24


def start(scenes: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "dvr_jax.plan", str(scenes), "--out", str(out), *more]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def rows_of(out: Path) -> list[dict[str, Any]]:
    """Return the rows of a table without the times."""
    table = out / "results.jsonl"
    lines = table.read_text().splitlines() if table.exists() else []
    return [{**json.loads(line), "seconds": None} for line in lines]


def test_folders_table_and_summary(tmp_path: Path) -> None:
    moved = replace(NEAR.objects[0], position=(-0.33, 0.22))
    save_scenes(tmp_path / "scenes.jsonl", [NEAR, replace(NEAR, objects=(moved,))])
    with (tmp_path / "scenes.jsonl").open("a") as file:
        file.write('\n{"version": 1, "objects": []}\n')

    out = tmp_path / "out"
    options = ("--k-max", "2", "--workers", "2", "--no-animation")
    process = start(tmp_path / "scenes.jsonl", out, *options)
    said, complaints = process.communicate()
    assert process.returncode == 1, complaints
    lines = said.splitlines()
    assert lines[0] == "3 scenes: 2 solved, 1 refused"
    assert lines[1].startswith("actions: 2 with 2; median time of a solved scene ")
    assert lines[2].startswith("scene 2: ") and "goal" in lines[2]
    assert lines[3] == f"written to {out}/"

    rows = rows_of(out)
    assert [row["scene"] for row in rows] == [0, 1, 2]
    for row in rows[:2]:
        folder = out / row["folder"]
        assert {path.name for path in folder.iterdir()} == {
            "plan.json", "trajectory.npz", "scene.xml", "film.png", "depth.png",
        }  # fmt: skip
        saved = Plan.load(folder)
        assert row["actions"] == list(saved.action_descriptions)
        assert saved.motion is not None
        assert row["duration"] == pytest.approx(saved.motion.time[-1], abs=1e-6)
        assert row["nlps"] == saved.nlps and row["verdicts"] == saved.verdicts

    # The same command again has nothing to do; another one is refused.
    again = start(tmp_path / "scenes.jsonl", out, *options)
    assert again.communicate()[0] == said and rows_of(out) == rows
    other = start(tmp_path / "scenes.jsonl", out, *options, "--seed", "1")
    assert "other settings" in other.communicate()[1] and other.returncode == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["scenes.jsonl"], "--out is missing"),
        (["scenes.jsonl", "--out", "out", "--workers", "0"], "--workers is 0"),
        (["scene.json", "--workers", "2"], "are for a file of many scenes"),
        (["none.jsonl", "--out", "out"], "none.jsonl"),
        (["empty.jsonl", "--out", "out"], "holds no scene"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    save_scenes(tmp_path / "scenes.jsonl", [NEAR])
    (tmp_path / "empty.jsonl").write_text("\n")
    command = [sys.executable, "-m", "dvr_jax.plan", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 2
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_five_kills_lose_nothing(tmp_path: Path) -> None:
    """Two workers, three boxes, the default options; some kills come while a plan is written."""
    save_scenes(tmp_path / "scenes.jsonl", tuple(sample_scenes(KILLED_SCENES, 3, 11)))
    options = ("--workers", "2", "--no-animation")
    start(tmp_path / "scenes.jsonl", tmp_path / "whole", *options).communicate()

    generator = np.random.default_rng(5)
    out = tmp_path / "cut"
    done = 0
    for _ in range(5):
        process = start(tmp_path / "scenes.jsonl", out, *options)
        wanted = done + int(generator.integers(1, 4))
        while len(rows_of(out)) < wanted:
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(generator.uniform(0, 2))
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        assert len(rows_of(out)) >= wanted
        done = len(rows_of(out))
    assert done < KILLED_SCENES

    start(tmp_path / "scenes.jsonl", out, *options).communicate()
    rows = rows_of(out)
    assert rows == rows_of(tmp_path / "whole") and len(rows) == KILLED_SCENES
    assert sum(row["status"] == "solved" for row in rows) > KILLED_SCENES // 2
    for whole in sorted((tmp_path / "whole").glob("scene-*")):
        cut = out / whole.name
        assert {path.name for path in cut.iterdir()} == {path.name for path in whole.iterdir()}
        if (whole / "trajectory.npz").exists():
            same = (whole / "trajectory.npz").read_bytes() == (cut / "trajectory.npz").read_bytes()
            assert same, whole.name
