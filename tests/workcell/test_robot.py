"""A robot as its MJCF describes it, the makers' numbers, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from arm_states import Simulated, sample_postures

from dvr_jax.errors import DvrError
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import InverseKinematics, Robot, register_robot, robot_named
from dvr_jax.workcell.workcell import SINGLE_ARM_WORKCELL, WORKCELLS

PUBLISHED_LIMITS = [
    # lower [rad], upper [rad], speed [rad/s], acceleration [rad/s^2], jerk [rad/s^3], torque [N m]
    (-2.8973, 2.8973, 2.1750, 15.0, 7500.0, 87.0),
    (-1.7628, 1.7628, 2.1750, 7.5, 3750.0, 87.0),
    (-2.8973, 2.8973, 2.1750, 10.0, 5000.0, 87.0),
    (-3.0718, -0.0698, 2.1750, 12.5, 6250.0, 87.0),
    (-2.8973, 2.8973, 2.6100, 15.0, 7500.0, 12.0),
    (-0.0175, 3.7525, 2.6100, 20.0, 10000.0, 12.0),
    (-2.8973, 2.8973, 2.6100, 20.0, 10000.0, 12.0),
]
"""Franka Control Interface documentation, Robot and interface specifications, joint space limits of the Panda."""


def robot_of(mjcf: str) -> Robot:
    return Robot("altered", mjcf, PANDA.inverse_kinematics)


def altered(old: str, new: str, count: int = 1) -> Robot:
    """A Panda with another MJCF."""
    assert PANDA.mjcf.count(old) >= 1
    return robot_of(PANDA.mjcf.replace(old, new, count))


def test_limits_are_the_makers() -> None:
    limits = np.array(PUBLISHED_LIMITS)
    np.testing.assert_array_equal(PANDA.joint_limits, limits[:, :2].T)
    np.testing.assert_array_equal(PANDA.joint_velocity, limits[:, 2])
    np.testing.assert_array_equal(PANDA.joint_acceleration, limits[:, 3])
    np.testing.assert_array_equal(PANDA.joint_jerk, limits[:, 4])
    np.testing.assert_array_equal(PANDA.joint_torque, limits[:, 5])
    # Data sheet of the Franka Hand: grippers open 80 mm, fingers travel at 50 mm/s.
    assert (
        PANDA.maximum_opening == 0.08 and PANDA.finger_travel == 0.04 and PANDA.finger_speed == 0.05
    )
    assert PANDA.number_of_joints == 7


@pytest.mark.parametrize("name", WORKCELLS)
def test_limits_of_a_workcells_model_are_the_makers(name: str) -> None:
    workcell = WORKCELLS[name]
    model = Simulated(workcell).model
    for arm in workcell.arm_names:
        ranges = [model.joint(f"{arm}/joint{number}").range for number in range(1, 8)]
        np.testing.assert_array_equal(ranges, np.array(PUBLISHED_LIMITS)[:, :2])
        fingers = [model.joint(f"{arm}/finger_joint_{side}").range for side in ("left", "right")]
        np.testing.assert_array_equal(fingers, [(0.0, 0.04)] * 2)


def test_postures_are_within_the_limits() -> None:
    lower, upper = PANDA.joint_limits
    for posture in (PANDA.home, PANDA.tucked):
        assert len(posture) == 7
        assert (posture > lower).all() and (posture < upper).all()
    np.testing.assert_allclose(
        PANDA.home, [0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4]
    )
    foot = PANDA.base_foot
    assert (foot.radius, foot.length, foot.width) == (0.105, 0.162, 0.21)


def test_capsules_are_named_from_the_base_outwards() -> None:
    capsules = PANDA.capsules
    assert capsules.names == (
        "base",
        "shoulder",
        "upper_arm",
        "elbow",
        "lower_elbow",
        "forearm",
        "wrist",
        "wrist_cap",
        "flange",
        "hand",
        "palm",
        "finger_left_front",
        "finger_left_rear",
        "finger_left_back",
        "finger_right_front",
        "finger_right_rear",
        "finger_right_back",
    )
    assert capsules.links == (0, 1, 2, 3, 4, 5, 6, 6, *[7] * 9)
    assert PANDA.holding_capsules == (9, 10, 11, 12, 13, 14, 15, 16)
    assert PANDA.table_capsules == (5, 17)
    assert PANDA.self_collision_pairs == (((0, 3), (5, 17)), ((5, 6), (8, 17)))


def test_only_fingers_move_as_a_gripper_opens() -> None:
    """Away from each other along the closing axis, which lies on the diagonal of the last link's frame."""
    capsules = PANDA.capsules
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    for name, direction in zip(capsules.names, capsules.finger_directions, strict=True):
        side = name.startswith("finger_left") - float(name.startswith("finger_right"))
        np.testing.assert_allclose(direction, side * diagonal, rtol=0, atol=1e-12)


