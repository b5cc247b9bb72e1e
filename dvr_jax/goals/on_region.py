"""The paper's goal: one object stands on one region. It is the goal of scene files of version 1."""

from __future__ import annotations

from dataclasses import dataclass

from dvr_jax.goals.fact import EndCondition, GoalFact, GoalWorld
from dvr_jax.goals.on import On
from dvr_jax.goals.region import Region


@dataclass(frozen=True, slots=True)
class OnRegion:
    """The object called `object` shall stand on `region`, which belongs to the goal."""

    object: str
    """Name of the object."""

    region: Region
    """Where it shall stand; its name is `GOAL_REGION`."""

    @property
    def facts(self) -> tuple[GoalFact, ...]:
        """The one fact: the object is on the region."""
        return (On(self.object, self.region.name),)

    @property
    def regions(self) -> tuple[Region, ...]:
        """The region."""
        return (self.region,)

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the symbolic conditions of the fact."""
        return self.facts[0].conditions(world)

    def sentence(self) -> str:
        """The goal in words."""
        return f"{self.object} on the red spot"
