"""What a goal is: facts that shall hold at the end, and the regions of the table that these facts speak of.

A goal is a value that says what the symbolic layer, the optimizer and the pictures have to know of it. The independent
check has its own half, in `dvr_jax.checker`. A new goal is one file with a class of this protocol.
"""

from __future__ import annotations

from typing import Protocol

from dvr_jax.geometry.footprint import Rectangle

Fact = tuple[str, ...]
"""Predicate and arguments, as in `("on", "yellow", "goal")`."""


class Goal(Protocol):
    """What shall hold at the end of a plan."""

    def facts(self) -> tuple[Fact, ...]:
        """Facts that all hold at the end; objects by their names, supports by the constants of the PDDL domain."""
        ...

    def supports(self) -> dict[str, Rectangle]:
        """Supports on the table's top, beside the table itself, by the constants of the PDDL domain."""
        ...

    def sentence(self) -> str:
        """The goal in words, for pictures and messages."""
        ...
