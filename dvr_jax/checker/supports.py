"""The check that an object stands on a support, and that no object covers a region."""

from __future__ import annotations

import numpy as np

from dvr_jax.checker.kinds import (
    REGION_COVERED,
    SUPPORT_HEIGHT,
    SUPPORT_OVERHANG,
    SUPPORT_TILT,
)
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.shapes import Outline, shape_check_named
from dvr_jax.checker.tolerances import SUPPORT_TOLERANCE, TURN
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.goals import Inside

LYING_HEIGHT = 0.01
"""An object whose lowest point is farther than this above or below a region does not cover it: it is held above it, or
is below the body on which the region lies [m]."""

SHORTEST_SIDE = 1e-9
"""Shorter sides of an outline have no direction [m]."""


def check_standing(
    motion: ReplayedMotion, index: int, support: str, sample: int, log: FindingLog
) -> None:
    """Check that an object stands upright on a support with its whole bottom, or its center, within the support's area.

    Args:
        motion: The replayed motion.
        index: Number of the object.
        support: Name of the support.
        sample: Sample to look at.
        log: Takes the findings.
    """
    item = motion.scene.objects[index]
    shape = shape_check_named(item.shape)
    position = motion.object_positions[sample, index]
    rotation = motion.object_rotations[sample, index]
    names = (motion.object_label(index), support)

    tilt = np.arctan2(np.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
    log.add(SUPPORT_TILT, sample, names, float(tilt), TURN)

    height = shape.lowest_point(item.size, position, rotation)
    place = motion.scene.supports()[support]
    log.add(SUPPORT_HEIGHT, sample, names, abs(height - place.height), SUPPORT_TOLERANCE)

    # Overhang of every point of the outline, or of the center alone, over each of the four borders.
    outline = Outline(position[None, :2], 0.0)
    if place.inside == Inside.FOOTPRINT:
        outline = shape.bottom_outline(item.size, position, rotation)
    local = (outline.points - place.area.center) @ place.area.axes().T
    overhang = np.abs(local) + outline.radius - place.area.half
    log.add(SUPPORT_OVERHANG, sample, names, float(overhang.max()), SUPPORT_TOLERANCE)


def check_not_covering(
    motion: ReplayedMotion, index: int, region: str, sample: int, log: FindingLog
) -> None:
    """Check that an object covers no part of a region, unless it is held above the region or is below it.

    Args:
        motion: The replayed motion.
        index: Number of the object.
        region: Name of the region.
        sample: Sample to look at.
        log: Takes the findings.
    """
    item = motion.scene.objects[index]
    shape = shape_check_named(item.shape)
    position = motion.object_positions[sample, index]
    rotation = motion.object_rotations[sample, index]
    place = motion.scene.supports()[region]
    if abs(shape.lowest_point(item.size, position, rotation) - place.height) > LYING_HEIGHT:
        return

    depth = covered_depth(shape.bottom_outline(item.size, position, rotation), place.area)
    log.add(REGION_COVERED, sample, (motion.object_label(index), region), depth, SUPPORT_TOLERANCE)


def covered_depth(outline: Outline, area: Rectangle) -> float:
    """Return how deep an outline reaches into a rectangle [m]; negative if a straight line separates them.

    The directions of the sides of both are tried (separating axis theorem). A single point has no sides; then the
    direction from the nearest point of the rectangle takes their place.

    Args:
        outline: The outline of an object's bottom.
        area: The rectangle.
    """
    sides = outline.points[:, None] - outline.points[None, :]
    normals = np.stack([-sides[..., 1], sides[..., 0]], axis=-1).reshape(-1, 2)
    center = outline.points.mean(axis=0)
    local = area.axes() @ (center - np.asarray(area.center))
    nearest = (
        np.asarray(area.center) + np.clip(local, -np.asarray(area.half), area.half) @ area.axes()
    )
    directions = np.concatenate([area.axes(), normals, [center - nearest]])
    lengths = np.linalg.norm(directions, axis=1)
    directions = directions[lengths > SHORTEST_SIDE] / lengths[lengths > SHORTEST_SIDE, None]

    ours = outline.points @ directions.T
    theirs = area.corners() @ directions.T
    gaps = np.maximum(ours.min(0) - theirs.max(0), theirs.min(0) - ours.max(0)) - outline.radius
    return -float(gaps.max())
