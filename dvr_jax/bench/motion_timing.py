"""How long a motion takes, beside the fastest motion along the same path, by the algorithm TOPP-RA of `toppra`.

A motion consists of *moving parts*, one before each switch and one after the last: from the first to the last sample
between two switches at which an arm moves. Arms rest at both ends of a part. The time between the parts, in which the
fingers move, belongs to neither side of the comparison.

TOPP-RA gets the path of each part as `toppra`'s own spline through points at equal distances, rest at both ends, and
`toppra`'s own constraints of velocity and acceleration with the whole of the limits. It knows no limit of the jerk and
no limit of the speed of a hand near a switch, so a motion that keeps those takes longer. A second duration adds the
limits of torque, by MuJoCo's inverse dynamics with what the arms hold. A third one adds to the first the limit of the
speed of hands near switches (`dvr_jax.bench.slow_hands`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import toppra
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from toppra.algorithm import TOPPRA
from toppra.constraint import (
    JointAccelerationConstraint,
    JointTorqueConstraint,
    JointVelocityConstraint,
)

from dvr_jax.bench.motion_limits import load_in_hand
from dvr_jax.bench.motion_states import MotionStates
from dvr_jax.bench.slow_hands import slow_hand_limit
from dvr_jax.checker.loaded_arm import LoadedArm
from dvr_jax.motion.interpolation import spline_of
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.layout import qpos_layout

STILL = 1e-9
"""An arm rests while none of its joints changes by more than this from one sample to the next [rad]."""

PATH_POINTS = 400
"""Number of equal pieces into which the path of a part is divided, for its spline and for TOPP-RA's grid."""

FINE_RATE = 1000.0
"""Rate at which a motion is sampled to find its path [1/s]."""

SHORTEST_PATH = 1e-6
"""Points of a path that are nearer to each other than this fraction of its length are taken for one."""

LARGEST_TORQUE = 1e6
"""Torque that stands for no limit [N m]."""

