"""Objects that stand where another one has to be placed, so that no placement fits, by a cheap sufficient condition.

An upright object covers the disc around its center whose radius r is its smaller half extent. If it lies within a
rectangle, its center is at least r away from all edges, so that the center lies in a smaller rectangle. An object
excludes all placements if its distance from every point of this smaller rectangle is less than r. The distance from a
convex body is a convex function, so that its largest value on the rectangle is that of a corner.
"""

from __future__ import annotations

from dvr_jax.geometry.footprint import Circle, Rectangle, signed_distance
from dvr_jax.goals import Inside
from dvr_jax.scene.types import Scene, SceneObject

MARGIN = 3e-3
"""Least overlap that counts, which is more than the tolerances of the solver add up to [m]."""


def overlap_of_all_placements(
    item: SceneObject, region: Rectangle, other: SceneObject, is_whole: bool = True
) -> float:
    """Return by how much an object overlaps another one, wherever it is placed on a region.

    Args:
        item: The object that is placed.
        region: The region.
        other: An object that stands on the same body as the region lies on.
        is_whole: Whether the whole footprint has to lie on the region; otherwise only the center has to.

    Returns:
        A lower bound of the overlap [m]; zero or less if there may be a placement without overlap.
    """
    footprint = item.footprint
    radius = footprint.radius if isinstance(footprint, Circle) else min(footprint.half)
    width, depth = region.half
    border = radius if is_whole else 0.0
    room = Rectangle(
        region.center, (max(width - border, 0.0), max(depth - border, 0.0)), region.yaw
    )
    farthest = max(
        signed_distance(Circle((float(x), float(y)), 0.0), other.footprint)
        for x, y in room.corners()
    )
    return radius - farthest


def obstructions(scene: Scene, name: str, support: str) -> dict[str, float]:
    """Return the objects that exclude all placements of an object while they stand where the scene has them.

    Args:
        scene: A valid scene.
        name: Name of the object that is placed.
        support: Name of a region.

    Returns:
        A lower bound of each overlap [m], by the name of the obstruction.
    """
    item = scene.objects[scene.object_index(name)]
    region = scene.region(support)
    is_whole = region.inside == Inside.FOOTPRINT
    overlaps = {
        other.name: overlap_of_all_placements(item, region.footprint, other, is_whole)
        for other in scene.objects
        if other.name != name and other.support == region.support
    }
    return {other: overlap for other, overlap in overlaps.items() if overlap > MARGIN}
