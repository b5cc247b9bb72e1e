"""What a goal is: facts that all hold at the end of a plan."""

from __future__ import annotations

from dataclasses import dataclass

from dvr_jax.goals.fact import EndCondition, GoalFact, GoalWorld
from dvr_jax.goals.region import Region


@dataclass(frozen=True, slots=True)
class Goal:
    """A conjunction of facts; the regions that they name are those of the scene."""

    facts: tuple[GoalFact, ...]
    """The facts, at least one; their order is that of messages and pictures."""

    @property
    def regions(self) -> tuple[Region, ...]:
        """Regions that belong to the goal itself: none."""
        return ()

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the symbolic conditions of all facts, each once."""
        return tuple(
            dict.fromkeys(condition for fact in self.facts for condition in fact.conditions(world))
        )

    def sentence(self) -> str:
        """Return the goal in words."""
        return ", ".join(fact.sentence() for fact in self.facts)
