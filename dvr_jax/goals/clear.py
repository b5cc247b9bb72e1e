"""The fact that nothing stands on a region.

An object occupies a region if its footprint covers a part of it. Objects that occupy the region at the start have to be
put down elsewhere. Where a goal has this fact, a place on the table or on another region keeps off the region, so that
only a place on the region itself occupies it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dvr_jax.goals.fact import EndCondition, GoalWorld, register_fact


@register_fact
@dataclass(frozen=True, slots=True)
class Clear:
    """No object covers any part of the region."""

    keyword: ClassVar[str] = "clear"
    """First word of the fact in scene files."""

    region: str
    """Name of the region."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return that no object is on the region, and that no arm holds one that was there at the start."""
        conditions = []
        for item in world.objects:
            conditions.append(EndCondition(("on", item, self.region), item, holds=False))
            # A grasp alone does not take the object away.
            if (item, self.region) in world.touching:
                conditions += [
                    EndCondition(("holding", arm, item), item, holds=False) for arm in world.arms
                ]
        return tuple(conditions)

    def sentence(self) -> str:
        """Return the fact in words."""
        return f"{self.region} clear"
