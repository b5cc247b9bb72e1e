"""Real motions made by hand: numeric inverse kinematics in MuJoCo, joint-space moves, objects carried rigidly."""

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.logic import Action
from dvr_jax.motion import Motion, make_motion
from dvr_jax.scene.mjcf import Layout, build_model, home_qpos, qpos_layout
from dvr_jax.scene.types import FixedBody, OnRegion, Region, Scene, SceneObject
from dvr_jax.workcell.workcell import Workcell

STEP = 0.02
"""Seconds between samples."""

OPEN = 0.04
"""Travel of an open finger [m]."""

Floats = NDArray[np.float64]


def layout_of(number_of_objects: int) -> Layout:
    """Where each quantity lies in the states of the usual workcell with so many objects."""
    item = SceneObject("yellow", "box", (0.05, 0.08, 0.10), (0.0, 0.0), 0.0)
    objects = tuple(replace(item, name=str(number)) for number in range(number_of_objects))
    return qpos_layout(Scene(objects, OnRegion("0", Region((0.0, 0.0), 0.0, (0.2, 0.2)))))


@dataclass
class Puppet:
    """Moves the arms of a scene and writes down every sample."""

    scene: Scene
    samples: list[Floats] = field(default_factory=list)
    switch: list[int] = field(default_factory=list)
    held: dict[int, tuple[int, Floats, Floats]] = field(default_factory=dict)
    """Object to arm, rotation and position in the gripper's frame."""

    def __post_init__(self) -> None:
        self.model = build_model(self.scene)
        self.data = mujoco.MjData(self.model)
        self.layout = qpos_layout(self.scene)
        self.qpos = home_qpos(self.scene)
        self.arm_names = self.scene.workcell.arm_names
        self.limits = self.scene.workcell.robot.joint_limits
        self.samples.append(self.qpos.copy())

    def gripper(self, arm: int, qpos: Floats) -> tuple[Floats, Floats]:
        """Rotation and position of a gripper in the world."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        site = self.data.site(f"{self.arm_names[arm]}/gripper")
        return site.xmat.reshape(3, 3).copy(), site.xpos.copy()

    def reach(self, arm: int, rotation: Floats, position: Floats) -> None:
        """Turn an arm's joints until its gripper has this pose; quintic in time, slow enough."""
        index = self.layout.arm_joints[arm]
        start = self.qpos[index]
        random = np.random.default_rng(0)
        noise = np.concatenate([np.zeros((1, 7)), random.normal(0.0, 0.8, (60, 7))])
        found = (self.solve(arm, rotation, position, start + shift) for shift in noise)
        target = next((angles for angles in found if angles is not None), None)
        assert target is not None, f"arm {arm} does not reach {position}"
        way = np.abs(target - start).max()
        # The largest speed is 1.9 ways over the duration, the largest acceleration 5.8 ways over its square.
        number = int(np.ceil(max(1.9 * way / 1.5, np.sqrt(5.8 * way / 5.0), 20 * STEP) / STEP))
        for s in np.arange(1, number + 1) / number:
            self.qpos[index] = start + (10 * s**3 - 15 * s**4 + 6 * s**5) * (target - start)
            self.record()

    def solve(self, arm: int, rotation: Floats, position: Floats, start: Floats) -> Floats | None:
        """Joint angles (7) by damped Newton steps from a start, or None."""
        index = self.layout.arm_joints[arm]
        site = self.model.site(f"{self.arm_names[arm]}/gripper").id
        dofs = [self.model.joint(f"{self.arm_names[arm]}/joint{j + 1}").dofadr[0] for j in range(7)]
        qpos, jacobian = self.qpos.copy(), np.zeros((6, self.model.nv))
        qpos[index] = np.clip(start, *self.limits)
        for _ in range(100):
            R, p = self.gripper(arm, qpos)
            quaternion, turn = np.zeros(4), np.zeros(3)
            mujoco.mju_mat2Quat(quaternion, (rotation @ R.T).ravel())
            mujoco.mju_quat2Vel(turn, quaternion, 1.0)
            error = np.concatenate([position - p, turn])
            if np.abs(error).max() < 1e-7:
                return qpos[index]
            mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], site)
            J = jacobian[:, dofs]
            step = J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), error)
            qpos[index] += step * min(1.0, 0.2 / np.abs(step).max())
            qpos[index] = np.clip(qpos[index], *self.limits)
        return None

    def fingers(self, arm: int, travel: float) -> None:
        """Open or close a gripper, at 40 mm/s."""
        index = self.layout.fingers[arm]
        start = self.qpos[index].copy()
        number = int(np.ceil(np.abs(travel - start).max() / 0.04 / STEP))
        for s in np.arange(1, number + 1) / number:
            self.qpos[index] = start + s * (travel - start)
            self.record()

    def record(self) -> None:
        """Carry what is held, and write down the sample."""
        for index, (arm, R_hand_object, p_hand_object) in self.held.items():
            R, p = self.gripper(arm, self.qpos)
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, (R @ R_hand_object).ravel())
            self.qpos[self.layout.objects[index]] = [*(p + R @ p_hand_object), *quaternion]
        self.samples.append(self.qpos.copy())

    def attach(self, arm: int, index: int) -> None:
        """From the latest sample on the object is held by this arm alone."""
        R, p = self.gripper(arm, self.qpos)
        pose = self.qpos[self.layout.objects[index]]
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, pose[3:])
        self.held[index] = (arm, R.T @ matrix.reshape(3, 3), R.T @ (pose[:3] - p))
        self.switch.append(len(self.samples) - 1)

    def release(self, index: int) -> None:
        """From the latest sample on the object is held by nobody."""
        del self.held[index]
        self.switch.append(len(self.samples) - 1)

    def motion(self) -> Motion:
        """What was recorded."""
        return make_motion(STEP * np.arange(len(self.samples)), np.stack(self.samples), self.switch)


