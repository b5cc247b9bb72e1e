"""The MuJoCo model against Franka's Denavit-Hartenberg table, its own XML, and what may touch what."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from dvr_jax.errors import DvrError, SceneError
from dvr_jax.scene.files import FixedBody, OnRegion, Region, Scene, SceneObject, make_scene
from dvr_jax.scene.mjcf import (
    COLLISION_GROUP,
    GOAL_GROUP,
    LOOKS_GROUP,
    SOLID_GROUP,
    build_home_data,
    build_model,
    fixed_body_name,
    home_qpos,
    object_body_name,
    qpos_layout,
    require_free_home,
    scene_xml,
)
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.workcell import (
    DEFAULT_WORKCELL,
    WORKCELLS,
    Arm,
    Workcell,
    base_positions,
    base_rotations,
)

CAPSULE_NAMES = tuple(f"{name}_collision" for name in PANDA.capsules.names)
ARM_NAMES = DEFAULT_WORKCELL.arm_names
ODD_NAME = 'a/b "<&> ü 日本'
CAPSULES_OF_BODIES = {
    "base": 1,
    "link1": 1,
    "link2": 1,
    "link3": 1,
    "link4": 1,
    "link5": 1,
    "link6": 2,
    "link7": 1,
    "hand": 2,
    "finger_left": 3,
    "finger_right": 3,
}
"""How many capsules each body of an arm has."""

REGION = Region((0.3, 0.2), 0.4, (0.25, 0.2))
SCENE = make_scene(
    [
        SceneObject("yellow", "box", (0.05, 0.2, 0.1), (-0.4, 0.1), 0.3),
        SceneObject(ODD_NAME, "cylinder", (0.03, 0.14), (0.2, -0.1), 1.0),
    ],
    OnRegion("yellow", REGION),
)

# Franka's published table, row by row: a, d, alpha (m, m, rad); rows 1 to 7 are joints, row 8 is the flange.
DH_TABLE = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -math.pi / 2),
    (0.0, 0.316, math.pi / 2),
    (0.0825, 0.0, math.pi / 2),
    (-0.0825, 0.384, -math.pi / 2),
    (0.0, 0.0, math.pi / 2),
    (0.088, 0.0, math.pi / 2),
    (0.0, 0.107, 0.0),
]


def dh_transform(a: float, d: float, alpha: float, theta: float) -> NDArray[np.float64]:
    """One row of the table in Craig's convention, written out as in his book."""
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array(
        [
            [ct, -st, 0, a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
    )


def rotation_z(angle: float) -> NDArray[np.float64]:
    return dh_transform(0.0, 0.0, 0.0, angle)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build_model(SCENE)


def random_states(model: mujoco.MjModel, number: int) -> Iterator[mujoco.MjData]:
    """States with arms anywhere within their limits, every second time stretched towards each other; only positions
    are computed."""
    generator, layout, data = np.random.default_rng(0), qpos_layout(SCENE), build_home_data(model)
    for index in range(number):
        angles = generator.uniform(*PANDA.joint_limits, (2, 7))
        if index % 2:
            angles[:, [0, 1, 3]] = generator.uniform([-0.4, 0.5, -1.5], [0.4, 1.7, -0.1], (2, 3))
        data.qpos[layout.arm_joints] = angles
        data.qpos[layout.fingers] = generator.uniform(0, 0.04, (2, 2))
        mujoco.mj_kinematics(model, data)
        yield data


def test_frames_are_those_of_the_table(model: mujoco.MjModel) -> None:
    layout = qpos_layout(SCENE)
    for data in random_states(model, 20):
        for arm, name in enumerate(ARM_NAMES):
            T_world_link = rotation_z(DEFAULT_WORKCELL.arms[arm].yaw)
            T_world_link[:2, 3] = DEFAULT_WORKCELL.arms[arm].position
            angles = [*data.qpos[layout.arm_joints[arm]], 0.0]
            for row, (a, d, alpha) in enumerate(DH_TABLE):
                T_world_link = T_world_link @ dh_transform(a, d, alpha, angles[row])
                if row < 7:
                    body = data.body(f"{name}/link{row + 1}")
                    np.testing.assert_allclose(body.xpos, T_world_link[:3, 3], atol=1e-12)
                    np.testing.assert_allclose(
                        body.xmat.reshape(3, 3), T_world_link[:3, :3], atol=1e-12
                    )
            T_world_hand = T_world_link @ rotation_z(-math.pi / 4)
            hand, gripper = data.body(f"{name}/hand"), data.site(f"{name}/gripper")
            np.testing.assert_allclose(hand.xpos, T_world_hand[:3, 3], atol=1e-12)
            np.testing.assert_allclose(hand.xmat.reshape(3, 3), T_world_hand[:3, :3], atol=1e-12)
            np.testing.assert_allclose(
                gripper.xpos, (T_world_hand @ [0, 0, 0.1034, 1])[:3], atol=1e-12
            )
            for side, sign, travel in zip(
                ("left", "right"), (1, -1), data.qpos[layout.fingers[arm]], strict=True
            ):
                expected = (T_world_hand @ [0, sign * travel, 0.0584, 1])[:3]
                np.testing.assert_allclose(
                    data.body(f"{name}/finger_{side}").xpos, expected, atol=1e-12
                )


def test_layout_limits_and_home(model: mujoco.MjModel) -> None:
    layout = qpos_layout(SCENE)
    assert layout.size == model.nq == 32
    for arm, name in enumerate(ARM_NAMES):
        for index in range(7):
            joint = model.joint(f"{name}/joint{index + 1}")
            assert joint.qposadr[0] == layout.arm_joints[arm, index]
            assert tuple(joint.range) == tuple(PANDA.joint_limits[:, index])
        for index, side in enumerate(("left", "right")):
            joint = model.joint(f"{name}/finger_joint_{side}")
            assert joint.qposadr[0] == layout.fingers[arm, index]
            assert tuple(joint.range) == (0.0, 0.04)
    for index, item in enumerate(SCENE.objects):
        assert (
            model.joint(f"{object_body_name(item.name)}/joint").qposadr[0]
            == layout.objects[index, 0]
        )
    np.testing.assert_allclose(model.key("home").qpos, home_qpos(SCENE), atol=1e-15)
    # The maker's home posture: gripper 0.307 m before the base, pointing down.
    data = build_home_data(model)
    np.testing.assert_allclose(
        data.site("left/gripper").xpos, [-0.75 + 0.3069, 0.0, 0.4869], atol=1e-4
    )
    np.testing.assert_allclose(
        data.site("right/gripper").xmat.reshape(3, 3)[:, 2], [0, 0, -1], atol=1e-12
    )


def test_xml_stands_alone_and_is_the_same_model(model: mujoco.MjModel) -> None:
    again = mujoco.MjModel.from_xml_string(scene_xml(SCENE))
    assert (again.nq, again.nv, again.ngeom, again.nu) == (
        model.nq,
        model.nv,
        model.ngeom,
        model.nu,
    )
    for name in (
        "body_pos",
        "body_quat",
        "geom_pos",
        "geom_size",
        "geom_quat",
        "jnt_range",
        "key_qpos",
        "cam_pos",
    ):
        np.testing.assert_allclose(
            getattr(again, name), getattr(model, name), atol=6e-6, err_msg=name
        )
    assert again.geom_contype.tolist() == model.geom_contype.tolist()
    assert object_body_name(ODD_NAME) in [again.body(index).name for index in range(again.nbody)]


def test_seventeen_capsules_an_arm_on_all_its_bodies(model: mujoco.MjModel) -> None:
    for arm in ARM_NAMES:
        names = [
            model.geom(g).name
            for g in range(model.ngeom)
            if model.geom_group[g] == COLLISION_GROUP and model.geom(g).name.startswith(arm)
        ]
        assert names == [f"{arm}/{name}" for name in CAPSULE_NAMES]
        assert all(model.geom(name).type == mujoco.mjtGeom.mjGEOM_CAPSULE for name in names)
        bodies = Counter(model.body(model.geom(name).bodyid[0]).name for name in names)
        assert bodies == {f"{arm}/{body}": number for body, number in CAPSULES_OF_BODIES.items()}
        assert bodies.total() == 17


def test_finger_pads_lie_at_half_the_opening(model: mujoco.MjModel) -> None:
    """The capsules beside the pads reach 1 mm over them, those behind stay back."""
    data, layout = build_home_data(model), qpos_layout(SCENE)

    def finger(side: str, part: str) -> int:
        return int(model.geom(f"left/finger_{side}_{part}_collision").id)

    for travel in (0.0, 0.013, 0.04):
        data.qpos[layout.fingers] = travel
        mujoco.mj_kinematics(model, data)
        for part, overhang in (("front", 1e-3), ("rear", 1e-3), ("back", -0.0065)):
            pair = (finger("left", part), finger("right", part))
            gap = mujoco.mj_geomDistance(model, data, *pair, 1.0, None)
            assert gap == pytest.approx(2 * (travel - overhang), abs=1e-9), part
    # The axes of those beside the pads end 6 mm below the gripper center; at home the hand points down.
    for side, part in product(("left", "right"), ("front", "rear")):
        geom = finger(side, part)
        axis = data.geom_xmat[geom].reshape(3, 3)[2, 2] * model.geom_size[geom, 1]
        assert data.geom_xpos[geom, 2] - abs(axis) == pytest.approx(
            data.site("left/gripper").xpos[2] - 0.006, abs=1e-9
        )


def test_who_touches_whom(model: mujoco.MjModel) -> None:
    seen = set()
    for data in random_states(model, 3000):
        mujoco.mj_collision(model, data)
        for first, second in data.contact.geom:
            seen.add(frozenset((model.geom(first).name, model.geom(second).name)))
            for geom in (first, second):
                assert model.geom_group[geom] not in (LOOKS_GROUP, GOAL_GROUP)
    # Of each arm, only those pairs touch that its robot lists. Base, shoulder, upper arm and both elbows cannot come
    # down to the table.
    listed = {
        frozenset((CAPSULE_NAMES[i], CAPSULE_NAMES[j]))
        for near, far in PANDA.self_collision_pairs
        for i, j in product(range(*near), range(*far))
    }
    above_table = {CAPSULE_NAMES[c] for c in range(*PANDA.table_capsules)}
    assert len(above_table) == 12
    for arm in ARM_NAMES:
        own = {frozenset(f"{arm}/{name}" for name in pair) for pair in listed}
        assert {pair for pair in seen if all(name.startswith(f"{arm}/") for name in pair)} <= own
        touching = {name for pair in seen if "table" in pair for name in pair - {"table"}}
        assert {name for name in touching if name.startswith(f"{arm}/")} == {
            f"{arm}/{name}" for name in above_table
        }
    assert frozenset(("left/base_collision", "left/forearm_collision")) in seen
    assert frozenset(("left/forearm_collision", "left/flange_collision")) in seen
    assert frozenset(("left/hand_collision", "object/yellow")) in seen
    assert any({name.split("/")[0] for name in pair} == {"left", "right"} for pair in seen)


def test_objects_stand_where_the_scene_says_and_stay(model: mujoco.MjModel) -> None:
    data, layout = build_home_data(model), qpos_layout(SCENE)
    assert data.ncon == 0 or {"table"} <= {
        model.geom(g).name for pair in data.contact.geom for g in pair
    }
    for _ in range(500):
        mujoco.mj_step(model, data)
    start = home_qpos(SCENE)
    np.testing.assert_allclose(data.qpos[layout.objects], start[layout.objects], atol=1e-3)
    np.testing.assert_allclose(data.qpos[layout.arm_joints], start[layout.arm_joints], atol=0.02)
    goal = model.geom("goal")
    np.testing.assert_allclose(goal.pos, [*REGION.position, 0.0])
    np.testing.assert_allclose(goal.size[:2], np.array(REGION.size) / 2)


def test_objects_have_the_mass_that_mujoco_computes() -> None:
    objects = (
        SceneObject("box", "box", (0.05, 0.2, 0.1), (-0.3, 0.1), 0.3, density=700.0),
        SceneObject("can", "cylinder", (0.03, 0.12), (0.2, -0.1), 0.0, density=2700.0),
    )
    model = build_model(replace(SCENE, objects=objects, goal=replace(SCENE.goal, object="box")))
    for item in objects:
        assert item.mass == pytest.approx(float(model.body(object_body_name(item.name)).mass[0]))
    assert objects[0].mass == pytest.approx(0.7)


def test_names_of_objects_never_clash() -> None:
    names = ["a b", "a%20b", "a+b", "left/hand", "table", "goal", "A b", "a/b"]
    objects = [
        SceneObject(name, "box", (0.05, 0.05, 0.05), (0.0, -0.4 + 0.1 * i), 0.0)
        for i, name in enumerate(names)
    ]
    model = build_model(Scene(tuple(objects), OnRegion("goal", REGION)))
    assert model.nq == 18 + 7 * len(names)
    assert (
        mujoco.MjModel.from_xml_string(
            scene_xml(Scene(tuple(objects), OnRegion("goal", REGION)))
        ).nq
        == model.nq
    )


def test_a_home_in_collision_is_refused_with_both_names() -> None:
    require_free_home(SCENE)
    tall = SceneObject("tower, no", "box", (0.1, 0.1, 0.6), (-0.45, 0.0), 0.0)
    goal = OnRegion(tall.name, Region((0.3, 0.2), 0.0, (0.2, 0.2)))
    with pytest.raises(
        DvrError, match=r"with the arms at home left/.* and object/tower, no penetrate by"
    ):
        require_free_home(Scene((tall,), goal))
    low = (0.0, 0.9, 0.0, -1.9, 0.0, 2.8, 0.8)
    with pytest.raises(DvrError, match=r"table.* penetrate by"):
        arms = (replace(DEFAULT_WORKCELL.arms[0], home=low), DEFAULT_WORKCELL.arms[1])
        require_free_home(Scene(SCENE.objects, SCENE.goal, replace(DEFAULT_WORKCELL, arms=arms)))


@pytest.mark.parametrize("arm", [0, 1])
def test_what_is_drawn_of_a_base_stands_on_its_foot(arm: int) -> None:
    """The foot that `validation` keeps clear of objects, in the base's own frame."""
    model = build_model(SCENE)
    body = model.body(f"{ARM_NAMES[arm]}/base").id
    reach = np.zeros(2)
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == LOOKS_GROUP)):
        low = model.geom_pos[geom][2] - model.geom_aabb[geom, 5]
        if low < 0.03:
            center, half = (
                model.geom_pos[geom] + model.geom_aabb[geom, :3],
                model.geom_aabb[geom, 3:],
            )
            reach = np.maximum(reach, [half[0] - center[0], half[1] + abs(center[1])])
    assert 0.1 < reach[0] <= PANDA.base_foot.length
    assert 0.05 < reach[1] <= max(PANDA.base_foot.radius, PANDA.base_foot.width / 2)


