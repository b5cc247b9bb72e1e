"""The fact that no arm holds anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dvr_jax.goals.fact import EndCondition, GoalWorld, register_fact


@register_fact
@dataclass(frozen=True, slots=True)
class HandsEmpty:
    """No arm holds an object."""

    keyword: ClassVar[str] = "hands_empty"
    """First word of the fact in scene files."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return that no arm holds any of the objects."""
        return tuple(
            EndCondition(("holding", arm, item), item, holds=False)
            for item in world.objects
            for arm in world.arms
        )

    def sentence(self) -> str:
        """Return the fact in words."""
        return "hands empty"
