"""The stacks of a plan, as its actions build them up and take them down, and the actions that they exclude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from dvr_jax.checker.operators.parameter import Arguments
from dvr_jax.scene.types import Scene


@dataclass(frozen=True, slots=True)
class Stacks:
    """Which object stands on which other one, between two actions."""

    objects: frozenset[str]
    """Names of all objects that may be supports; "table" is not among them, because it always means the table."""

    lower_of: Mapping[str, str]
    """Name of the object on which an object stands, by the name of the upper one."""

    @classmethod
    def at_start(cls, scene: Scene) -> Self:
        """Return the stacks with which a scene begins."""
        objects = frozenset(scene.object_names) - set(scene.supports())
        return cls(
            objects,
            {item.name: item.support for item in scene.objects if item.support in objects},
        )

    def refusal(self, arguments: Arguments, holding: Mapping[str, str]) -> str:
        """Return why an action is impossible because of the stacks, in one sentence; "" if it is not.

        Args:
            arguments: Arguments of the action.
            holding: Name of the object that each arm holds.
        """
        name = arguments["object"]
        for upper, lower in self.lower_of.items():
            if lower == name:
                return f"{upper} stands on {name}, so {name} cannot be moved."

        support = arguments.get("support", "")
        if support not in self.objects:
            return ""
        if support == name:
            return f"{name} cannot stand on itself."
        if support in holding.values():
            return f"an arm holds {support}, so nothing can be placed on it."
        for upper, lower in self.lower_of.items():
            if lower == support:
                return f"{upper} stands on {support} already, so {name} has no room there."
        return ""

    def after(self, arguments: Arguments) -> Stacks:
        """Return the stacks after an action with these arguments."""
        left = {
            upper: lower for upper, lower in self.lower_of.items() if upper != arguments["object"]
        }
        if arguments.get("support", "") in self.objects:
            left[arguments["object"]] = arguments["support"]
        return Stacks(self.objects, left)
