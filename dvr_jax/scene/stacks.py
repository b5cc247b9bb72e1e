"""Stacks: which objects are supports, where on its top another object may stand, and the rules of stacks at the start.

One object at most stands on another one, and its center is over the top of the lower one, with a margin from the edge.
Footprints of the two do not matter otherwise.
"""

from __future__ import annotations

import math

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Circle, Rectangle, contains_point
from dvr_jax.goals import TABLE
from dvr_jax.scene.rules import CONTACT_TOLERANCE
from dvr_jax.scene.types import Scene, SceneObject

TOP_MARGIN = 5e-3
"""Least distance of the center of an object from the edge of the top on which it stands [m]."""


def top_half_extents(item: SceneObject) -> tuple[float, float]:
    """Return the half extents along x and y of the object of a rectangle that its top contains [m].

    It is the whole top of a box, and the largest square in the top of a cylinder.
    """
    footprint = item.footprint
    if isinstance(footprint, Circle):
        half = footprint.radius / math.sqrt(2)
        return half, half
    return footprint.half


def top_area(item: SceneObject) -> Rectangle:
    """Return where the center of an upper object may be, while this object stands where the scene has it."""
    hx, hy = top_half_extents(item)
    half = (max(hx - TOP_MARGIN, 0.0), max(hy - TOP_MARGIN, 0.0))
    return Rectangle(item.position, half, item.yaw)


def standing_on(scene: Scene) -> dict[str, str]:
    """Return the object on which each object of a stack stands at the start, by the name of the upper one.

    As a support, the name "table" always means the table, although an object may have it.
    """
    names = set(scene.object_names) - {TABLE}
    return {item.name: item.support for item in scene.objects if item.support in names}


def objects_above(scene: Scene, name: str) -> tuple[str, ...]:
    """Return the names of the objects that stand on an object at the start, the lowest first.

    Args:
        scene: A valid scene.
        name: Name of the object.
    """
    upper_of = {lower: upper for upper, lower in standing_on(scene).items()}
    found = []
    while name in upper_of:
        name = upper_of[name]
        found.append(name)
    return tuple(found)


def require_valid_stacks(scene: Scene) -> None:
    """Refuse objects that stand on themselves or on each other, two objects on one, and an object beside its support.

    Raises:
        SceneError: A rule is broken; the message names the object.
    """
    lower_of = standing_on(scene)
    for upper, lower in lower_of.items():
        _require_no_circle(upper, lower_of)
        others = [name for name in lower_of if name != upper and lower_of[name] == lower]
        if others:
            raise SceneError(
                f"the objects {upper!r} and {others[0]!r} both stand on {lower!r}; valid is one object on another."
            )

        item = scene.objects[scene.object_index(upper)]
        area = top_area(scene.objects[scene.object_index(lower)])
        width, depth = (half + CONTACT_TOLERANCE for half in area.half)
        if not contains_point(item.position, Rectangle(area.center, (width, depth), area.yaw)):
            raise SceneError(
                f"the center of {upper!r} is not over the top of {lower!r}, on which it stands, or is nearer to its "
                f"edge than {1000 * TOP_MARGIN:g} mm; move it."
            )


def _require_no_circle(name: str, lower_of: dict[str, str]) -> None:
    """Refuse an object that stands on itself, perhaps by way of others."""
    seen = [name]
    while seen[-1] in lower_of:
        seen.append(lower_of[seen[-1]])
        if seen[-1] == name:
            chain = " on ".join(map(repr, seen))
            raise SceneError(
                f"objects stand on each other in a circle: {chain}; one has to stand on a body."
            )
        if seen.count(seen[-1]) > 1:
            return
