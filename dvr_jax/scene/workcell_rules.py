"""Rules of a workcell: names, bases and home postures of its arms, and the size of its table.

Bodies and the arms' bases are kept apart here too. MuJoCo does not do that: it never compares two bodies that both
cannot move.
"""

import math
from functools import lru_cache
from itertools import combinations

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import (
    Circle,
    Footprint,
    Rectangle,
    inside,
    signed_distance,
)
from dvr_jax.scene.rules import (
    OVERLAP_TOLERANCE,
    RESERVED_CHARACTERS,
    YAW_RANGE,
    in_words,
    require_name,
    require_numbers,
    require_unique,
)
from dvr_jax.workcell.robot import Robot
from dvr_jax.workcell.workcell import Arm, Table, Workcell

LARGEST_NUMBER_OF_ARMS = 2
"""A workcell has one arm or two."""

ARM_RESERVED_CHARACTERS = RESERVED_CHARACTERS + "/"
"""Characters that no arm's name has; the slash separates an arm's name from its bodies' names."""

RESERVED_ARM_NAMES = ("object", "fixed")
"""Names that no arm has: names of other bodies of the MuJoCo model begin with them."""

SMALLEST_BASE_DISTANCE = 0.3
"""Two bases stand at least this far apart [m]; the feet of two Pandas do not overlap then, however they are turned."""

TABLE_RANGE = (0.2, 2.0)
"""Valid half extents of a table [m]."""

THICKNESS_RANGE = (1e-3, 1.0)
"""Valid thicknesses of a table [m]."""


@lru_cache(maxsize=64)
def validate_workcell(workcell: Workcell) -> None:
    """Check all rules of a workcell; a valid one is checked only once.

    Raises:
        SceneError: A rule is broken; the message names the first one.
    """
    if not 1 <= workcell.number_of_arms <= LARGEST_NUMBER_OF_ARMS:
        raise SceneError(
            f"the workcell has {workcell.number_of_arms} arms; valid are 1 to {LARGEST_NUMBER_OF_ARMS}."
        )

    _validate_table(workcell.table)

    for arm in workcell.arms:
        _validate_arm_name(arm.name)

    require_unique("arms", workcell.arm_names)

    for arm in workcell.arms:
        _validate_base(arm, workcell)
        _validate_home(arm, workcell.robot)

    for first, second in combinations(workcell.arms, 2):
        distance = math.dist(first.position, second.position)
        if distance < SMALLEST_BASE_DISTANCE:
            raise SceneError(
                f"the bases of the arms {first.name!r} and {second.name!r} are {distance:.3g} m apart; "
                f"valid is at least {SMALLEST_BASE_DISTANCE} m."
            )


def require_off_bases(
    what: str,
    footprint: Footprint,
    bottom: float,
    workcell: Workcell,
) -> None:
    """Refuse a body that stands in the base of an arm.

    Args:
        what: The body in words.
        footprint: What the body covers of the table.
        bottom: Height of its lowest point above the table [m].
        workcell: The arms.

    Raises:
        SceneError: The body overlaps a base's foot, and is not wholly above the base.
    """
    if bottom >= base_height(workcell.robot):
        return

    foot = workcell.robot.base_foot

    for arm in workcell.arms:
        distance = min(
            signed_distance(footprint, part) for part in base_footprints(arm, workcell.robot)
        )
        if distance < -OVERLAP_TOLERANCE:
            raise SceneError(
                f"{what} at {in_words(footprint.center)} overlaps the {arm.name} arm's base, {foot.radius} m around "
                f"{in_words(arm.position)} and {foot.length} m behind it; move it away."
            )


def base_footprints(arm: Arm, robot: Robot) -> tuple[Circle, Rectangle]:
    """What the base of an arm covers of the table.

    Args:
        arm: The arm.
        robot: The robot that the arm is.

    Returns:
        The disc around the first joint's axis, and the plate from the axis to behind it.
    """
    foot = robot.base_foot
    x, y = arm.position
    middle = (
        x - foot.length / 2 * math.cos(arm.yaw),
        y - foot.length / 2 * math.sin(arm.yaw),
    )
    plate = Rectangle(middle, (foot.length / 2, foot.width / 2), arm.yaw)

    return Circle(arm.position, foot.radius), plate


@lru_cache(maxsize=16)
def base_height(robot: Robot) -> float:
    """Height of the highest capsule that stays over the base, above the table [m].

    These are the capsules of the base, and of link 1 where joint 1 turns about the vertical.
    """
    capsules = robot.capsules
    heights = {0: 0.0}
    if abs(robot.link_rotations[0, 2, 2]) == 1:
        heights[1] = float(robot.link_offsets[0, 2])
    tops = [
        heights[link] + max(capsules.starts[c, 2], capsules.ends[c, 2]) + capsules.radii[c]
        for c, link in enumerate(capsules.links)
        if link in heights
    ]

    return float(max(tops, default=0.0))


def _validate_table(table: Table) -> None:
    require_numbers("the table's half extents", table.half_extents, 2, TABLE_RANGE, "m")
    require_numbers("the table's thickness", (table.thickness,), 1, THICKNESS_RANGE, "m")


def _validate_arm_name(name: str) -> None:
    require_name("an arm", name, ARM_RESERVED_CHARACTERS)
    if name in RESERVED_ARM_NAMES:
        raise SceneError(
            f"an arm's name is {name!r}; valid is any name but {' and '.join(RESERVED_ARM_NAMES)}."
        )


def _validate_base(arm: Arm, workcell: Workcell) -> None:
    require_numbers(f"the position of the {arm.name} arm", arm.position, 2)
    require_numbers(f"the yaw of the {arm.name} arm", (arm.yaw,), 1, YAW_RANGE, "rad")
    table = workcell.table
    if not all(inside(part, table.footprint) for part in base_footprints(arm, workcell.robot)):
        raise SceneError(
            f"the {arm.name} arm's base at {in_words(arm.position)} reaches off the table, "
            f"whose top is {table_in_words(table)}."
        )


def _validate_home(arm: Arm, robot: Robot) -> None:
    require_numbers(f"the {arm.name} arm's home", arm.home, robot.number_of_joints)
    for joint, (lower, upper) in enumerate(robot.joint_limits.T):
        angle = arm.home[joint]
        if not lower <= angle <= upper:
            raise SceneError(
                f"joint {joint + 1} of the {arm.name} arm's home is {angle:g} rad; valid is {lower} to {upper}."
            )


def table_in_words(table: Table) -> str:
    """Print the extents of a table for a message."""
    x, y = table.half_extents
    return f"x in [-{x}, {x}], y in [-{y}, {y}]"
