"""Object poses in every mode against their definition, their copies on the host, and twists against differences."""

import jax
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dvr_jax.modes import fixed, held, placed
from dvr_jax.modes.mode import PARAMETERS, Attachment, HandPoses, ModeKind, ObjectPoses
from dvr_jax.modes.poses import object_poses

Floats = NDArray[np.float64]

STEP = 1e-5
KINDS = (ModeKind.FIXED, ModeKind.PLACED, ModeKind.HELD, ModeKind.HELD, ModeKind.ABSENT)
"""Of the objects in the first slice; in each further one they have moved on by one."""

compiled_poses = jax.jit(object_poses)


class World:
    """Random attachments of N objects in L slices, and random grippers of A arms."""

    def __init__(self, arms: int, seed: int = 0, L: int = 11) -> None:
        generator = np.random.default_rng(seed)
        N = len(KINDS)
        kind = np.array([np.roll(KINDS, index) for index in range(L)], np.int32).T
        is_held = kind == ModeKind.HELD
        self.attached = Attachment(
            kind=kind,
            parent=np.where(is_held, generator.integers(arms, size=(N, L)), 0).astype(np.int32),
            parameters=generator.uniform(-1, 1, (PARAMETERS, N, L)),
            closing_yaw=np.where(is_held, generator.uniform(-3, 3, (N, L)), 0),
            initial_pose=generator.uniform(-1, 1, (4, N, L)),
            half_height=generator.uniform(0.01, 0.2, (N, L)),
        )
        self.hand_R = (
            Rotation.random(arms * L, random_state=seed).as_matrix().reshape(arms, L, 3, 3)
        )
        self.hand_p = generator.uniform(-1, 1, (arms, L, 3))
        self.hands = HandPoses(self.hand_R.transpose(3, 2, 0, 1), self.hand_p.transpose(2, 0, 1))

    def poses(self, attached: Attachment | None = None) -> ObjectPoses:
        return jax.tree.map(
            np.asarray, compiled_poses(self.attached if attached is None else attached, self.hands)
        )

    def each(self):
        """Object, slice, and its kind."""
        for (n, index), kind in np.ndenumerate(self.attached.kind):
            yield n, index, ModeKind(kind)

    def on_host(self, n: int, index: int) -> tuple[Rotation, Floats]:
        """By the functions that move objects on the host."""
        attached = self.attached
        m = attached.parameters[:, n, index]
        kind = attached.kind[n, index]
        if kind == ModeKind.HELD:
            arm = attached.parent[n, index]
            yaw = float(attached.closing_yaw[n, index])
            R, p = held.pose_on_host(m, yaw, self.hand_R[arm, [index]], self.hand_p[arm, [index]])
            return R[0], p[0]
        if kind == ModeKind.PLACED:
            return placed.pose_on_host(m, float(attached.half_height[n, index]))
        return fixed.pose_on_host(attached.initial_pose[:, n, index])

    def by_definition(self, n: int, index: int) -> tuple[Rotation, Floats]:
        """Written down once more, with rotations in place of formulas."""
        attached = self.attached
        m = attached.parameters[:, n, index]
        kind = attached.kind[n, index]
        if kind == ModeKind.PLACED:
            return Rotation.from_euler("z", m[2]), np.array(
                [m[0], m[1], m[3] + attached.half_height[n, index]]
            )
        if kind != ModeKind.HELD:
            x, y, z, yaw = attached.initial_pose[:, n, index]
            return Rotation.from_euler("z", yaw), np.array([x, y, z])
        # At yaw 0 and pitch 0 the gripper points straight down (its z) and closes along +x (its y); the pitch turns it
        # about the closing axis, toward the face's tangent.
        face = Rotation.from_euler("z", attached.closing_yaw[n, index] + m[3])
        down = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
        hand_in_object = face * Rotation.from_euler("x", m[2]) * down
        center_in_object = face.apply([0, m[0], m[1]])
        arm = attached.parent[n, index]
        R = Rotation.from_matrix(self.hand_R[arm, index]) * hand_in_object.inv()
        return R, self.hand_p[arm, index] - R.apply(center_in_object)