def test_the_overhang_of_the_pads_is_that_of_the_widest_capsule() -> None:
    """The capsules beside the pads have a radius of 9.3 mm and end 8.3 mm from the middle of the closed gripper."""
    assert PANDA.pad_overhang == pytest.approx(1e-3, abs=1e-12)
    right = 'name="finger_right_rear_collision" class="collision" fromto="-0.0059 -0.0084'
    near = altered(right, right.replace("-0.0084", "-0.0070"))
    assert near.pad_overhang == pytest.approx(2.3e-3, abs=1e-12)
    far = robot_of(
        re.sub(
            r'(name="finger_\w+_collision" class="collision" fromto="[^"]*" size=)"[0-9.]*"',
            r'\1"0.005"',
            PANDA.mjcf,
        )
    )
    assert far.pad_overhang == 0.0


def test_no_capsule_reaches_farther_than_it_is_said_to() -> None:
    """Across the first joint's axis, in random postures; what turns about this axis alone reaches just so far."""
    simulated = Simulated(SINGLE_ARM_WORKCELL)
    model = simulated.model
    axis = np.array(SINGLE_ARM_WORKCELL.arms[0].position)
    farthest = np.zeros(len(PANDA.capsules.names))
    for data in simulated.states(*sample_postures(2000, workcell=SINGLE_ARM_WORKCELL)):
        for c, name in enumerate(PANDA.capsules.names):
            geom = data.geom(f"arm/{name}_collision")
            radius, half = model.geom(f"arm/{name}_collision").size[:2]
            along = geom.xmat.reshape(3, 3)[:2, 2] * half
            for end in (geom.xpos[:2] - along, geom.xpos[:2] + along):
                farthest[c] = max(farthest[c], np.linalg.norm(end - axis) + radius)
    assert (farthest <= PANDA.capsule_reach + 1e-9).all()
    np.testing.assert_allclose(farthest[:2], PANDA.capsule_reach[:2], rtol=0, atol=1e-9)


def test_equal_robots_are_one_key() -> None:
    other = Robot("panda", PANDA.mjcf, PANDA.inverse_kinematics)
    assert other == PANDA and hash(other) == hash(PANDA)
    assert altered("0.333", "0.334") != PANDA
    assert "mujoco" not in repr(PANDA)


@pytest.mark.parametrize(
    ("element", "read"),
    [
        ("joint_velocity", lambda robot: robot.joint_velocity),
        ("joint_acceleration", lambda robot: robot.joint_acceleration),
        ("finger_speed", lambda robot: robot.finger_speed),
        ("home", lambda robot: robot.home),
        ("tucked", lambda robot: robot.tucked),
        ("base_foot", lambda robot: robot.base_foot),
        ("holding", lambda robot: robot.holding_capsules),
        ("above_table", lambda robot: robot.table_capsules),
        ("self_collision", lambda robot: robot.self_collision_pairs),
    ],
)
def test_a_missing_element_is_named(element: str, read) -> None:
    text = re.sub(rf'<(numeric|text) name="{element}".*?/>', "", PANDA.mjcf, flags=re.DOTALL)
    assert text != PANDA.mjcf
    with pytest.raises(
        DvrError,
        match=rf"'altered' lacks the <(numeric|text) name=\"{element}\"> under <custom>\.$",
    ):
        read(robot_of(text))