@pytest.mark.parametrize("workcell", WORKCELLS.values(), ids=WORKCELLS)
def test_every_workcell_stands_where_it_says(workcell: Workcell) -> None:
    scene = Scene(SCENE.objects, SCENE.goal, workcell)
    model = build_model(scene)
    data = build_home_data(model)
    layout = qpos_layout(scene)
    assert layout.size == model.nq == 9 * workcell.number_of_arms + 14
    for index, arm in enumerate(workcell.arms):
        base = data.body(f"{arm.name}/base")
        np.testing.assert_allclose(base.xpos, base_positions(workcell)[index], atol=1e-15)
        np.testing.assert_allclose(
            base.xmat.reshape(3, 3), base_rotations(workcell)[index], atol=1e-15
        )
        for joint, address in enumerate(layout.arm_joints[index]):
            assert model.joint(f"{arm.name}/joint{joint + 1}").qposadr[0] == address
        assert model.joint(f"{arm.name}/finger_joint_left").qposadr[0] == layout.fingers[index, 0]
        # The maker's home posture: gripper 0.307 m before the base.
        expected = np.array(arm.position) + 0.3069 * np.array(
            [math.cos(arm.yaw), math.sin(arm.yaw)]
        )
        np.testing.assert_allclose(data.site(f"{arm.name}/gripper").xpos[:2], expected, atol=1e-4)
    np.testing.assert_allclose(
        model.key("home").ctrl, home_qpos(scene)[: 9 * workcell.number_of_arms]
    )
    again = mujoco.MjModel.from_xml_string(scene_xml(scene))
    np.testing.assert_allclose(again.body_pos, model.body_pos, atol=6e-6)


