"""The command `python -m dvr_jax.export`: both files are read back and compared with the plan."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from puppet import Case, carried_box
from puppet_plans import plan_of
from scipy.interpolate import make_interp_spline

from dvr_jax.cli import export
from dvr_jax.errors import DataError, OptionError
from dvr_jax.scene.layout import qpos_layout

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def case() -> Case:
    return carried_box()


@pytest.fixture(scope="module")
def folder(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    plan_of(case, case.motion).save(folder, pictures=False, animation=False)
    assert export.main([str(folder)]) == 0
    return folder


def spline_values(case: Case, time: Floats, derivative: int) -> Floats:
    """States, or their derivatives, by SciPy's B-splines: the spline at rest at both ends."""
    rest = [(1, np.zeros(case.motion.qpos.shape[1]))]
    start = case.motion.time - case.motion.time[0]
    spline = make_interp_spline(start, case.motion.qpos, bc_type=(rest, rest))
    return spline(time, derivative)


def test_set_points_as_csv(case: Case, folder: Path) -> None:
    lines = (folder / "trajectory.csv").read_text().splitlines()
    names = lines[0].split(",")
    joints = [f"joint{number}" for number in range(1, 8)]
    expected = [f"{arm}/{name}" for arm in ("left", "right") for name in (*joints, "gap")]
    assert names == ["time", *expected]

    table = np.loadtxt(lines[1:], delimiter=",")
    duration = case.motion.time[-1] - case.motion.time[0]
    np.testing.assert_allclose(np.diff(table[:, 0]), 1e-3, atol=1e-9)
    assert duration <= table[-1, 0] + 1e-9 < duration + 2e-3
    states = spline_values(case, np.minimum(table[:, 0], duration), 0)
    layout = qpos_layout(case.scene)
    for arm in range(2):
        first = 1 + 8 * arm
        np.testing.assert_allclose(
            table[:, first : first + 7], states[:, layout.arm_joints[arm]], atol=1e-8
        )
        gap = states[:, layout.fingers[arm]].sum(axis=1)
        np.testing.assert_allclose(table[:, first + 7], gap, atol=1e-8)


def seconds(duration: dict[str, int]) -> float:
    assert set(duration) == {"sec", "nanosec"} and 0 <= duration["nanosec"] < 10**9
    return duration["sec"] + 1e-9 * duration["nanosec"]


def test_trajectories_with_the_fields_of_ros_messages(case: Case, folder: Path) -> None:
    content = json.loads((folder / "trajectory.ros.json").read_text())
    assert list(content) == ["arms", "grippers"]
    layout = qpos_layout(case.scene)
    for arm, name in enumerate(("left", "right")):
        message = content["arms"][name]
        assert set(message) == {"header", "joint_names", "points"}
        assert message["joint_names"] == [f"{name}/joint{number}" for number in range(1, 8)]
        assert set(message["header"]) == {"stamp", "frame_id"}
        fields = {"positions", "velocities", "accelerations", "effort", "time_from_start"}
        assert all(set(point) == fields for point in message["points"])

        time = np.array([seconds(point["time_from_start"]) for point in message["points"]])
        np.testing.assert_allclose(time, case.motion.time - case.motion.time[0], atol=1e-9)
        for derivative, field in enumerate(("positions", "velocities", "accelerations")):
            values = np.array([point[field] for point in message["points"]])
            expected = spline_values(case, time, derivative)[:, layout.arm_joints[arm]]
            np.testing.assert_allclose(values, expected, atol=1e-8 * 1e3**derivative)


def test_gripper_commands(case: Case, folder: Path) -> None:
    """The left gripper closes on the box and opens again; each command begins when its fingers begin to move."""
    grippers = json.loads((folder / "trajectory.ros.json").read_text())["grippers"]
    assert grippers["right"] == []
    close, release = grippers["left"]
    gap = case.motion.qpos[:, qpos_layout(case.scene).fingers[0]].sum(axis=1)
    assert close["command"] == {"position": pytest.approx(gap.min()), "max_effort": 70.0}
    assert release["command"] == {"position": pytest.approx(gap[-1]), "max_effort": 0.0}
    for command, before in ((close, gap[0]), (release, gap.min())):
        started = seconds(command["time_from_start"])
        sample = int(np.argmin(np.abs(case.motion.time - case.motion.time[0] - started)))
        assert gap[sample] == pytest.approx(before, abs=1e-6)
        assert abs(gap[sample + 1] - before) > 1e-6


def test_another_folder_and_another_rate(case: Case, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "robot"
    assert export.main([str(folder), "--out", str(out), "--rate", "100"]) == 0
    table = np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(np.diff(table[:, 0]), 1e-2, atol=1e-9)
    assert (out / "trajectory.ros.json").exists()


def test_refusals(case: Case, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="valid is a folder that a plan was saved to"):
        export.main([str(tmp_path)])
    with pytest.raises(OptionError, match="the rate is 0 samples a second; valid is 1 to 10000"):
        export.main([str(folder), "--rate", "0"])
    plan_of(case, None).save(tmp_path, pictures=False, animation=False)
    with pytest.raises(DataError, match="is not solved, so that it has no motion"):
        export.main([str(tmp_path)])
