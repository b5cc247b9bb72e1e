"""Ground actions and facts by the names that the user gave, and the masks by which an action changes a state."""

import re
from dataclasses import dataclass
from typing import Self

from dvr_jax.logic.errors import LogicError

Fact = tuple[str, ...]
"""Predicate and arguments, as in `("holding", "left", "yellow")`."""


@dataclass(frozen=True, order=True, slots=True)
class Action:
    """A ground action, as in `Action("grasp", ("left", "+x", "yellow"))`."""

    operator: str
    """The name of the operator."""

    arguments: tuple[str, ...]
    """One name for each parameter of the operator."""

    def __str__(self) -> str:
        return f"{self.operator}({', '.join(self.arguments)})"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read the text that `str` wrote, as in "grasp(left, +x, yellow)".

        Args:
            text: operator and arguments; spaces around them are ignored.

        Returns:
            The action.

        Raises:
            LogicError: the text is not of this form.
        """
        match = re.fullmatch(r"\s*([^\s(),]+)\s*\(([^()]*)\)\s*", text)
        if match is None:
            raise LogicError(
                f"'{text}' is no action; valid is for instance 'grasp(left, +x, yellow)'."
            )

        operator, arguments = match.groups()
        return cls(operator, tuple(argument.strip() for argument in arguments.split(",")))


@dataclass(frozen=True, slots=True)
class Masks:
    """The condition and the effect of a ground action, as bits over `Grounding.facts`.

    The action applies in a state s if `s & required == required` and `s & forbidden == 0`. It leads to the state
    `s & ~deleted | added`.
    """

    required: int
    """Facts that must hold."""

    forbidden: int
    """Facts that must not hold."""

    deleted: int
    """Facts that do not hold afterwards, unless they are added."""

    added: int
    """Facts that hold afterwards."""

    def allow(self, state: int) -> bool:
        """Return whether the action applies in this state."""
        return state & self.required == self.required and not state & self.forbidden

    def apply(self, state: int) -> int:
        """Return the state after the action; whether the action applies is not checked."""
        return state & ~self.deleted | self.added


def text_of_fact(fact: Fact) -> str:
    """Write a fact as messages show it, as in "holding(left, yellow)"."""
    predicate, *arguments = fact
    return f"{predicate}({', '.join(arguments)})"