def test_numbers_for_the_robot_are_no_part_of_a_scene(model: mujoco.MjModel) -> None:
    assert (model.nnumeric, model.ntext) == (0, 0)


def test_an_arm_may_have_an_odd_name() -> None:
    arm = Arm('ü "<&> 日本', (0.0, -0.4), 0.3)
    scene = make_scene(SCENE.objects, SCENE.goal, Workcell((arm,)))
    again = mujoco.MjModel.from_xml_string(scene_xml(scene))
    assert f"{arm.name}/hand" in [again.body(index).name for index in range(again.nbody)]


WALL = FixedBody("a wall", "box", (0.6, 0.04, 0.5), (-0.44, 0.3, 0.25), 0.7)
POST = FixedBody("post", "cylinder", (0.05, 0.2), (0.5, 0.6, 0.6), 0.0)


def test_fixed_bodies_are_part_of_the_model() -> None:
    scene = make_scene(SCENE.objects[1:], OnRegion(ODD_NAME, REGION), fixed=(WALL, POST))
    model = build_model(scene)
    data = build_home_data(model)
    assert model.nq == qpos_layout(scene).size == 18 + 7
    for fixed, geom_type, size in (
        (WALL, mujoco.mjtGeom.mjGEOM_BOX, [0.3, 0.02, 0.25]),
        (POST, mujoco.mjtGeom.mjGEOM_CYLINDER, [0.05, 0.1]),
    ):
        geom = model.geom(fixed_body_name(fixed.name))
        assert model.body(geom.bodyid[0]).name == geom.name and geom.type[0] == geom_type
        assert geom.group[0] == SOLID_GROUP
        np.testing.assert_allclose(geom.size[: len(size)], size)
        pose = data.geom(geom.name)
        np.testing.assert_allclose(pose.xpos, fixed.position)
        np.testing.assert_allclose(
            pose.xmat.reshape(3, 3), rotation_z(fixed.yaw)[:3, :3], atol=1e-15
        )


