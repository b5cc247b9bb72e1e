"""What a scene is: a workcell, objects on its table, fixed bodies, regions and a goal. Plain frozen records.

World frame, meters, radians (see `dvr_jax.workcell`). The table's top is z = 0. Every object stands upright on the
table or on the top of a fixed body. The records check nothing; `dvr_jax.scene.validation.validate_scene` and
`make_scene` there do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Footprint, Rectangle
from dvr_jax.goals import TABLE, Goal, Inside, OnRegion, Region
from dvr_jax.shapes import Shape, shape_named
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Home, Workcell

__all__ = [
    "MAXIMUM_FIXED_BODIES",
    "MAXIMUM_OBJECTS",
    "MAXIMUM_REGIONS",
    "FixedBody",
    "Goal",
    "Inside",
    "OnRegion",
    "Region",
    "Scene",
    "SceneObject",
    "Support",
]

MAXIMUM_OBJECTS = 8
"""A scene has 1 to this many objects."""

MAXIMUM_FIXED_BODIES = 16
"""A scene has at most this many fixed bodies."""

MAXIMUM_REGIONS = 8
"""A scene has at most this many regions of its own."""


USUAL_DENSITY = 300.0
"""Density of an object whose scene states none [kg/m^3]: a box of cardboard that is partly full."""

USUAL_FRICTION = 1.0
"""Coefficient of friction of an object whose scene states none."""


@dataclass(frozen=True, slots=True)
class SceneObject:
    """A movable body that stands upright on the table, or on the top of another body."""

    name: str
    """Unique in its scene, not empty."""

    shape: str
    """Name of the shape: "box", "cylinder" or another registered one."""

    size: tuple[float, ...]
    """Numbers of the shape [m]; box: full extents (x, y, z) in its own frame; cylinder: (radius, height)."""

    position: tuple[float, float]
    """Center (x, y) in the world [m]."""

    yaw: float
    """Turn about the world's z axis [rad]."""

    density: float = USUAL_DENSITY
    """Density [kg/m^3]."""

    friction: float = USUAL_FRICTION
    """Coefficient of sliding friction on the table and between the pads of a gripper."""

    support: str = TABLE
    """Name of the body on whose top it stands: the table, or a fixed body."""

    @property
    def kind(self) -> Shape:
        """The shape itself."""
        return shape_named(self.shape)

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        hx, hy, hz, radius = self.kind.prism(self.size)
        area = 4 * hx * hy + 4 * radius * (hx + hy) + math.pi * radius**2
        return self.density * 2 * hz * area

    @property
    def height(self) -> float:
        """Full extent along z [m]."""
        return 2 * self.half_extents[2]

    @property
    def half_extents(self) -> tuple[float, float, float]:
        """Half extents of the bounding box in the object's own frame [m]."""
        return self.kind.half_extents(self.size)

    @property
    def footprint(self) -> Footprint:
        """What the object covers of the body on which it stands."""
        return self.kind.footprint(self.size, self.position, self.yaw)


@dataclass(frozen=True, slots=True)
class FixedBody:
    """An upright body that never moves: a wall, a shelf board, the rim of a bin."""

    name: str
    """Unique among the scene's objects and fixed bodies, not empty."""

    shape: str
    """Name of the shape, as of a `SceneObject`."""

    size: tuple[float, ...]
    """Numbers of the shape [m]."""

    position: tuple[float, float, float]
    """Center of the volume in the world [m], at any height above the table."""

    yaw: float
    """Turn about the world's z axis [rad]."""

    @property
    def kind(self) -> Shape:
        """The shape itself."""
        return shape_named(self.shape)

    @property
    def half_extents(self) -> tuple[float, float, float]:
        """Half extents of the bounding box in the body's own frame [m]."""
        return self.kind.half_extents(self.size)

    @property
    def bottom(self) -> float:
        """Height of the lowest point above the table [m]."""
        return self.position[2] - self.half_extents[2]

    @property
    def top(self) -> float:
        """Height of the highest point above the table [m]."""
        return self.position[2] + self.half_extents[2]

    @property
    def footprint(self) -> Footprint:
        """The body's outline seen from above."""
        return self.kind.footprint(self.size, self.position[:2], self.yaw)


