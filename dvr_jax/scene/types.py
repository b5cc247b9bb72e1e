"""What a scene is: objects on the table, a goal region, and the arms' home postures. Plain frozen records.

World frame, metres, radians (see `workspace`). Every object stands upright on the table's top, z = 0.
The records check nothing; `validation.validate_scene` and the factory `validation.make_scene` do.
"""

from dataclasses import dataclass
from typing import Literal

from dvr_jax.geometry.footprint import Circle, Footprint, Rectangle
from dvr_jax.workcell.constants import HOME_POSTURE

Shape = Literal["box", "cylinder"]

Home = tuple[tuple[float, ...], tuple[float, ...]]
"""Joint angles of the left and the right arm (2 x 7), rad."""

DEFAULT_HOME: Home = (HOME_POSTURE, HOME_POSTURE)


@dataclass(frozen=True, slots=True)
class SceneObject:
    """A box or an upright cylinder that stands on the table."""

    name: str
    """Unique in its scene, not empty."""
    shape: Shape
    size: tuple[float, ...]
    """Box: full extents (sx, sy, sz) in its own frame; cylinder: (radius, height). Metres."""
    position: tuple[float, float]
    """Centre (x, y) in the world, m."""
    yaw: float
    """Turn about the world's z, rad."""

    @property
    def height(self) -> float:
        """Full extent along z, m."""
        return self.size[-1]

    @property
    def half_extents(self) -> tuple[float, float, float]:
        """Half extents of the shape's bounding box in the object's own frame, m."""
        if self.shape == "box":
            return (self.size[0] / 2, self.size[1] / 2, self.size[2] / 2)
        return (self.size[0], self.size[0], self.size[1] / 2)

    @property
    def center(self) -> tuple[float, float, float]:
        """Centre of the volume in the world, m; the origin of the object's own frame."""
        return (self.position[0], self.position[1], self.height / 2)

    @property
    def footprint(self) -> Footprint:
        """What the object covers of the table."""
        if self.shape == "box":
            return Rectangle(self.position, (self.size[0] / 2, self.size[1] / 2), self.yaw)
        return Circle(self.position, self.size[0])


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle on the table's top."""

    position: tuple[float, float]
    """Centre (x, y) in the world, m."""
    yaw: float
    """Turn about the world's z, rad."""
    size: tuple[float, float]
    """Full extents (sx, sy) in its own frame, m."""

    @property
    def footprint(self) -> Rectangle:
        """The rectangle itself."""
        return Rectangle(self.position, (self.size[0] / 2, self.size[1] / 2), self.yaw)


@dataclass(frozen=True, slots=True)
class Goal:
    """The object called `object` shall stand fully within `region`."""

    object: str
    region: Region


@dataclass(frozen=True, slots=True)
class Scene:
    """One problem: 1 to 8 objects, where one of them shall go, and the postures in which the arms start."""

    objects: tuple[SceneObject, ...]
    goal: Goal
    home: Home = DEFAULT_HOME

    def object_index(self, name: str) -> int:
        """Index of the object called `name` in `objects`; KeyError when there is none."""
        for index, candidate in enumerate(self.objects):
            if candidate.name == name:
                return index
        raise KeyError(name)

    @property
    def goal_index(self) -> int:
        """Index of the goal's object in `objects`."""
        return self.object_index(self.goal.object)
