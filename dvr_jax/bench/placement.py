"""Where a motion leaves the goal's object on its region, and how high carried objects are above the table."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.bench.motion_states import MotionStates
from dvr_jax.checker.operators.operator import AttachmentInterval
from dvr_jax.checker.shapes import shape_check_named
from dvr_jax.scene.mjcf import object_body_name

CENTERED = 0.25
"""A footprint is centered if its distance from the middle is no more than this fraction of the room on either side."""

EDGE_TOLERANCE = 1e-4
"""How much a distance from an edge may fall short of what is wanted [m]."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Where the footprint of the goal's object lies on the region at the end of a motion."""

    edge: float
    """Least distance of the footprint from the edges of the region [m]; negative where it reaches over one."""

    is_clear: bool
    """Whether, along each side of the region, the footprint keeps the clearance from both edges or is centered."""


def goal_placement(states: MotionStates) -> Placement:
    """Measure where the goal's object stands at the end of a motion.

    Args:
        states: The motion with the poses of its bodies.
    """
    scene = states.scene
    item = scene.objects[scene.goal_index]
    position, rotation = states.pose(object_body_name(item.name))
    outline = shape_check_named(item.shape).bottom_outline(item.size, position[-1], rotation[-1])

    # Distances from both edges along either side of the region.
    region = scene.paper_goal.region.footprint
    local = (outline.points - region.center) @ region.axes().T
    half = np.asarray(region.half)
    upper = half - local.max(axis=0) - outline.radius
    lower = half + local.min(axis=0) - outline.radius

    room = (upper + lower) / 2
    off_center = np.abs(upper - lower) / 2
    least = np.minimum(upper, lower)
    wanted = scene.workcell.clearances.region_edge - EDGE_TOLERANCE
    clear = (least >= wanted) | (off_center <= CENTERED * room + EDGE_TOLERANCE)
    return Placement(float(least.min()), bool(clear.all()))


def carried_height(states: MotionStates) -> float:
    """Return the least height of a carried object above the table [m], away from where it is lifted and put down.

    A held object counts while its center is farther than the length of an approach (`Clearances.approach`) from where
    it stood before its grasp, and from where it stands after it is placed.

    Args:
        states: The motion with the poses of its bodies.

    Returns:
        The height; infinite if no object is carried so far.
    """
    least = math.inf
    for interval in states.timeline.intervals:
        if interval.holder is not None:
            least = min([least, *_heights(states, interval)])
    return least


def _heights(states: MotionStates, interval: AttachmentInterval) -> Float[np.ndarray, " samples"]:
    """Return the heights of a held object at the samples at which it is away from where it stood or will stand [m].

    Args:
        states: The motion with the poses of its bodies.
        interval: An interval in which an arm holds the object.
    """
    item = states.scene.objects[interval.object]
    position, rotation = states.pose(object_body_name(item.name))
    near = states.scene.workcell.clearances.approach
    counts = np.zeros(len(position), bool)
    counts[interval.start : interval.end] = True

    before = states.timeline.before(interval)
    if before is not None and before.holder is None:
        counts &= np.linalg.norm(position - position[interval.start], axis=1) > near
    after = states.timeline.after(interval)
    if after is not None and after.holder is None:
        counts &= np.linalg.norm(position - position[interval.end], axis=1) > near

    shape = shape_check_named(item.shape)
    return np.array(
        [
            shape.lowest_point(item.size, position[sample], rotation[sample])
            for sample in np.flatnonzero(counts).tolist()
        ]
    )
