"""Whether a region leaves room for an object beside what stands on it: a test that never errs by saying no.

A footprint contains a disc of radius r around its center. Where the whole footprint lies on the region and overlaps no
obstacle, the center is at least r from the region's border and from every obstacle. The distance to the obstacles
changes by no more than a point is moved. So if it falls short of r by more than half a diagonal of a grid's cells at
all points of the grid, there is no place for the footprint.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.footprint import Circle, Footprint, Rectangle, signed_distance

POINTS = 41
"""Points of the grid along each axis."""


def has_room(item: Footprint, region: Rectangle, obstacles: Sequence[Footprint]) -> bool:
    """Return False if the footprint of an object finds no place on a region, however it is turned.

    Args:
        item: Footprint of the object.
        region: The region.
        obstacles: Footprints of what stands on the region or beside it.
    """
    near = [obstacle for obstacle in obstacles if signed_distance(region, obstacle) < 0]
    if not near:
        return True

    radius = item.radius if isinstance(item, Circle) else min(item.half)
    room = np.maximum(np.asarray(region.half) - radius, 0)
    along, across = np.meshgrid(*(np.linspace(-side, side, POINTS) for side in room))
    points = np.asarray(region.center) + np.stack([along, across], axis=-1) @ region.axes()

    distance = np.min([_distances(points, obstacle) for obstacle in near], axis=0)
    half_diagonal = float(np.hypot(room[0], room[1])) / (POINTS - 1)
    return bool(distance.max() >= radius - half_diagonal)


def _distances(
    points: Float[np.ndarray, "*points 2"], obstacle: Footprint
) -> Float[np.ndarray, "*points"]:
    """Signed distances of points to a footprint [m]: negative inside."""
    offset = points - np.asarray(obstacle.center)
    if isinstance(obstacle, Circle):
        return np.asarray(np.linalg.norm(offset, axis=-1) - obstacle.radius)

    beyond = np.abs(offset @ obstacle.axes().T) - np.asarray(obstacle.half)
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0))
