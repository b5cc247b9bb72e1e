"""The fact that an arm holds an object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dvr_jax.goals.fact import EndCondition, GoalWorld, register_fact


@register_fact
@dataclass(frozen=True, slots=True)
class Holding:
    """The gripper of the arm holds the object."""

    keyword: ClassVar[str] = "holding"
    """First word of the fact in scene files."""

    arm: str
    """Name of the arm."""

    object: str
    """Name of the object."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the fact that the arm holds the object."""
        return (EndCondition(("holding", self.arm, self.object), self.object),)

    def sentence(self) -> str:
        """Return the fact in words."""
        return f"{self.object} in the {self.arm} hand"