@dataclass(frozen=True)
class Case:
    """A scene with a sequence and a motion that does it."""

    scene: Scene
    actions: tuple[Action, ...]
    motion: Motion


def hand(closing: tuple[float, float, float], approach: tuple[float, float, float]) -> Floats:
    """Rotation of a gripper with this closing axis (y) and approach (z)."""
    return np.column_stack([np.cross(closing, approach), closing, approach])


def carry_to_goal(item: SceneObject, half_width: float, offset: float = 0.0) -> Case:
    """The left arm carries an object onto the goal; a can stands by. `offset`: of the grasp, along the hand's x."""
    can = SceneObject("can", "cylinder", (0.03, 0.12), (0.25, 0.25), 0.0)
    scene = Scene((item, can), OnRegion(item.name, Region((-0.15, -0.20), 0.2, (0.14, 0.14))))
    puppet = Puppet(scene)
    down = (0.0, 0.0, -1.0)
    above = hand((np.cos(0.3), np.sin(0.3), 0.0), down)
    turned = hand((np.cos(0.2), np.sin(0.2), 0.0), down)
    puppet.reach(0, above, np.array([-0.20, 0.20, 0.16]) + offset * above[:, 0])
    puppet.reach(0, above, np.array([-0.20, 0.20, 0.07]) + offset * above[:, 0])
    puppet.fingers(0, half_width)
    puppet.attach(0, 0)
    puppet.reach(0, above, np.array([-0.20, 0.20, 0.165]) + offset * above[:, 0])
    puppet.reach(0, turned, np.array([-0.15, -0.20, 0.165]) + offset * turned[:, 0])
    puppet.reach(0, turned, np.array([-0.15, -0.20, 0.07]) + offset * turned[:, 0])
    puppet.release(0)
    puppet.fingers(0, OPEN)
    puppet.reach(0, turned, np.array([-0.15, -0.20, 0.17]))
    actions = (
        Action("grasp", ("left", "+x", item.name)),
        Action("place", ("left", item.name, "goal")),
    )
    return Case(scene, actions, puppet.motion())


def carried_box() -> Case:
    """A box that is carried onto the goal."""
    return carry_to_goal(
        SceneObject("yellow", "box", (0.05, 0.08, 0.10), (-0.20, 0.20), 0.3), 0.025
    )


