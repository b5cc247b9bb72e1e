"""Motions of planned scenes at 1 kHz, by MuJoCo: limits, rest at switches, straight approaches, the last retreat."""

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dvr_jax import sample_scenes
from dvr_jax.motion.dynamics import arm_dynamics
from dvr_jax.motion.interpolation import spline_of
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.hand_limits import HELD_ACCELERATION, NEAR_DISTANCE, NEAR_SPEED
from dvr_jax.planning.planner import plan
from dvr_jax.planning.result import Plan
from dvr_jax.scene.layout import qpos_layout
from dvr_jax.scene.mjcf import build_model

Floats = NDArray[np.float64]

SCENES = (0, 1, 3)
"""Scenes of seed 12 that have a solution."""

SIDEWAYS = 4e-3
"""Largest distance of a hand from its approach axis in the last 5 cm [m]: the tolerances of both blocks together."""


@dataclass(frozen=True)
class Solved:
    """A plan with its motion at 1 kHz."""

    plan: Plan
    motion: Motion

    def joints(self, arm: int, derivative: int) -> Floats:
        """Joint angles of an arm, or their derivatives, at 1 kHz."""
        given = self.plan.motion
        assert given is not None
        time = np.minimum(self.motion.time, given.time[-1])
        return spline_of(given)(time, derivative)[:, qpos_layout(self.plan.scene).arm_joints[arm]]

    def gripper(self, arm: int, samples: range) -> tuple[Floats, Floats]:
        """Positions [m] and approach axes of a gripper at samples of 1 kHz."""
        model = build_model(self.plan.scene)
        data = mujoco.MjData(model)
        name = f"{self.plan.scene.workcell.arm_names[arm]}/gripper"
        positions = []
        axes = []
        for sample in samples:
            data.qpos[:] = self.motion.qpos[sample]
            mujoco.mj_kinematics(model, data)
            positions.append(data.site(name).xpos.copy())
            axes.append(data.site(name).xmat.reshape(3, 3)[:, 2].copy())
        return np.array(positions), np.array(axes)


@pytest.fixture(scope="module", params=SCENES)
def solved(request: pytest.FixtureRequest) -> Solved:
    scene = list(sample_scenes(max(SCENES) + 1, objects=2, seed=12))[request.param]
    found = plan(scene, "mbts")
    assert found.motion is not None
    return Solved(found, found.motion.sample(1000.0))


def test_limits_of_joints_and_fingers(solved: Solved) -> None:
    scene = solved.plan.scene
    robot = scene.workcell.robot
    for arm in range(scene.workcell.number_of_arms):
        q, velocity, acceleration, jerk = (solved.joints(arm, order) for order in range(4))
        assert (np.abs(velocity) <= robot.joint_velocity).all()
        assert (np.abs(acceleration) <= robot.joint_acceleration).all()
        assert (np.abs(jerk) <= robot.joint_jerk).all()
        # Of the arm without a load, which is in one of both hands only for a part of the motion.
        torque = arm_dynamics(robot).torques(q[::10], velocity[::10], acceleration[::10], 0.0)
        assert (np.abs(torque) <= robot.joint_torque).all()
        fingers = solved.motion.qpos[:, qpos_layout(scene).fingers[arm]]
        assert np.abs(np.diff(fingers, axis=0)).max() <= 1e-3 * robot.finger_speed


def test_all_arms_rest_at_every_switch(solved: Solved) -> None:
    for arm in range(2):
        velocity = solved.joints(arm, 1)[solved.motion.switch]
        acceleration = solved.joints(arm, 2)[solved.motion.switch]
        assert np.abs(velocity).max() < 1e-2 and np.abs(acceleration).max() < 1.0


def test_hands_come_to_their_grasps_straight(solved: Solved) -> None:
    """Seen from the grasp: while the hand is nearer than 4 cm along its axis, it is near this axis."""
    scene = solved.plan.scene
    grasps = 0
    for action, switch in zip(solved.plan.actions, solved.motion.switch.tolist(), strict=True):
        if action.operator != "grasp":
            continue
        arm = scene.workcell.arm_index(action.arguments[0])
        position, axis = solved.gripper(arm, range(max(switch - 2000, 0), switch + 1))
        offset = position - position[-1]
        along = -offset @ axis[-1]
        aside = np.linalg.norm(offset + along[:, None] * axis[-1], axis=1)
        far = np.flatnonzero(along > 0.04)
        assert len(far)
        assert aside[far[-1] :].max() < SIDEWAYS
        grasps += 1
    assert grasps


