"""Rules of regions and goals: known names, facts that do not contradict each other, and room for the objects.

A goal is refused only if it is certain that no end state satisfies it. Whether a goal with room can be reached is a
question for the search.
"""

import math
from itertools import combinations

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Circle, Footprint, covers, fits
from dvr_jax.goals import (
    GOAL_REGION,
    TABLE,
    EndCondition,
    Goal,
    GoalFact,
    Inside,
    OnRegion,
    Region,
    field_names,
)
from dvr_jax.scene.room import has_room
from dvr_jax.scene.rules import (
    OVERLAP_TOLERANCE,
    SMALLEST_SIZE,
    YAW_RANGE,
    in_words,
    require_name,
    require_numbers,
    require_unique,
)
from dvr_jax.scene.start import goal_world
from dvr_jax.scene.support_rules import require_on_top, require_support
from dvr_jax.scene.types import MAXIMUM_REGIONS, Scene, SceneObject
from dvr_jax.scene.workcell_rules import base_footprints, base_height

ROOM_TOLERANCE = 1e-6
"""Lengths [m] and areas [m^2] by which objects may lack room on a region, so that rounding does not decide."""


def validate_regions(scene: Scene) -> None:
    """Check the regions of a scene.

    Raises:
        SceneError: A rule is broken; the message names the region.
    """
    if isinstance(scene.goal, OnRegion) and scene.goal.region.name != GOAL_REGION:
        raise SceneError(
            f"the region of the goal is called {scene.goal.region.name!r}; an OnRegion's region is called "
            f"{GOAL_REGION!r}, and a Goal names regions of the scene."
        )
    if len(scene.regions) > MAXIMUM_REGIONS:
        raise SceneError(
            f"the scene has {len(scene.regions)} regions; valid are 0 to {MAXIMUM_REGIONS}."
        )

    bodies = (*scene.object_names, *(body.name for body in scene.fixed))
    for region in scene.regions:
        require_name("a region", region.name)
        if region.name == TABLE or region.name in bodies:
            raise SceneError(
                f"a region is called {region.name!r}, as another support or body of the scene; rename it."
            )
    require_unique("regions", scene.region_names)

    for region in scene.all_regions:
        _validate_region(region, scene)


def _validate_region(region: Region, scene: Scene) -> None:
    what = words_for(region)
    require_numbers(f"{what}'s size", region.size, 2, (SMALLEST_SIZE, math.inf), "m")
    require_numbers(f"{what}'s position", region.position, 2)
    require_numbers(f"{what}'s yaw", (region.yaw,), 1, YAW_RANGE, "rad")
    body = require_support(what, "lies", region.support, scene)
    if not isinstance(region.inside, Inside):
        valid = " and ".join(repr(str(value)) for value in Inside)
        raise SceneError(f"{what} has {region.inside!r} as 'inside'; valid are {valid}.")
    require_on_top(f"{what} at {in_words(region.position)}", region.footprint, body, scene)


def words_for(region: Region) -> str:
    """Return how messages call a region."""
    return "the goal region" if region.name == GOAL_REGION else f"the region {region.name!r}"


def validate_goal(scene: Scene) -> None:
    """Check that the goal names what the scene has, and that its facts do not contradict each other.

    Raises:
        SceneError: A rule is broken; the message names the fact.
    """
    goal = scene.goal
    if isinstance(goal, OnRegion):
        if goal.object not in scene.object_names:
            raise SceneError(
                f"the goal's object is {goal.object!r}; the scene has {_listed(scene.object_names)}."
            )
        return
    if not isinstance(goal, Goal):
        # A goal from outside of the package is judged by the check alone.
        return
    if not goal.facts:
        raise SceneError("the goal has no fact; valid is at least one.")

    for fact in goal.facts:
        _require_known_names(scene, fact)
        if goal.facts.count(fact) > 1:
            raise SceneError(f"the goal has the fact {fact.sentence()!r} twice; state it once.")
    for first, second in combinations(goal.facts, 2):
        _require_agreement(scene, first, second)


def _require_known_names(scene: Scene, fact: GoalFact) -> None:
    valid_names = {
        "object": scene.object_names,
        "arm": scene.workcell.arm_names,
        "region": scene.region_names,
    }
    for field in field_names(fact):
        value = getattr(fact, field)
        valid = valid_names.get(field)
        if valid is not None and value not in valid:
            raise SceneError(
                f"the goal's fact {fact.sentence()!r} names the {field} {value!r}; "
                f"the scene has {_listed(valid) or f'no {field}'}."
            )


def _require_agreement(scene: Scene, first: GoalFact, second: GoalFact) -> None:
    """Refuse two facts that cannot hold together."""
    world = goal_world(scene)
    ours = first.conditions(world)
    theirs = second.conditions(world)
    together = (
        f"the goal's facts {first.sentence()!r} and {second.sentence()!r} cannot hold together"
    )
    if any(condition.opposite in theirs for condition in ours):
        raise SceneError(f"{together}; leave one of them out.")

    for one in ours:
        for other in theirs:
            reason = _contradiction(one, other)
            if reason:
                raise SceneError(f"{together}: {reason}.")


