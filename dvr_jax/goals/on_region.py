"""The paper's goal: one object stands fully on a rectangular region of the table."""

from __future__ import annotations

from dataclasses import dataclass

from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.goals.goal import Fact

GOAL_SUPPORT = "goal"
"""Constant of the PDDL domain that stands for the region."""


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle on the table's top."""

    position: tuple[float, float]
    """Center (x, y) in the world [m]."""

    yaw: float
    """Turn about the world's z axis [rad]."""

    size: tuple[float, float]
    """Full extents (x, y) in its own frame [m]."""

    @property
    def footprint(self) -> Rectangle:
        """The rectangle itself."""
        return Rectangle(self.position, (self.size[0] / 2, self.size[1] / 2), self.yaw)


@dataclass(frozen=True, slots=True)
class OnRegion:
    """The object called `object` shall stand with its whole footprint on `region`."""

    object: str
    """Name of the object."""

    region: Region
    """Where it shall stand."""

    def facts(self) -> tuple[Fact, ...]:
        """The object is on the region."""
        return (("on", self.object, GOAL_SUPPORT),)

    def supports(self) -> dict[str, Rectangle]:
        """The region."""
        return {GOAL_SUPPORT: self.region.footprint}

    def sentence(self) -> str:
        """The goal in words."""
        return f"{self.object} on the red spot"
