"""The supports of a scene, and the check that an object stands on one of them."""

from __future__ import annotations

import numpy as np

from dvr_jax.checker.kinds import SUPPORT_HEIGHT, SUPPORT_OVERHANG, SUPPORT_TILT
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.shapes import shape_check_named
from dvr_jax.checker.tolerances import SUPPORT_TOLERANCE, TURN
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.scene.types import Scene

TABLE_SUPPORT = "table"
"""Name of the table as a support."""


def support_areas(scene: Scene) -> dict[str, Rectangle]:
    """Return the area of each support of a scene on the table's top, by its name."""
    table = Rectangle((0.0, 0.0), scene.workcell.table.half_extents, 0.0)
    return {TABLE_SUPPORT: table, **scene.goal.supports()}


def check_standing(
    motion: ReplayedMotion, index: int, support: str, sample: int, log: FindingLog
) -> None:
    """Check that an object stands upright on the table's top with its whole bottom within the area of a support.

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
    log.add(SUPPORT_HEIGHT, sample, names, abs(height), SUPPORT_TOLERANCE)

    # Overhang of every point of the outline over each of the four borders.
    outline = shape.bottom_outline(item.size, position, rotation)
    area = support_areas(motion.scene)[support]
    local = (outline.points - area.center) @ area.axes().T
    overhang = np.abs(local) + outline.radius - area.half
    log.add(SUPPORT_OVERHANG, sample, names, float(overhang.max()), SUPPORT_TOLERANCE)