def test_arms_and_objects_collide_with_fixed_bodies() -> None:
    can = SceneObject("can", "cylinder", (0.03, 0.14), (0.2, -0.1), 0.0)
    scene = Scene((can,), OnRegion("can", REGION), fixed=(WALL, POST))
    model = build_model(scene)
    layout = qpos_layout(scene)
    data = build_home_data(model)
    data.qpos[layout.objects[0, :3]] = [0.5, 0.6, 0.76]  # a centimeter into the post
    data.qpos[layout.arm_joints[0]] = [0.8, 0.6, 0.0, -1.2, 0.0, 1.8, 0.8]  # towards the wall
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    pairs = {frozenset(model.geom(g).name for g in pair) for pair in data.contact.geom}
    assert {"object/can", "fixed/post"} in pairs
    assert any(
        "fixed/a%20wall" in pair and any(name.startswith("left/") for name in pair)
        for pair in pairs
    )


def test_a_fixed_body_in_an_arm_at_home_is_refused() -> None:
    high = replace(WALL, position=(-0.44, 0.0, 0.3))
    with pytest.raises(
        SceneError, match=r"with the arms at home left/.* and fixed/a wall penetrate by"
    ):
        require_free_home(make_scene(SCENE.objects[1:], OnRegion(ODD_NAME, REGION), fixed=[high]))
