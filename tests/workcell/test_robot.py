"""A robot as its MJCF describes it, the makers' numbers, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from arm_states import Simulated

from dvr_jax.errors import DvrError
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import InverseKinematics, Robot, register_robot, robot_named
from dvr_jax.workcell.workcell import WORKCELLS

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
    assert (foot.radius, foot.length, foot.width) == (0.085, 0.125, 0.11)


def test_capsules_are_named_from_the_base_outwards() -> None:
    capsules = PANDA.capsules
    assert capsules.names == (
        "column",
        "upper_arm",
        "elbow",
        "forearm",
        "wrist",
        "flange",
        "hand",
        "finger_left",
        "finger_right",
    )
    assert capsules.links == (0, 2, 4, 5, 6, 7, 7, 7, 7)
    assert PANDA.holding_capsules == (6, 7, 8)
    assert PANDA.table_capsules == (3, 9)
    assert PANDA.self_collision_pairs == (((0, 1), (3, 9)), ((1, 2), (4, 9)), ((2, 4), (5, 9)))


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
            'data="forearm wrist flange',
            'data="forearm flange wrist',
            "table_capsules",
            "not consecutive",
        ),
        (
            'data="forearm wrist flange',
            'data="elbow wrist flange',
            "table_capsules",
            "not consecutive",
        ),
        (
            "column : forearm wrist",
            "column : forearm flange",
            "self_collision_pairs",
            "not consecutive",
        ),
        (
            'data="hand finger_left',
            'data="palm finger_left',
            "holding_capsules",
            "no capsule 'palm'",
        ),
        (
            'data="forearm wrist flange',
            'data="knee wrist flange',
            "table_capsules",
            "no capsule 'knee'",
        ),
        (
            "column : forearm",
            "column forearm",
            "self_collision_pairs",
            "valid is 'these : with these'",
        ),
        ("column : forearm", " : forearm", "self_collision_pairs", "names no capsule"),
        ('name="home" data="0 ', 'name="home" data="', "home", "has 6 numbers; valid are 7"),
        ('name="tucked" data="0 ', 'name="tucked" data="', "tucked", "has 6 numbers; valid are 7"),
        (
            'name="joint_velocity" data="2.1750 ',
            'name="joint_velocity" data="',
            "joint_velocity",
            "valid are 7",
        ),
        (
            'name="finger_speed" data="0.05"',
            'name="finger_speed" data="0.05 1"',
            "finger_speed",
            "valid are 1",
        ),
        ('name="base_foot" data="0.085 ', 'name="base_foot" data="', "base_foot", "valid are 3"),
        (
            'name="wrist_collision" class="collision" fromto="0 0 0 0.088 0 0" size="0.06"',
            'name="wrist_collision" class="collision" type="sphere" pos="0.044 0 0" size="0.06"',
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
