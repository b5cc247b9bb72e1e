"""Everything that the check can find, with the sentence and the unit of each kind of finding."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FindingKind:
    """One thing that can be wrong with a motion."""

    name: str
    """Short name, unique among all kinds."""

    sentence: str
    """Sentence for a message, with the places {0}, {1} for the names of bodies, and {value} for the amount."""

    unit: str
    """Unit in which a message gives the amount; "mm" for an amount in meters, "" where there is no amount."""


PENETRATION = FindingKind("penetration", "{0} and {1} penetrate by {value}", "mm")

JOINT_LIMIT = FindingKind("joint limit", "{0} is beyond its limit by {value}", "rad")
JOINT_SPEED = FindingKind("joint speed", "{0} turns at {value}", "rad/s")
JOINT_ACCELERATION = FindingKind(
    "joint acceleration", "{0} speeds up or slows down by {value}", "rad/s^2"
)
JOINT_JERK = FindingKind("joint jerk", "the acceleration of {0} changes by {value}", "rad/s^3")
JOINT_TORQUE = FindingKind("joint torque", "{0} needs a torque of {value}", "N m")
SWITCH_SPEED = FindingKind(
    "switch speed", "{0} turns at {value} as its gripper takes or gives", "rad/s"
)
HOME_POSTURE = FindingKind("home posture", "{0} is {value} away from its home", "rad")

FINGER_TRAVEL = FindingKind("finger travel", "{0} is out of its range by {value}", "mm")
FINGER_SPEED = FindingKind("finger speed", "{0} moves at {value}", "m/s")
HOME_FINGER = FindingKind("home finger", "{0} is {value} away from its home", "mm")

OBJECT_SPEED = FindingKind("object speed", "{0} moves at {value}", "m/s")
STANDING_SHIFT = FindingKind("standing shift", "{0} moves by {value} while no arm holds it", "mm")
STANDING_TURN = FindingKind("standing turn", "{0} turns by {value} while no arm holds it", "rad")
SWITCH_SHIFT = FindingKind("switch shift", "{0} jumps by {value} as its holder changes", "mm")
SWITCH_TURN = FindingKind("switch turn", "{0} turns by {value} as its holder changes", "rad")
SLIP_SHIFT = FindingKind("slip shift", "{0} slips by {value} in the {1} gripper", "mm")
SLIP_TURN = FindingKind("slip turn", "{0} turns by {value} in the {1} gripper", "rad")
HOME_SHIFT = FindingKind("home shift", "{0} is {value} away from where the scene has it", "mm")
HOME_TURN = FindingKind("home turn", "{0} is turned by {value} from how the scene has it", "rad")

GRIPPER_CENTER = FindingKind(
    "gripper center",
    "the center of the {1} gripper is {value} outside {0} as it grasps",
    "mm",
)
CLOSING_AXIS = FindingKind(
    "closing axis",
    "the {1} gripper's closing axis is {value} off the normal of {0}'s face as it grasps",
    "rad",
)
CLOSING_OFFSET = FindingKind(
    "closing offset",
    "the {1} gripper's closing axis passes {value} beside the axis of {0} as it grasps",
    "mm",
)
GRIP = FindingKind(
    "grip",
    "the fingers of the {1} gripper, which alone holds {0}, are {value} off its sides",
    "mm",
)
WIDTH = FindingKind("width", "{0} is {value} wide where the {1} gripper grasps it", "mm")

SUPPORT_TILT = FindingKind("support tilt", "{0} is tilted by {value} on the {1}", "rad")
SUPPORT_HEIGHT = FindingKind("support height", "the bottom of {0} is {value} off the {1}", "mm")
SUPPORT_OVERHANG = FindingKind(
    "support overhang", "{0} reaches {value} over the border of the {1}", "mm"
)

OFF_TOP = FindingKind(
    "off top", "the center of {0} is {value} beyond the part of {1}'s top that carries it", "mm"
)

REGION_COVERED = FindingKind("region covered", "{0} covers {value} of the {1}", "mm")

GOAL_HELD = FindingKind("goal held", "the goal's {0} is still held by the {1} gripper", "")
GOAL_NOT_HELD = FindingKind("goal not held", "the goal's {0} is not held by the {1} gripper", "")
GOAL_OFF_HAND = FindingKind("goal off hand", "the {1} gripper's center is {value} off {0}", "mm")

KINDS = (
    PENETRATION,
    JOINT_LIMIT,
    JOINT_SPEED,
    JOINT_ACCELERATION,
    JOINT_JERK,
    JOINT_TORQUE,
    SWITCH_SPEED,
    HOME_POSTURE,
    FINGER_TRAVEL,
    FINGER_SPEED,
    HOME_FINGER,
    OBJECT_SPEED,
    STANDING_SHIFT,
    STANDING_TURN,
    SWITCH_SHIFT,
    SWITCH_TURN,
    SLIP_SHIFT,
    SLIP_TURN,
    HOME_SHIFT,
    HOME_TURN,
    GRIPPER_CENTER,
    CLOSING_AXIS,
    CLOSING_OFFSET,
    GRIP,
    WIDTH,
    SUPPORT_TILT,
    SUPPORT_HEIGHT,
    SUPPORT_OVERHANG,
    OFF_TOP,
    REGION_COVERED,
    GOAL_HELD,
    GOAL_NOT_HELD,
    GOAL_OFF_HAND,
)
"""All kinds of the operators, shapes and goals of this package. A further operator defines its own beside its check."""