def carried_tin(offset: float = 0.0) -> Case:
    """A cylinder that is carried onto the goal. `offset`: of the grasp, beside the cylinder's axis."""
    tin = SceneObject("tin", "cylinder", (0.03, 0.10), (-0.20, 0.20), 0.3)
    return carry_to_goal(tin, 0.03, offset)


def carry_in_workcell(workcell: Workcell, arm: int, fixed: tuple[FixedBody, ...] = ()) -> Case:
    """An arm of any workcell carries a box from its left to its right; `fixed`: in the frame of the arm's base."""
    base = workcell.arms[arm]
    turn = np.array(
        [
            [np.cos(base.yaw), -np.sin(base.yaw), 0],
            [np.sin(base.yaw), np.cos(base.yaw), 0],
            [0, 0, 1],
        ]
    )

    def world(x: float, y: float, z: float = 0.0) -> Floats:
        return np.array([*base.position, 0.0]) + turn @ [x, y, z]

    def flat(point: Floats) -> tuple[float, float]:
        return (float(point[0]), float(point[1]))

    start = world(0.55, 0.20)
    end = world(0.55, -0.20)
    box = SceneObject("yellow", "box", (0.05, 0.08, 0.10), flat(start), base.yaw)
    placed = tuple(
        replace(body, position=tuple(world(*body.position).tolist()), yaw=body.yaw + base.yaw)
        for body in fixed
    )
    scene = Scene(
        (box,), OnRegion("yellow", Region(flat(end), base.yaw, (0.14, 0.14))), workcell, placed
    )
    puppet = Puppet(scene)
    above = hand(tuple(turn[:, 0]), (0.0, 0.0, -1.0))

    def at(point: Floats, z: float) -> Floats:
        return point + np.array([0.0, 0.0, z])

    puppet.reach(arm, above, at(start, 0.20))
    puppet.reach(arm, above, at(start, 0.07))
    puppet.fingers(arm, 0.025)
    puppet.attach(arm, 0)
    puppet.reach(arm, above, at(start, 0.20))
    puppet.reach(arm, above, at(end, 0.20))
    puppet.reach(arm, above, at(end, 0.07))
    puppet.release(0)
    puppet.fingers(arm, OPEN)
    puppet.reach(arm, above, at(end, 0.20))
    actions = (
        Action("grasp", (base.name, "+x", "yellow")),
        Action("place", (base.name, "yellow", "goal")),
    )
    return Case(scene, actions, puppet.motion())


def handover_of_a_bar() -> Case:
    """The left arm lifts a bar at one end, the right arm takes it at the other and puts it down on the goal."""
    bar = SceneObject("bar", "box", (0.24, 0.05, 0.06), (-0.25, 0.0), 0.0)
    scene = Scene((bar,), OnRegion("bar", Region((0.15, -0.15), 0.0, (0.27, 0.08))))
    puppet = Puppet(scene)
    from_left = hand((0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
    from_right = hand((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    puppet.reach(0, from_left, np.array([-0.34, 0.0, 0.15]))
    puppet.reach(0, from_left, np.array([-0.34, 0.0, 0.04]))
    puppet.fingers(0, 0.025)
    puppet.attach(0, 0)
    puppet.reach(0, from_left, np.array([-0.09, 0.0, 0.33]))
    puppet.reach(1, from_right, np.array([0.09, 0.0, 0.42]))
    puppet.reach(1, from_right, np.array([0.09, 0.0, 0.33]))
    puppet.fingers(1, 0.025)
    puppet.attach(1, 0)
    puppet.fingers(0, OPEN)
    puppet.reach(0, from_left, np.array([-0.15, 0.0, 0.45]))
    puppet.reach(1, from_right, np.array([0.24, -0.15, 0.15]))
    puppet.reach(1, from_right, np.array([0.24, -0.15, 0.04]))
    puppet.release(0)
    actions = (
        Action("grasp", ("left", "-y", "bar")),
        Action("grasp", ("right", "+y", "bar")),
        Action("place", ("right", "bar", "goal")),
    )
    return Case(scene, actions, puppet.motion())
