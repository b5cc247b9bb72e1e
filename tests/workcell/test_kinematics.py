"""Forward kinematics, capsules and joint screws against MuJoCo C and MJX."""

from copy import copy

import jax
import mujoco
import numpy as np
import pytest
from arm_states import POSTURES, Floats, as_arms, matrices, sample_postures, set_postures, vectors

from dvr_jax.scene.files import Goal, Region, SceneObject, make_scene
from dvr_jax.scene.mjcf import CAPSULE_NAMES, build_model, qpos_layout
from dvr_jax.workcell.constants import (
    ARM_NAMES,
    FINGER_OPEN,
    FINGER_SPEED,
    JOINT_ACCELERATION,
    JOINT_LOWER,
    JOINT_UPPER,
    JOINT_VELOCITY,
    MAXIMUM_OPENING,
)
from dvr_jax.workcell.kinematics import base_pose, capsule_segments, hand_pose, joint_screws, link_poses, load_arm

SCENE = make_scene(
    [SceneObject("box", "box", (0.05, 0.1, 0.1), (0.0, 0.3), 0.3)], Goal("box", Region((0, 0), 0, (0.2, 0.2)))
)
TIGHT = {"rtol": 0, "atol": 1e-12}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build_model(SCENE)


class Forward:
    """All forward quantities of the sampled postures, one compilation."""

    def __init__(self) -> None:
        self.q, self.openings = sample_postures()

        def forward(q: Floats, openings: Floats) -> tuple[object, ...]:
            R, p = link_poses(q)
            return R, p, hand_pose(R, p), capsule_segments(R, p, openings), joint_screws(R, p)

        R, p, hand, capsules, screws = jax.jit(forward)(as_arms(self.q), self.openings.T)
        self.link_rotations = np.stack([matrices(r) for r in R])  # [8, 2, n, 3, 3]
        self.link_positions = np.stack([vectors(x) for x in p])  # [8, 2, n, 3]
        self.hand_rotations, self.hand_positions = matrices(hand[0]), vectors(hand[1])  # [2, n, ...]
        self.starts, self.ends = vectors(capsules[0]), vectors(capsules[1])  # [2, C, n, 3]
        self.screws = np.asarray(screws)  # [6, 2, 7, n]


@pytest.fixture(scope="module")
def forward() -> Forward:
    return Forward()


PUBLISHED_LIMITS = [
    # lower [rad], upper [rad], speed [rad/s], acceleration [rad/s^2]
    (-2.8973, 2.8973, 2.1750, 15.0),
    (-1.7628, 1.7628, 2.1750, 7.5),
    (-2.8973, 2.8973, 2.1750, 10.0),
    (-3.0718, -0.0698, 2.1750, 12.5),
    (-2.8973, 2.8973, 2.6100, 15.0),
    (-0.0175, 3.7525, 2.6100, 20.0),
    (-2.8973, 2.8973, 2.6100, 20.0),
]
"""Franka Control Interface documentation, Robot and interface specifications, joint space limits of the Panda."""


def test_joint_limits_are_the_makers(model: mujoco.MjModel) -> None:
    limits = np.array(PUBLISHED_LIMITS)
    np.testing.assert_array_equal(load_arm().joint_limits, limits[:, :2].T)
    np.testing.assert_array_equal([JOINT_LOWER, JOINT_UPPER, JOINT_VELOCITY, JOINT_ACCELERATION], limits.T)
    for arm in ARM_NAMES:
        ranges = [model.joint(f"{arm}/joint{number}").range for number in range(1, 8)]
        np.testing.assert_array_equal(ranges, limits[:, :2])
        fingers = [model.joint(f"{arm}/finger_joint_{side}").range for side in ("left", "right")]
        np.testing.assert_array_equal(fingers, [(0.0, FINGER_OPEN)] * 2)
    # Data sheet of the Franka Hand: grippers open 80 mm, fingers travel at 50 mm/s.
    assert MAXIMUM_OPENING == 0.08 and FINGER_SPEED == 0.05


def test_link_poses(model: mujoco.MjModel, forward: Forward) -> None:
    for n, data in enumerate(set_postures(model, forward.q, forward.openings)):
        for arm, name in enumerate(ARM_NAMES):
            np.testing.assert_allclose(base_pose(arm)[0], data.body(f"{name}/base").xmat.reshape(3, 3), **TIGHT)
            np.testing.assert_allclose(base_pose(arm)[1], data.body(f"{name}/base").xpos, **TIGHT)
            for link in range(8):
                body = data.body(f"{name}/link{link}" if link else f"{name}/base")
                np.testing.assert_allclose(forward.link_rotations[link, arm, n], body.xmat.reshape(3, 3), **TIGHT)
                np.testing.assert_allclose(forward.link_positions[link, arm, n], body.xpos, **TIGHT)