@pytest.mark.parametrize(
    ("old", "new", "read", "message"),
    [
        (
            'data="forearm wrist wrist_cap flange',
            'data="forearm wrist flange wrist_cap',
            "table_capsules",
            "not consecutive",
        ),
        (
            'data="forearm wrist wrist_cap flange',
            'data="elbow wrist wrist_cap flange',
            "table_capsules",
            "not consecutive",
        ),
        (
            "upper_arm : forearm wrist",
            "upper_arm : forearm flange",
            "self_collision_pairs",
            "not consecutive",
        ),
        (
            'data="hand palm finger_left_front',
            'data="hand thumb finger_left_front',
            "holding_capsules",
            "no capsule 'thumb'",
        ),
        (
            'data="forearm wrist wrist_cap flange',
            'data="knee wrist wrist_cap flange',
            "table_capsules",
            "no capsule 'knee'",
        ),
        (
            "upper_arm : forearm",
            "upper_arm forearm",
            "self_collision_pairs",
            "valid is 'these : with these'",
        ),
        (
            "base shoulder upper_arm : forearm",
            " : forearm",
            "self_collision_pairs",
            "names no capsule",
        ),
        ('name="home" data="0 ', 'name="home" data="', "home", "has 6 numbers; valid are 7"),
        ('name="tucked" data="0 ', 'name="tucked" data="', "tucked", "has 6 numbers; valid are 7"),
        (
            'name="joint_velocity" data="2.1750 ',
            'name="joint_velocity" data="',
            "joint_velocity",
            "valid are 7",
        ),
        (
            'name="joint_jerk" data="7500 ',
            'name="joint_jerk" data="',
            "joint_jerk",
            "has 6 numbers; valid are 7",
        ),
        (
            'name="joint_torque" data="87 ',
            'name="joint_torque" data="',
            "joint_torque",
            "has 6 numbers; valid are 7",
        ),
        (
            'name="finger_speed" data="0.05"',
            'name="finger_speed" data="0.05 1"',
            "finger_speed",
            "valid are 1",
        ),
        ('name="base_foot" data="0.105 ', 'name="base_foot" data="', "base_foot", "valid are 3"),
        (
            'name="wrist_collision" class="collision" fromto="0.0876 -0.0153 0.0003 0.004 0.0032 0.006" size="0.0574"',
            'name="wrist_collision" class="collision" type="sphere" pos="0.044 0 0" size="0.0574"',
            "capsules",
            "'wrist_collision' of the robot 'altered' is no capsule",
        ),
        ('<site name="gripper"', '<site name="tip"', "gripper_center", "site 'gripper'"),
        ('<body name="hand"', '<body name="paw"', "hand_rotation", "body 'hand'"),
        ('"joint3"', '"joint30"', "joint_limits", "joint 'joint3'"),
        ("<mujoco", "<mojoco", "model", "altered"),
    ],
)
def test_a_bad_mjcf_is_refused_in_one_sentence(old: str, new: str, read: str, message: str) -> None:
    robot = altered(old, new, count=-1)
    with pytest.raises(DvrError, match=re.escape(message)) as refused:
        getattr(robot, read)
    sentence = str(refused.value)
    assert sentence.endswith(".") and "\n" not in sentence


@pytest.mark.parametrize("element", ["joint_jerk", "joint_torque"])
def test_a_limit_that_is_not_stated_is_infinite(element: str) -> None:
    text = re.sub(rf'<numeric name="{element}".*?/>', "", PANDA.mjcf)
    assert text != PANDA.mjcf
    np.testing.assert_array_equal(getattr(robot_of(text), element), [np.inf] * 7)


def test_a_robot_without_self_collisions() -> None:
    """An empty text says that no two capsules of an arm can meet."""
    text = re.sub(r'(<text name="self_collision" data=").*?"', r'\1 "', PANDA.mjcf, flags=re.DOTALL)
    assert robot_of(text).self_collision_pairs == ()


def test_robots_are_known_by_name() -> None:
    assert robot_named("panda") is PANDA
    with pytest.raises(DvrError, match=r"no robot 'r2d2'; valid: .*panda"):
        robot_named("r2d2")


def test_a_robot_can_be_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dvr_jax.workcell.robot._ROBOTS", {"panda": PANDA})
    short = replace(altered("-0.316", "-0.3"), name="short panda")
    assert register_robot(short) is short
    assert robot_named("short panda") is short
    with pytest.raises(DvrError, match="valid: panda, short panda"):
        robot_named("panda 2")


def test_inverse_kinematics_name_what_programs_are_stored_under() -> None:
    """A function of this package by its name; one of another program in brackets, which is never stored."""
    assert (
        repr(PANDA.inverse_kinematics)
        == "InverseKinematics(dvr_jax.workcell.panda._solve, 4, (6,))"
    )
    assert "<" in repr(InverseKinematics(lambda *arguments: arguments, branches=1))