Torques = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Torques of all joints [N m] in one state: angles [rad], velocities [rad/s] and accelerations [rad/s^2]."""


@dataclass(frozen=True, slots=True)
class MovingPart:
    """A part of a motion between two rests."""

    first: int
    """Sample at which the arms begin to move."""

    last: int
    """Sample at which they rest again."""


@dataclass(frozen=True, slots=True)
class MotionTiming:
    """Durations of a motion and of the fastest motions along its path [s]."""

    duration: float
    """Duration of the whole motion, with the time for the fingers."""

    moving: float
    """Duration of its moving parts together."""

    fastest: float
    """Duration of these parts by TOPP-RA under limits of velocity and acceleration."""

    fastest_with_torque: float
    """The same with limits of torque; NaN where an arm is too weak to hold its load still."""

    fastest_with_slow_hands: float
    """Duration by TOPP-RA under limits of velocity and acceleration, with slow hands near switches."""


def time_motion(states: MotionStates) -> MotionTiming:
    """Measure the durations of a motion and those of the fastest motions along the same path.

    Args:
        states: The motion as it was planned, with the poses of its bodies.
    """
    motion = states.motion
    joints = qpos_layout(states.scene).arm_joints.reshape(-1)
    parts = moving_parts(motion, motion.qpos[:, joints])
    robot = states.scene.workcell.robot
    arms = states.scene.workcell.number_of_arms
    velocity = np.tile(robot.joint_velocity, arms)
    acceleration = np.tile(robot.joint_acceleration, arms)
    torque = np.minimum(np.tile(robot.joint_torque, arms), LARGEST_TORQUE)

    fastest = 0.0
    with_torque = 0.0
    with_slow_hands = 0.0
    for part in parts:
        states_along = path_points(motion, part)
        points = states_along[:, joints]
        limits = [
            JointVelocityConstraint(_both_signs(velocity)),
            JointAccelerationConstraint(_both_signs(acceleration)),
        ]
        torques = JointTorqueConstraint(
            _torques(states, part), _both_signs(torque), np.zeros(len(torque))
        )
        slow = slow_hand_limit(states, states_along, part.first, part.last)
        fastest += fastest_duration(points, limits)
        with_torque += fastest_duration(points, [*limits, torques])
        with_slow_hands += fastest_duration(points, [*limits, slow])

    return MotionTiming(
        duration=float(motion.time[-1] - motion.time[0]),
        moving=motion.step * sum(part.last - part.first for part in parts),
        fastest=fastest,
        fastest_with_torque=with_torque,
        fastest_with_slow_hands=with_slow_hands,
    )


def moving_parts(motion: Motion, q: Float[np.ndarray, "samples joints"]) -> list[MovingPart]:
    """Return the parts of a motion in which arms move, at most one between two switches.

    Args:
        motion: The motion.
        q: Joint angles of all arms at its samples [rad].
    """
    moves = np.abs(np.diff(q, axis=0)).max(axis=1) > STILL
    edges = [0, *motion.switch.tolist(), len(moves)]
    parts = []
    for start, end in pairwise(edges):
        steps = np.flatnonzero(moves[start:end])
        if len(steps):
            parts.append(MovingPart(start + int(steps[0]), start + int(steps[-1]) + 1))
    return parts


def path_points(motion: Motion, part: MovingPart) -> Float[np.ndarray, "points nq"]:
    """Return states at equal distances along the path of a moving part, in the space of all states.

    Args:
        motion: The motion.
        part: The part.
    """
    start, end = motion.time[[part.first, part.last]] - motion.time[0]
    number = math.ceil((end - start) * FINE_RATE) + 1
    fine = spline_of(motion)(np.linspace(start, end, number))

    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    distinct = np.append(np.diff(length) > SHORTEST_PATH * length[-1], True)
    along = PchipInterpolator(length[distinct], fine[distinct])
    points = along(np.linspace(length[distinct][0], length[-1], PATH_POINTS + 1))
    points[[0, -1]] = fine[[0, -1]]
    return np.asarray(points)


def fastest_duration(points: Float[np.ndarray, "points joints"], limits: list[Any]) -> float:
    """Return the duration of the fastest motion along a path, from rest to rest, by TOPP-RA [s].

    Args:
        points: Joint angles at equal distances along the path [rad].
        limits: Constraints of `toppra`.

    Returns:
        The duration; NaN where no motion keeps the limits.
    """
    grid = np.linspace(0, 1, len(points))
    path = toppra.SplineInterpolator(grid, points)
    solver = TOPPRA(limits, path, gridpoints=grid, solver_wrapper="seidel")
    trajectory = solver.compute_trajectory(0, 0)
    return float(trajectory.duration) if trajectory is not None else math.nan


def _both_signs(limit: Float[np.ndarray, " joints"]) -> Float[np.ndarray, "joints 2"]:
    """Return the lower and upper limits of joints."""
    return np.stack([-limit, limit], axis=1)


def _torques(states: MotionStates, part: MovingPart) -> Torques:
    """Return the inverse dynamics of all arms with what they hold in a moving part.

    Args:
        states: The motion with the poses of its bodies.
        part: The part, which lies between two switches.
    """
    robot = states.scene.workcell.robot
    loaded = []
    for arm in range(states.scene.workcell.number_of_arms):
        load = None
        for interval in states.holds(arm):
            if interval.start <= part.first and part.last <= interval.end:
                load = load_in_hand(states, arm, interval.object, interval.start)
        loaded.append(LoadedArm(robot, load))

    def torques(q: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Torques of all arms [N m]."""
        each = zip(
            *(np.split(values, len(loaded)) for values in (q, velocity, acceleration)), strict=True
        )
        return np.concatenate(
            [
                arm.torques(*(values[None] for values in state))[0]
                for arm, state in zip(loaded, each, strict=True)
            ]
        )

    return torques
