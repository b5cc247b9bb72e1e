"""The command `python -m dvr_jax.plan`: exit codes, what it prints, and the files of a plan."""

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dvr_jax.checker.replay import check_motion
from dvr_jax.cli import plan as command
from dvr_jax.errors import DvrError
from dvr_jax.logic import Action
from dvr_jax.model.predictor import load_network
from dvr_jax.motion import load_motion
from dvr_jax.planning.planner import Plan
from dvr_jax.scene.files import OnRegion, Region, SceneObject, load_scene, make_scene, save_scene

NEAR = make_scene(
    [SceneObject("tile", "box", (0.05, 0.05, 0.08), (-0.35, 0.2), 0.2)],
    OnRegion("tile", Region((-0.35, -0.2), 0.0, (0.12, 0.12))),
)
"""One arm does it alone."""


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["plan", *map(str, arguments)])
    return command.main()


def test_a_plan_and_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save_scene(tmp_path / "scene.json", NEAR)
    out = tmp_path / "plans" / "first"
    assert (
        run(monkeypatch, tmp_path / "scene.json", "--k-max", 2, "--no-animation", "--out", out) == 0
    )
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert lines[0].startswith("solved with 2 actions, a motion of ")
    assert (
        lines[1].startswith("  1. ")
        and "grasps tile" in lines[1]
        and "places tile on goal" in lines[2]
    )
    assert lines[3].startswith("NLPs solved: ") and " 1 path" in lines[3]
    assert lines[4].startswith("seconds: ") and ", total " in lines[4]
    assert lines[5] == f"written to {out}/" and "path of grasp" in said.err

    assert {path.name for path in out.iterdir()} == {
        "plan.json", "trajectory.npz", "scene.xml", "film.png", "depth.png",
    }  # fmt: skip
    record = json.loads((out / "plan.json").read_text())
    assert record["status"] == "solved" and record["nlps"]["path"] == 1
    assert record["action_descriptions"] == [line[5:] for line in lines[1:3]]
    assert record["scene"] == json.loads((tmp_path / "scene.json").read_text())
    assert record["options"] == {
        "search": "dvr", "k_max": 2, "seed": 0, "network": load_network("dvr").checksum, "time_limit": 300.0,
        "clearance": 1.0,
        "termination": "optimal",
        "shortest": False,
    }  # fmt: skip
    assert record["versions"]["dvr_jax"] == version("dvr_jax") and record["seconds"]["total"] > 0
    assert max(record["violations"].values()) <= 1e-2
    actions = [
        Action(action["operator"], tuple(action["arguments"])) for action in record["actions"]
    ]
    motion = load_motion(out / "trajectory.npz")
    assert [str(action) for action in Plan.load(out).actions] == [str(action) for action in actions]
    report = check_motion(load_scene(tmp_path / "scene.json"), actions, motion)
    assert report.passed and record["check"]["passed"]
    assert record["check"]["deepest_penetration"] == pytest.approx(
        report.deepest_penetration, abs=1e-9
    )
    assert mujoco.MjModel.from_xml_path(str(out / "scene.xml")).nq == motion.qpos.shape[1]
    # One sign of a rotation: neighbours may be averaged.
    quaternions = motion.qpos[:, -4:]
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.9).all()

    # Where nothing is found, nothing of the other plan stays.
    assert run(monkeypatch, tmp_path / "scene.json", "--k-max", 1, "--out", out) == 1
    said = capsys.readouterr()
    assert said.out.startswith("none found: tree exhausted (at most 1 actions, 300 s)\n")
    assert {path.name for path in out.iterdir()} == {"plan.json", "scene.xml", "depth.png"}
    assert json.loads((out / "plan.json").read_text())["status"] == "tree exhausted"


def test_a_folder_that_cannot_be_is_refused_before_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        run(monkeypatch, "data/scenes/figure1.json", "--out", tmp_path / "file" / "plan")
    assert capsys.readouterr() == ("", "")


def test_a_search_without_a_network_takes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        DvrError, match=r"--search mbts takes no --network; valid with one: dvr, classifier"
    ):
        run(
            monkeypatch,
            "data/scenes/figure1.json",
            "--search",
            "mbts",
            "--network",
            tmp_path / "network.npz",
        )


def test_what_was_printed_before_an_error_is_not_lost() -> None:
    """Nor by the exit that waits for no thread; with standard output as a file, which Python keeps in memory."""
    code = """
from dvr_jax.errors import DvrError, run_command
def main():
    print("solved")
    raise DvrError("the disk is full.")
run_command(main, at_once=True)
"""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    assert (done.returncode, done.stdout, done.stderr) == (
        2,
        "solved\n",
        "error: the disk is full.\n",
    )
