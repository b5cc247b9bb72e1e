"""Robots that only these tests define are planned with and checked; none of them is known to the package."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from other_robots import LONG_PANDA, SIX_JOINTS

from dvr_jax.checker.replay import check_motion
from dvr_jax.errors import SceneError
from dvr_jax.planning.planner import plan
from dvr_jax.scene.files import load_scene, save_scene
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import validate_scene
from dvr_jax.workcell import robot as registry
from dvr_jax.workcell.model import workcell_model
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import Robot, register_robot
from dvr_jax.workcell.workcell import Arm, Workcell

ROBOTS = {robot.name: robot for robot in (LONG_PANDA, SIX_JOINTS)}
BOX = SceneObject("box", "box", (0.05, 0.08, 0.10), (-0.25, 0.05), 0.4)
GOAL = OnRegion("box", Region((0.25, 0.05), 0.3, (0.16, 0.16)))


def single_arm(robot: Robot) -> Scene:
    workcell = Workcell((Arm("arm", (0.0, -0.4), math.pi / 2, robot.home),), robot)
    return Scene((BOX,), GOAL, workcell)


def facing_arms(robot: Robot) -> Scene:
    """A box that one arm has to give to the other."""
    arms = (Arm("west", (-0.7, 0.0), 0.0, robot.home), Arm("east", (0.7, 0.0), math.pi, robot.home))
    bar = SceneObject("bar", "box", (0.05, 0.24, 0.08), (-0.4, 0.3), 0.4)
    return Scene(
        (bar,), OnRegion("bar", Region((0.45, 0.25), 0.3, (0.3, 0.3))), Workcell(arms, robot)
    )


def gripper_poses(robot: Robot, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (3, 3, L), columns first, and centers (3, L) [m] of the gripper in the base's frame, by MuJoCo."""
    data = mujoco.MjData(robot.model)
    rotations = []
    centers = []
    for q in angles:
        for number, angle in enumerate(q, start=1):
            data.joint(f"joint{number}").qpos = angle
        mujoco.mj_kinematics(robot.model, data)
        site = data.site("gripper")
        rotations.append(site.xmat.reshape(3, 3).T.copy())
        centers.append(site.xpos.copy())
    return np.stack(rotations, axis=-1), np.stack(centers, axis=-1)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_the_inverse_kinematics_finds_the_posture_that_mujoco_shows(robot: Robot) -> None:
    model = workcell_model(single_arm(robot).workcell)
    lower, upper = robot.joint_limits
    q = np.random.default_rng(0).uniform(lower, upper, (200, robot.number_of_joints))
    if robot is LONG_PANDA:
        # Less bent than this, a posture has a more bent one of the same gripper pose, which is taken instead.
        q[:, 3] = np.minimum(q[:, 3], -0.6)
    R, p = gripper_poses(robot, q)
    kinematics = robot.inverse_kinematics
    found, failure = kinematics.solve(model, R, p, q.T[list(kinematics.free_joints)])
    assert found.shape == (robot.number_of_joints, kinematics.branches, len(q))

    distance = np.abs(np.asarray(found) - q.T[:, None]).max(axis=0)
    assert (distance.min(axis=0) < 1e-6).all()

    # Every branch that claims to reach the pose does.
    reached = np.argwhere(np.asarray(failure) == 0)
    assert len(reached) >= len(q)
    for branch, lane in reached[::7]:
        rotation, center = gripper_poses(robot, np.asarray(found)[None, :, branch, lane])
        np.testing.assert_allclose(rotation[..., 0], R[..., lane], atol=1e-6)
        np.testing.assert_allclose(center[:, 0], p[:, lane], atol=1e-6)


@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(robot, id=name, marks=pytest.mark.slow if robot is LONG_PANDA else ())
        for name, robot in ROBOTS.items()
    ],
)
def test_it_carries_a_box(robot: Robot) -> None:
    scene = single_arm(robot)
    validate_scene(scene)
    found = plan(scene, "mbts", k_max=2)
    assert found.solved and found.motion is not None
    assert [action.operator for action in found.actions] == ["grasp", "place"]
    assert found.motion.qpos.shape[1] == robot.number_of_joints + 2 + 7
    assert check_motion(scene, found.actions, found.motion).passed


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_two_of_them_hand_a_bar_over(robot: Robot) -> None:
    scene = facing_arms(robot)
    lines: list[str] = []
    found = plan(scene, "dvr", k_max=4, progress=lines.append)
    assert found.solved and found.motion is not None and len(found.actions) >= 3
    assert {action.arguments[0] for action in found.actions} == {"west", "east"}
    assert lines[0].startswith("the shipped network does not fit: ")
    assert check_motion(scene, found.actions, found.motion).passed


def test_a_scene_file_names_it_once_it_is_registered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = single_arm(SIX_JOINTS)
    with pytest.raises(SceneError, match="no robot is registered as 'six-joints'"):
        save_scene(tmp_path / "scene.json", scene)
    # So that the registry forgets the robot after the test.
    monkeypatch.setitem(registry._ROBOTS, SIX_JOINTS.name, PANDA)
    register_robot(SIX_JOINTS)
    save_scene(tmp_path / "scene.json", scene)
    assert load_scene(tmp_path / "scene.json") == scene