@pytest.fixture(scope="module", params=[1, 2])
def world(request: pytest.FixtureRequest) -> World:
    return World(request.param)


def test_poses_are_the_definition(world: World) -> None:
    poses = world.poses()
    for n, index, _ in world.each():
        R, p = world.by_definition(n, index)
        np.testing.assert_allclose(poses.rotation[:, :, n, index].T, R.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(poses.position[:, n, index], p, atol=1e-12)


def test_poses_on_the_host_are_the_same(world: World) -> None:
    poses = world.poses()
    for n, index, _ in world.each():
        R, p = world.on_host(n, index)
        np.testing.assert_allclose(poses.rotation[:, :, n, index].T, R.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(poses.position[:, n, index], p, atol=1e-12)


def test_a_held_object_keeps_its_place_in_a_moving_hand() -> None:
    """`pose_on_host` of many samples at once."""
    world = World(1, seed=3, L=20)
    m = np.array([0.02, -0.03, 0.4, 0.3])
    R, p = held.pose_on_host(m, 1.2, world.hand_R[0], world.hand_p[0])
    assert len(R) == len(p) == 20
    frame_R, frame_p = held.frame_on_host(m, 1.2)
    for n in range(20):
        np.testing.assert_allclose(R[n].as_matrix() @ frame_R, world.hand_R[0, n], atol=1e-12)
        np.testing.assert_allclose(R[n].apply(frame_p) + p[n], world.hand_p[0, n], atol=1e-12)


def test_grasp_frames_on_the_host_are_the_same() -> None:
    generator = np.random.default_rng(0)
    m, yaw = generator.uniform(-1, 1, (4, 9)), generator.uniform(-3, 3, 9)
    frame = held.grasp_frame(m, yaw)
    for i in range(9):
        R, p = held.frame_on_host(m[:, i], float(yaw[i]))
        np.testing.assert_allclose(np.asarray(frame.rotation)[:, :, i].T, R, atol=1e-12)
        np.testing.assert_allclose(np.asarray(frame.position)[:, i], p, atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1)
    # The closing axis is hand y, the approach hand z; without a pitch it is straight down.
    R, p = held.frame_on_host(np.array([0.02, 0.03, 0.0, 0.0]), 0.0)
    np.testing.assert_allclose(R, np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), atol=1e-12)
    np.testing.assert_allclose(p, [0, 0.02, 0.03], atol=1e-12)


def test_twists_are_the_differences(world: World) -> None:
    """Of the pose by each parameter: angular velocity, and the velocity of the point at the world's origin."""
    poses = world.poses()
    for parameter in range(PARAMETERS):
        ahead, behind = (
            world.poses(
                world.attached._replace(parameters=world.attached.parameters + sign * STEP * one)
            )
            for sign, one in ((s, np.eye(PARAMETERS)[parameter][:, None, None]) for s in (1, -1))
        )
        for n, index, _ in world.each():
            after, before = (
                Rotation.from_matrix(side.rotation[:, :, n, index].T) for side in (ahead, behind)
            )
            angular = (after * before.inv()).as_rotvec() / (2 * STEP)
            moved = (ahead.position - behind.position)[:, n, index] / (2 * STEP)
            linear = moved - np.cross(angular, poses.position[:, n, index])
            expected = np.concatenate([angular, linear])
            np.testing.assert_allclose(poses.twists[:, parameter, n, index], expected, atol=1e-8)


def test_what_an_object_depends_on(world: World) -> None:
    """A standing object moves with no arm, a held one with its parent; only attached ones have twists."""
    poses = world.poses()
    for n, index, kind in world.each():
        holders = np.flatnonzero(poses.held[:, n, index])
        expected = [world.attached.parent[n, index]] if kind == ModeKind.HELD else []
        np.testing.assert_array_equal(holders, expected)
        twists = poses.twists[:, :, n, index]
        used = np.flatnonzero(np.abs(twists).max(0) > 0)
        expected = {ModeKind.HELD: [0, 1, 2, 3], ModeKind.PLACED: [0, 1, 2, 3]}.get(kind, [])
        np.testing.assert_array_equal(used, expected)
