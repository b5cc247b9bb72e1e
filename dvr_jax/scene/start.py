"""Which facts of a goal hold at the start of a scene, and the scene as the symbolic layer sees it."""

from __future__ import annotations

from dvr_jax.geometry.footprint import Circle, Footprint, inside, signed_distance
from dvr_jax.goals import EndCondition, GoalWorld, Inside, OnRegion, Region
from dvr_jax.logic import Fact, Task
from dvr_jax.scene.types import Scene, SceneObject

START_TOLERANCE = 1e-3
"""At the start, a footprint may reach over the border of a region by this much [m], as at the end of a plan. The
independent check tolerates twice as much."""


def is_inside(item: SceneObject, region: Region, tolerance: float = START_TOLERANCE) -> bool:
    """Return whether an object is on a region: it stands on the region's support, and within the region.

    Args:
        item: The object.
        region: The region.
        tolerance: Distance by which the object may reach over the border [m].
    """
    if item.support != region.support:
        return False
    footprint: Footprint = item.footprint
    if region.inside == Inside.CENTER:
        footprint = Circle(item.position, 0.0)
    return inside(footprint, region.footprint, tolerance)


def is_touching(item: SceneObject, region: Region, tolerance: float = START_TOLERANCE) -> bool:
    """Return whether an object covers a part of a region.

    Args:
        item: The object.
        region: The region.
        tolerance: Depth up to which an overlap does not count [m].
    """
    if item.support != region.support:
        return False
    return signed_distance(item.footprint, region.footprint) < -tolerance


def goal_world(scene: Scene) -> GoalWorld:
    """Return the names in a scene, and which objects are on which regions at the start."""
    pairs = [(item, region) for item in scene.objects for region in scene.all_regions]
    return GoalWorld(
        arms=scene.workcell.arm_names,
        objects=scene.object_names,
        regions=scene.region_names,
        inside=frozenset((i.name, region.name) for i, region in pairs if is_inside(i, region)),
        touching=frozenset((i.name, region.name) for i, region in pairs if is_touching(i, region)),
    )


def start_facts(scene: Scene) -> frozenset[Fact]:
    """Return the symbolic facts that hold at the start, beside that every object is on the table.

    An object is on a region if it lies within it, and on a region that has to be clear if it covers a part of it.
    """
    world = goal_world(scene)
    kept_clear = cleared_regions(scene)
    pairs = {pair for pair in world.inside if pair[1] not in kept_clear}
    pairs |= {pair for pair in world.touching if pair[1] in kept_clear}
    return frozenset(("on", item, region) for item, region in pairs)


def cleared_regions(scene: Scene) -> tuple[str, ...]:
    """Return the names of the regions that no object may occupy at the end."""
    if isinstance(scene.goal, OnRegion):
        return ()
    found: dict[str, None] = {}
    for condition in scene.goal.conditions(goal_world(scene)):
        if condition.fact[0] == "on" and not condition.holds:
            found[condition.fact[-1]] = None
    return tuple(found)


def end_conditions(scene: Scene) -> tuple[EndCondition, ...]:
    """Return the symbolic conditions of a scene's goal."""
    return scene.goal.conditions(goal_world(scene))


def goal_holds_at_start(scene: Scene) -> bool:
    """Return whether the goal of a scene holds before any action."""
    at_start = start_facts(scene)
    return all((c.fact in at_start) == c.holds for c in end_conditions(scene))


def symbolic_task(scene: Scene) -> Task:
    """Return what the symbolic layer has to know of a scene.

    A sequence ends when the goal first holds. If it holds at the start, the search looks for another way to make it
    true, so nothing but the table supports objects at the start then. The same is true for the paper's goal.
    """
    names = (scene.object_names, scene.workcell.arm_names, scene.region_names)
    if isinstance(scene.goal, OnRegion):
        return Task(*names, goal=(("on", scene.goal.object, scene.goal.region.name),))

    conditions = end_conditions(scene)
    return Task(
        *names,
        goal=tuple(condition.fact for condition in conditions if condition.holds),
        forbidden=tuple(condition.fact for condition in conditions if not condition.holds),
        initial=() if goal_holds_at_start(scene) else tuple(sorted(start_facts(scene))),
    )
