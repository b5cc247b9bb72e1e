"""Objects as supports: the mode switch by which an object is placed on another one.

The parameters are those of any placed object, its pose in the world. The block `dvr_jax.nlp.blocks.on_top` ties them to
the lower object. The center of the upper object stays in the middle of the lower one's top, because a stack is the more
stable the better it is centered.
"""

from __future__ import annotations

from dvr_jax.operators.operator import SkeletonState, Top
from dvr_jax.scene.stacks import TOP_MARGIN, top_half_extents
from dvr_jax.scene.types import Scene, SceneObject

TOP_SHARE = 0.25
"""The center of an upper object is at most this part of a half extent from the middle of the top."""

TOP_ROOM = 2e-3
"""Distance by which the allowed area stays within `TOP_MARGIN`, because a feasible point may fall short of it [m]."""

SMALLEST_AREA = 3e-4
"""Least half extent of the allowed area [m]."""


def allowed_half_extents(item: SceneObject) -> tuple[float, float]:
    """Return the half extents of the area on an object's top where the center of an upper one may be [m].

    They are below `SMALLEST_AREA` if the top is too small.
    """
    hx, hy = top_half_extents(item)
    margin = TOP_MARGIN + TOP_ROOM
    return min(TOP_SHARE * hx, hx - margin), min(TOP_SHARE * hy, hy - margin)


def refute_top(item: SceneObject) -> str | None:
    """Return why nothing can be placed on an object, or None."""
    if min(allowed_half_extents(item)) >= SMALLEST_AREA:
        return None
    return f"the top of {item.name} is too small for another object to stand on it"


def top_of(scene: Scene, name: str) -> Top:
    """Return where on an object another one is placed.

    Args:
        scene: A valid scene.
        name: Name of the lower object.
    """
    lower = scene.object_index(name)
    return Top(lower, allowed_half_extents(scene.objects[lower]))


def height_of_top(state: SkeletonState, lower: int) -> float:
    """Return the height of the top of an object that stands, above the table's top [m].

    Args:
        state: The state before an action.
        lower: Index of the object.
    """
    return state.modes[lower].bottom + state.scene.objects[lower].height
