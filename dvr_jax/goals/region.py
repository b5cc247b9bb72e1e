"""Regions: named rectangles on the top of a support, on which objects are placed and of which goals speak."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from dvr_jax.geometry.footprint import Rectangle

TABLE = "table"
"""Name of the table as a support; it is a constant of the PDDL domain."""

GOAL_REGION = "goal"
"""Name of the region of the paper's goal; it is a constant of the PDDL domain."""


class Inside(StrEnum):
    """What of an object has to lie within a region, so that the object is on it."""

    FOOTPRINT = "footprint"
    """The whole footprint."""

    CENTER = "center"
    """The center of the object."""


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle on the top of a support."""

    position: tuple[float, float]
    """Center (x, y) in the world [m]."""

    yaw: float
    """Turn about the world's z axis [rad]."""

    size: tuple[float, float]
    """Full extents (x, y) in its own frame [m]."""

    name: str = GOAL_REGION
    """Unique among the regions of a scene."""

    support: str = TABLE
    """Name of the support that the region lies on."""

    inside: Inside = Inside.FOOTPRINT
    """What of an object has to lie within the region."""

    @property
    def footprint(self) -> Rectangle:
        """The rectangle itself."""
        return Rectangle(self.position, (self.size[0] / 2, self.size[1] / 2), self.yaw)