def test_hand_pose(model: mujoco.MjModel, forward: Forward) -> None:
    for n, data in enumerate(set_postures(model, forward.q, forward.openings)):
        for arm, name in enumerate(ARM_NAMES):
            site = data.site(f"{name}/gripper")
            np.testing.assert_allclose(forward.hand_rotations[arm, n], site.xmat.reshape(3, 3), **TIGHT)
            np.testing.assert_allclose(forward.hand_positions[arm, n], site.xpos, **TIGHT)


def test_capsules(model: mujoco.MjModel, forward: Forward) -> None:
    """Ends and radii, fingers partly open, in the order of the model's capsules."""
    assert tuple(f"{name}_collision" for name in load_arm().capsule_names) == CAPSULE_NAMES
    for n, data in enumerate(set_postures(model, forward.q, forward.openings)):
        for arm, name in enumerate(ARM_NAMES):
            for c, capsule in enumerate(CAPSULE_NAMES):
                geom = data.geom(f"{name}/{capsule}")
                size = model.geom(f"{name}/{capsule}").size
                axis = geom.xmat.reshape(3, 3)[:, 2] * size[1]
                np.testing.assert_allclose(forward.starts[arm, c, n], geom.xpos - axis, **TIGHT)
                np.testing.assert_allclose(forward.ends[arm, c, n], geom.xpos + axis, **TIGHT)
                assert load_arm().capsule_radii[c] == size[0]


def test_an_arm_is_its_own_mirror_image_but_for_forearm_and_flange(model: mujoco.MjModel) -> None:
    """What can be done with y reversed as well; the gripper's closing axis has no direction, fingers change places."""
    q, openings = sample_postures()
    mirrored = q * [-1, 1, -1, 1, -1, 1, -1]  # the hand is turned by -pi/4 on the flange
    mirrored[..., 6] += np.where(q[..., 6] > np.pi / 2 - JOINT_UPPER[6], np.pi / 2, -np.pi / 2)
    assert ((mirrored >= JOINT_LOWER) & (mirrored <= JOINT_UPPER)).all()
    symmetric = [name for name in CAPSULE_NAMES if name.split("_")[0] not in ("forearm", "flange", "finger")]
    signs = np.array([1.0, -1.0, 1.0])

    def seen(data: mujoco.MjData, arm: str) -> list[Floats]:
        grip, capsules = data.site(f"{arm}/gripper"), [data.geom(f"{arm}/{name}") for name in symmetric]
        fingers = [data.geom(f"{arm}/{name}").xpos for name in CAPSULE_NAMES if "finger" in name]
        return [grip.xpos, *(capsule.xpos for capsule in capsules), *sorted(fingers, key=lambda p: p[0])]

    both = zip(*(list(map(copy, set_postures(model, x, openings))) for x in (q, mirrored)), strict=True)
    for here, there in both:
        for arm in ARM_NAMES:
            np.testing.assert_allclose(np.multiply(seen(here, arm), signs), seen(there, arm), **TIGHT)
            approach, closing = (there.site(f"{arm}/gripper").xmat.reshape(3, 3)[:, i] for i in (2, 1))
            expected = here.site(f"{arm}/gripper").xmat.reshape(3, 3) * signs[:, None]
            np.testing.assert_allclose(approach, expected[:, 2], **TIGHT)
            np.testing.assert_allclose(abs(closing @ expected[:, 1]), 1, **TIGHT)


def test_joint_screws(model: mujoco.MjModel, forward: Forward) -> None:
    """A screw is the joint's column of `mj_jac` for the point of its link at the world's origin."""
    origin = np.zeros(3)
    for n, data in enumerate(set_postures(model, forward.q, forward.openings)):
        for arm, name in enumerate(ARM_NAMES):
            linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, linear, angular, origin, model.body(f"{name}/link7").id)
            for joint in range(7):
                dof = model.joint(f"{name}/joint{joint + 1}").dofadr[0]
                expected = np.concatenate([angular[:, dof], linear[:, dof]])
                np.testing.assert_allclose(forward.screws[:, arm, joint, n], expected, **TIGHT)


def test_links_against_mjx(model: mujoco.MjModel, forward: Forward) -> None:
    mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx is an extra of the tests")
    device_model, data = mjx.put_model(model), mjx.make_data(model)

    def kinematics(qpos: Floats) -> tuple[Floats, Floats]:
        moved = mjx.kinematics(device_model, data.replace(qpos=qpos))
        return moved.xpos, moved.xmat

    layout = qpos_layout(len(SCENE.objects))
    qpos = np.tile(model.key("home").qpos, (POSTURES, 1))
    qpos[:, layout.arm_joints], qpos[:, layout.fingers] = forward.q, forward.openings[:, :, None]
    positions, rotations = (np.asarray(x) for x in jax.jit(jax.vmap(kinematics))(qpos))
    for arm, name in enumerate(ARM_NAMES):
        for link in range(1, 8):
            body = model.body(f"{name}/link{link}").id
            np.testing.assert_allclose(forward.link_positions[link, arm], positions[:, body], **TIGHT)
            rotation = rotations[:, body].reshape(-1, 3, 3)
            np.testing.assert_allclose(forward.link_rotations[link, arm], rotation, **TIGHT)
