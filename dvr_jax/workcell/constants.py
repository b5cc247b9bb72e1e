"""The fixed part of every scene: the table, where the two Panda arms stand, and the arm's published constants.

World frame: the table's top is z = 0, the origin lies in the middle between the two bases, z points up.
Arm 0 is "left" (base at x = -0.75, facing +x), arm 1 is "right" (base at x = 0.75, facing -x). Metres and radians.
"""

import math

ARM_NAMES: tuple[str, str] = ("left", "right")
"""Names of arm 0 and arm 1; also the prefix of their bodies, joints, geoms and sites: "left/", "right/"."""

TABLE_HALF_EXTENTS: tuple[float, float] = (1.1, 1.0)
"""The table's top is x in [-1.1, 1.1], y in [-1.0, 1.0] (m)."""

TABLE_THICKNESS = 0.04
"""The table's top reaches from z = -0.04 to z = 0 (m)."""

BASE_POSITIONS: tuple[tuple[float, float], tuple[float, float]] = ((-0.75, 0.0), (0.75, 0.0))
"""Positions (x, y) of the two bases on the table (m), 1.5 m apart: both reach the middle of the table, each
alone what lies behind its own base."""

BASE_YAWS: tuple[float, float] = (0.0, math.pi)
"""The bases' yaw (rad): they face each other."""

BASE_RADIUS, BASE_LENGTH, BASE_WIDTH = 0.085, 0.125, 0.11
"""A base's foot (m): a disc around its axis, and a plate from the axis to behind it. No object may stand on it."""

NUMBER_OF_JOINTS = 7
"""Revolute joints of one arm."""

JOINT_LOWER: tuple[float, ...] = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
"""Lower joint limits of a Panda (rad), Franka's published data."""

JOINT_UPPER: tuple[float, ...] = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
"""Upper joint limits of a Panda (rad), Franka's published data."""

JOINT_VELOCITY: tuple[float, ...] = (2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100)
"""Joint velocity limits of a Panda (rad/s), Franka's published data."""

JOINT_ACCELERATION: tuple[float, ...] = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Joint acceleration limits of a Panda (rad/s^2), Franka's published data."""

FINGER_SPEED = 0.05
"""Fastest motion of one finger (m/s), Franka's published data of its hand."""

HOME_POSTURE: tuple[float, ...] = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)
"""The customary ready posture of a Panda (rad)."""

FINGER_OPEN = 0.04
"""Largest travel of one finger (m): two of them open 8 cm."""

MAXIMUM_OPENING = 2 * FINGER_OPEN
"""Widest object that the gripper can take (m)."""

MAXIMUM_OBJECTS = 8
"""A scene has 1 to 8 objects."""