@dataclass(frozen=True, slots=True)
class Support:
    """A horizontal area on which objects are placed: the top of a body, or a region on it."""

    area: Rectangle
    """The area, seen from above."""

    height: float
    """Height of the area above the table's top [m]."""

    owner: str
    """Name of the body whose top it is."""

    inside: Inside
    """What of an object has to lie within the area."""


@dataclass(frozen=True, slots=True)
class Scene:
    """One problem: the workcell, 1 to 8 objects on its table, fixed bodies, regions, and a goal."""

    objects: tuple[SceneObject, ...]
    """The movable bodies; arrays with an axis of objects follow this order."""

    goal: OnRegion | Goal
    """What shall hold at the end of a plan."""

    workcell: Workcell = DEFAULT_WORKCELL
    """The arms and their table."""

    fixed: tuple[FixedBody, ...] = ()
    """Bodies that nothing may touch and nothing moves."""

    regions: tuple[Region, ...] = ()
    """Regions, beside the one that an `OnRegion` brings along."""

    @property
    def all_regions(self) -> tuple[Region, ...]:
        """The region of an `OnRegion`, then the scene's own regions."""
        return (*self.goal.regions, *self.regions)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of all regions."""
        return tuple(region.name for region in self.all_regions)

    def region(self, name: str) -> Region:
        """Return the region called `name`; KeyError when there is none."""
        for region in self.all_regions:
            if region.name == name:
                return region
        raise KeyError(name)

    def with_region(self, changed: Region) -> Scene:
        """Return this scene with the region of the same name replaced."""
        if isinstance(self.goal, OnRegion) and self.goal.region.name == changed.name:
            return replace(self, goal=replace(self.goal, region=changed))
        regions = (changed if region.name == changed.name else region for region in self.regions)
        return replace(self, regions=tuple(regions))

    def height_of_top(self, name: str) -> float:
        """Return the height of the top of the table or of a fixed body above the table's top [m].

        Raises:
            KeyError: There is no such body.
        """
        if name == TABLE:
            return 0.0
        for body in self.fixed:
            if body.name == name:
                return body.top
        raise KeyError(name)

    def bottom_of(self, item: SceneObject) -> float:
        """Return the height of the bottom of an object at the start above the table's top [m]."""
        return self.height_of_top(item.support)

    def center_of(self, item: SceneObject) -> tuple[float, float, float]:
        """Return the center of an object's volume at the start in the world [m]; the origin of the object's frame."""
        return (*item.position, self.bottom_of(item) + item.half_extents[2])

    def supports(self) -> dict[str, Support]:
        """Return everything on which objects are placed, by name: the table, and all regions."""
        table = Rectangle((0.0, 0.0), self.workcell.table.half_extents, 0.0)
        found = {TABLE: Support(table, 0.0, TABLE, Inside.FOOTPRINT)}

        for region in self.all_regions:
            height = self.height_of_top(region.support)
            found[region.name] = Support(region.footprint, height, region.support, region.inside)

        return found

    @property
    def paper_goal(self) -> OnRegion:
        """The goal, where it is one object on one region, as in the paper.

        Raises:
            SceneError: The scene has another goal.
        """
        if isinstance(self.goal, OnRegion):
            return self.goal
        raise SceneError(
            f"the goal is {self.goal.sentence()!r}; valid here is one object on the region that the goal brings along."
        )

    @property
    def home(self) -> Home:
        """Joint angles of every arm at the start [rad]."""
        return self.workcell.home

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the objects, in their order."""
        return tuple(item.name for item in self.objects)

    def object_index(self, name: str) -> int:
        """Index of the object called `name` in `objects`; KeyError when there is none."""
        for index, candidate in enumerate(self.objects):
            if candidate.name == name:
                return index
        raise KeyError(name)

    @property
    def goal_index(self) -> int:
        """Index of the object of the paper's goal in `objects`."""
        return self.object_index(self.paper_goal.object)

    def with_clearance(self, factor: float) -> Scene:
        """Return this scene with all clearances of its workcell multiplied by a factor.

        Raises:
            OptionError: The factor is no number from 0 to 3.
        """
        clearances = self.workcell.clearances.scaled(factor)
        return replace(self, workcell=replace(self.workcell, clearances=clearances))
