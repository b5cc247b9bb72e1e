"""The fact that an object is on a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dvr_jax.goals.fact import EndCondition, GoalWorld, register_fact


@register_fact
@dataclass(frozen=True, slots=True)
class On:
    """The object stands on the region, and no arm holds it."""

    keyword: ClassVar[str] = "on"
    """First word of the fact in scene files."""

    object: str
    """Name of the object."""

    region: str
    """Name of the region."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the fact that the object is on the region."""
        return (EndCondition(("on", self.object, self.region), self.object),)

    def sentence(self) -> str:
        """Return the fact in words."""
        return f"{self.object} on {self.region}"
