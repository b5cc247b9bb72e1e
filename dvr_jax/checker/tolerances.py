"""Every tolerance of the check. Limits of joints and fingers are the robot's own and come from its MJCF."""

DEEPEST_CONTACT = 1e-3
"""Deepest penetration [m]."""

DEEPEST_GRIP = 2.5e-3
"""Deepest penetration of a hand and an object that this hand grasps in the course of the plan [m]. The capsules of the
fingers reach over the pads by 1 mm."""

LIMIT_TOLERANCE = 1e-3
"""Largest excess over a joint limit [rad]; also the largest deviation from the home posture."""

FINGER_TOLERANCE = 1e-4
"""Largest excess of a finger over its range of travel [m]."""

ROUNDING = 1 + 1e-6
"""Factor of limits of speed and acceleration."""

SWITCH_JOINT_SPEED = 0.1
"""Largest joint speed of an arm at the sample at which it takes or gives an object [rad/s]."""

FASTEST_OBJECT = 5.0
"""Largest speed of an object [m/s]; anything faster is a jump."""

SHIFT = 1e-3
"""Largest displacement of an object that stands, in the world, or that is held, in its gripper [m]."""

TURN = 1e-2
"""Largest rotation of an object that stands, in the world, or that is held, in its gripper [rad]."""

SHIFT_AT_SWITCH = 3e-3
"""Largest displacement of an object over the one sample step at which its holder changes [m]."""

TURN_AT_SWITCH = 2e-2
"""Largest rotation of an object over the one sample step at which its holder changes [rad]."""

CENTER_TOLERANCE = 1e-3
"""Largest distance of the gripper center from the object that it grasps [m]."""

AXIS_TOLERANCE = 2e-2
"""Largest angle between the closing axis and the normal of the grasped face [rad]."""

AXIS_OFFSET = 2e-3
"""Largest distance between the closing axis and the axis of a grasped cylinder [m]."""

SUPPORT_TOLERANCE = 2e-3
"""Largest height of a placed object above or below its support, and its largest overhang [m]."""

TOP_MARGIN = 5e-3
"""Least distance of the center of an object from the edge of the top of another object on which it stands [m]."""

GRIP_TOLERANCE = 1e-3
"""Largest distance of a finger from the side of the object that it holds [m]."""

QUATERNION_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1."""
