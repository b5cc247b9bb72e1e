"""The fact that an object is on a region, or on another object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dvr_jax.goals.fact import EndCondition, GoalWorld, register_fact


@register_fact
@dataclass(frozen=True, slots=True)
class On:
    """The object stands on the region or on the other object, and no arm holds it."""

    keyword: ClassVar[str] = "on"
    """First word of the fact in scene files."""

    object: str
    """Name of the object."""

    support: str
    """Name of the region, or of the other object."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the fact that the object is on its support."""
        return (EndCondition(("on", self.object, self.support), self.object),)

    def sentence(self) -> str:
        """Return the fact in words."""
        return f"{self.object} on {self.support}"