def test_hands_are_slow_at_their_grasps_and_accelerate_little_afterwards(solved: Solved) -> None:
    scene = solved.plan.scene
    switches = [*solved.motion.switch.tolist(), len(solved.motion.time) - 1]
    grasps = 0
    for index, action in enumerate(solved.plan.actions):
        if action.operator != "grasp":
            continue
        arm = scene.workcell.arm_index(action.arguments[0])
        switch = switches[index]

        # Before the grasp, from where the hand is near it. Rounding raises the speed a little at this point.
        before, _ = solved.gripper(arm, range(max(switch - 2000, 0), switch + 1))
        apart = np.linalg.norm(before - before[-1], axis=1)
        near = np.flatnonzero(apart > NEAR_DISTANCE)[-1] + 1
        speed = np.linalg.norm(np.diff(before[near:], axis=0), axis=1) * 1000.0
        assert 0.5 * NEAR_SPEED < speed.max() < 1.1 * NEAR_SPEED

        # After it, while the hand holds the object.
        after, _ = solved.gripper(arm, range(switch, switches[index + 1] + 1))
        acceleration = np.abs(np.diff(after, 2, axis=0)) * 1e6
        assert 0.2 * HELD_ACCELERATION < acceleration.max() < 1.03 * HELD_ACCELERATION
        grasps += 1
    assert grasps


def test_the_last_hand_retreats(solved: Solved) -> None:
    """By 5 cm back along its approach axis, or less where there is no room, and straight."""
    scene = solved.plan.scene
    last = solved.plan.actions[-1]
    assert last.operator == "place"
    arm = scene.workcell.arm_index(last.arguments[0])
    samples = range(int(solved.motion.switch[-1]), len(solved.motion.time))
    position, axis = solved.gripper(arm, samples)
    offset = position - position[0]
    along = -offset @ axis[0]
    aside = np.linalg.norm(offset + along[:, None] * axis[0], axis=1)
    assert 0.01 <= along[-1] < 0.051
    assert aside.max() < SIDEWAYS


def test_objects_do_not_jump_at_switches(solved: Solved) -> None:
    """In the samples of the plan, between which all arms rest."""
    motion = solved.plan.motion
    assert motion is not None
    for columns in qpos_layout(solved.plan.scene).objects:
        before = motion.qpos[np.asarray(motion.switch) - 1][:, columns]
        after = motion.qpos[motion.switch][:, columns]
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-6)


def test_objects_are_lifted_and_lowered_near_where_they_stand(solved: Solved) -> None:
    """All corners of a box are a centimeter high on its way, farther than 5 cm from where it was and will be."""
    scene = solved.plan.scene
    motion = solved.plan.motion
    assert motion is not None
    starts = [0, *np.asarray(motion.switch).tolist()]
    far_samples = 0
    for index, action in enumerate(solved.plan.actions):
        if action.operator != "place":
            continue
        item = scene.object_index(action.arguments[1])
        poses = motion.qpos[starts[index] : starts[index + 1], qpos_layout(scene).objects[item]]
        rotation = Rotation.from_quat(poses[:, 3:], scalar_first=True)
        half = np.asarray(scene.objects[item].size) / 2
        corners = [rotation.apply(half * signs) for signs in product((-1, 1), repeat=3)]
        lowest = poses[:, 2] + np.min(corners, axis=0)[:, 2]
        start_and_end = poses[[0, -1], :3]
        apart = np.linalg.norm(poses[:, None, :3] - start_and_end, axis=2).min(axis=1)
        far = apart > scene.workcell.clearances.approach
        assert (lowest[far] >= scene.workcell.clearances.lift).all()
        far_samples += int(far.sum())
    assert far_samples
