"""The planner's limit of the speed of hands near switches, as a constraint of the library `toppra`.

The planner moves a hand slowly before and after a switch in which it takes part (`near_speed` in
`dvr_jax.planning.hand_limits`). A comparison with the fastest motion under the same limit shows how much time this
costs, and how much is lost elsewhere.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from toppra.constraint import JointVelocityConstraintVarying

from dvr_jax.bench.motion_states import MotionStates
from dvr_jax.planning.carried_objects import gripper_frames
from dvr_jax.planning.hand_limits import near_acceleration, near_speed
from dvr_jax.scene.layout import qpos_layout

LEAST_LIMIT = 1e-4
"""Least limit of the velocity of a joint, which keeps a limit from being zero where a joint rests [rad/s]."""

LARGEST_RATE = 1e6
"""Largest speed along the path where no hand has to be slow; a path has the length 1 [1/s]."""

LEAST_TRAVEL = 1e-6
"""Least distance of a hand per length of the path, which keeps the quotient finite where the hand rests [m]."""


def slow_hand_limit(
    states: MotionStates,
    points: Float[np.ndarray, "points nq"],
    first: int,
    last: int,
) -> JointVelocityConstraintVarying:
    """Return the limits of joint velocities that keep hands slow near the switches at both ends of a path.

    The distance of a hand from where it is at a switch gives its largest speed. The hand speed per speed along the path
    gives the largest speed along the path, and this the largest velocity of each joint.

    Args:
        states: The motion with the poses of its bodies.
        points: States at equal distances along the path.
        first: Sample of the motion at the beginning of the path.
        last: Sample at its end.
    """
    hands, _ = gripper_frames(states.scene, points)
    grid = np.linspace(0, 1, len(points))
    travel = np.linalg.norm(np.gradient(hands, grid, axis=0), axis=2)
    rate = np.full(len(points), LARGEST_RATE)
    for end, rooms in ((0, switching_rooms(states, first)), (-1, switching_rooms(states, last))):
        for arm, room in rooms.items():
            distance = np.linalg.norm(hands[:, arm] - hands[end, arm], axis=1)
            fastest = near_speed(distance, near_acceleration(np.asarray(room)))
            rate = np.minimum(rate, fastest / np.maximum(travel[:, arm], LEAST_TRAVEL))

    joints = qpos_layout(states.scene).arm_joints.reshape(-1)
    slope = np.abs(np.gradient(points[:, joints], grid, axis=0))
    largest = np.maximum(slope * rate[:, None], LEAST_LIMIT)

    def limits(parameter: float) -> Float[np.ndarray, "joints 2"]:
        """Lower and upper limits of all joints at a point of the path [rad/s]."""
        upper = largest[round(parameter * (len(grid) - 1))]
        return np.stack([-upper, upper], axis=1)

    return JointVelocityConstraintVarying(limits)


def switching_rooms(states: MotionStates, sample: int) -> dict[int, float]:
    """Return the arms that take or release an object in the pause around a sample, and the room in their hands [m].

    The room is the distance of each open finger from the object that it takes or has released.

    Args:
        states: The motion with the poses of its bodies.
        sample: Sample at which a moving part of the motion begins or ends.
    """
    motion = states.motion
    switches = [0, *motion.switch.tolist(), len(motion.time)]
    nearest = min(switches, key=lambda switch: abs(switch - sample))
    if not 0 < nearest < len(motion.time):
        return {}

    fingers = qpos_layout(states.scene).fingers
    rooms = {}
    for interval in states.timeline.intervals:
        if interval.holder is not None and nearest in (interval.start, interval.end):
            travel = float(motion.qpos[interval.start, fingers[interval.holder]].mean())
            rooms[interval.holder] = states.scene.workcell.robot.finger_travel - travel
    return rooms