def _contradiction(first: EndCondition, second: EndCondition) -> str:
    """Return why two conditions that have to hold exclude each other; empty if they do not."""
    if not (first.holds and second.holds) or first.fact == second.fact:
        return ""

    kinds = {first.fact[0], second.fact[0]}
    if first.item == second.item:
        if kinds == {"on"}:
            return f"{first.item!r} is in one place; name one region for it"
        return f"{first.item!r} cannot be held twice, nor held and put down"
    if kinds == {"holding"} and first.fact[1] == second.fact[1]:
        return f"the {first.fact[1]} arm holds one object"
    return ""


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(map(repr, names))


def validate_room(scene: Scene) -> None:
    """Check that each region has room for the objects that shall be on it, as far as that is certain.

    Raises:
        SceneError: An object certainly finds no place, or several ones certainly do not fit together.
    """
    wanted: dict[str, list[SceneObject]] = {}
    for fact in scene.goal.facts:
        for condition in fact.conditions(goal_world(scene)):
            predicate, *_, place = condition.fact
            if condition.holds and predicate == "on" and place in scene.region_names:
                item = scene.objects[scene.object_index(condition.item)]
                wanted.setdefault(place, []).append(item)

    for name, items in wanted.items():
        region = scene.region(name)
        for item in items:
            _require_room_for_one(scene, region, item)
        _require_room_for_all(region, items)


def _require_room_for_one(scene: Scene, region: Region, item: SceneObject) -> None:
    """An object must fit onto its region, beside the arms' bases, and under all that hangs over the region."""
    what = words_for(region)
    sides = (region.size[0] + OVERLAP_TOLERANCE, region.size[1] + OVERLAP_TOLERANCE)
    is_whole = region.inside == Inside.FOOTPRINT
    if is_whole and not fits(item.footprint, sides):
        raise SceneError(
            f"{what} of {in_words(region.size)} m cannot hold {item.name!r}, whose size is "
            f"{in_words(item.size)} m, however it is turned; make it larger."
        )

    height = scene.height_of_top(region.support)
    is_above_bases = height >= base_height(scene.workcell.robot)
    for arm in scene.workcell.arms:
        bases = () if is_above_bases else base_footprints(arm, scene.workcell.robot)
        if is_whole and not has_room(item.footprint, region.footprint, bases):
            raise SceneError(
                f"{what} at {in_words(region.position)} lies under the {arm.name} arm's base and leaves no "
                f"room for {item.name!r}; move it away."
            )

    # A body over a part of the region leaves room beside it, so only the search can judge it.
    for body in scene.fixed:
        is_below = body.top <= height + OVERLAP_TOLERANCE
        is_above = body.bottom >= height + item.height - OVERLAP_TOLERANCE
        if not is_below and not is_above and covers(body.footprint, region.footprint):
            raise SceneError(
                f"the fixed body {body.name!r} stands on the whole {what.removeprefix('the ')}, or hangs over it "
                f"lower than {item.name!r} is high, {item.height:g} m; move one of the two."
            )


def _require_room_for_all(region: Region, items: list[SceneObject]) -> None:
    """Refuse objects whose areas exceed that of their region, or of which two are too large for it together.

    A footprint contains a disc of radius r around its center. The centers of two objects on a region are at most as far
    apart as the diagonal of the region, shortened by the radii along both sides, and at least the sum of the radii.
    """
    what = words_for(region)
    margin = 1.0 if region.inside == Inside.FOOTPRINT else 0.0
    area = sum(_area(item.footprint) for item in items)
    if margin and area > region.size[0] * region.size[1] + ROOM_TOLERANCE:
        raise SceneError(
            f"{what} of {in_words(region.size)} m is too small for {_listed(tuple(i.name for i in items))} together: "
            f"they cover {area:.4g} m^2; make it larger."
        )

    for first, second in combinations(items, 2):
        radii = _inner_radius(first.footprint) + _inner_radius(second.footprint)
        room = [max(side - margin * radii, 0.0) for side in region.size]
        if math.hypot(*room) < radii - ROOM_TOLERANCE:
            raise SceneError(
                f"{what} of {in_words(region.size)} m cannot hold {first.name!r} and {second.name!r} "
                "side by side; make it larger."
            )


def _area(footprint: Footprint) -> float:
    if isinstance(footprint, Circle):
        return math.pi * footprint.radius**2
    return 4 * footprint.half[0] * footprint.half[1]


def _inner_radius(footprint: Footprint) -> float:
    """Return the radius of the largest disc around the center that a footprint contains [m]."""
    return footprint.radius if isinstance(footprint, Circle) else min(footprint.half)
