"""How far an arm falls short of an object or a region: a necessary condition of an action that costs microseconds.

The *shoulder* of an arm is the origin of its first link's frame, which no joint moves. The gripper's center never gets
farther from the shoulder than the arm's *reach*. At a grasp or a place it is inside the object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import walk
from dvr_jax.operators import Operator
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import Robot
from dvr_jax.workcell.workcell import base_positions, base_rotations

REACH_MARGIN = 0.005
"""Added to the reach, which is found by a search over postures [m]."""

ANGLES = 33
"""Number of angles of one joint that this search compares."""

STARTS = 64
"""Number of postures that it starts from."""

SWEEPS = 4
"""Number of times that it goes through all joints."""


@lru_cache(maxsize=16)
def reach_of(robot: Robot) -> float:
    """Return the largest distance of the gripper's center from the shoulder of a robot [m].

    The distance is maximized by coordinate ascent: the angles of one joint after the other are compared on a grid.
    """
    low, high = robot.joint_limits
    q = np.random.default_rng(0).uniform(low, high, (STARTS, len(low)))
    for _ in range(SWEEPS):
        for joint in range(len(low)):
            tried = np.repeat(q[:, None], ANGLES, axis=1)
            tried[:, :, joint] = np.linspace(low[joint], high[joint], ANGLES)
            best = np.argmax(_distance_from_shoulder(robot, tried), axis=1)
            q = tried[np.arange(STARTS), best]
    return float(_distance_from_shoulder(robot, q).max()) + REACH_MARGIN


def _distance_from_shoulder(
    robot: Robot, q: Float[np.ndarray, "*batch joints"]
) -> Float[np.ndarray, "*batch"]:
    """Return the distance of the gripper's center from the shoulder [m]."""
    # From the gripper back to the shoulder: each joint turns the point about its z axis, each link displaces it.
    point = np.broadcast_to(robot.gripper_center, (*q.shape[:-1], 3))
    for joint in reversed(range(q.shape[-1])):
        c = np.cos(q[..., joint])
        s = np.sin(q[..., joint])
        x, y, z = np.moveaxis(point, -1, 0)
        point = np.stack([c * x - s * y, s * x + c * y, z], axis=-1)
        if joint > 0:
            point = robot.link_offsets[joint] + point @ robot.link_rotations[joint].T
    return np.asarray(np.linalg.norm(point, axis=-1))


def missing_reach(
    scene: Scene, window: Sequence[Action | None], operators: Sequence[Operator]
) -> float:
    """Return by how much the acting arm of the last action of a window certainly falls short [m].

    Args:
        scene: A valid scene.
        window: Actions that follow each other on one object; None in the first place stands for the start.
        operators: The operators that are known.

    Returns:
        The missing length; zero or less if the arm may reach.
    """
    actions = [action for action in window if action is not None]
    _, switches = walk(scene, actions, (), operators)
    switch = switches[-1]
    item = scene.objects[switch.item]
    if switch.mode.kind == ModeKind.PLACED and switch.support is not None:
        target = nearest_point(switch.support, base_positions(scene.workcell)[switch.acting_arm])
        height = switch.mode.bottom + item.half_extents[2]
    elif window[0] is None and len(actions) == 1:
        target = np.asarray(item.position)
        height = scene.center_of(item)[2]
    else:
        return -math.inf
    center = np.array([*target, height])
    distance = float(np.linalg.norm(center - _shoulder(scene, switch.acting_arm)))
    return distance - math.hypot(*item.half_extents) - reach_of(scene.workcell.robot)


def base_distance(scene: Scene, arm: int, point: tuple[float, float]) -> float:
    """Return the horizontal distance of a point from the base of an arm [m].

    Args:
        scene: A valid scene.
        arm: Index of the arm.
        point: Point (x, y) on the table [m].
    """
    return float(np.hypot(*(base_positions(scene.workcell)[arm][:2] - np.asarray(point))))


def _shoulder(scene: Scene, arm: int) -> Float[np.ndarray, " 3"]:
    """Return the position of the shoulder of an arm [m]."""
    base = base_positions(scene.workcell)[arm]
    rotation = base_rotations(scene.workcell)[arm]
    return np.asarray(base + rotation @ scene.workcell.robot.link_offsets[0])


def nearest_point(rectangle: Rectangle, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 2"]:
    """Return the point of a rectangle that is nearest to a given one [m]."""
    axes = rectangle.axes()
    local = axes @ (point[:2] - np.asarray(rectangle.center))
    half = np.asarray(rectangle.half)
    return np.asarray(np.asarray(rectangle.center) + np.clip(local, -half, half) @ axes)
