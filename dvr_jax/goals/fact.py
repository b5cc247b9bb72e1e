"""What a fact of a goal is: a statement that shall hold at the end of a plan.

A fact says what the symbolic layer, the scene files and the pictures have to know of it. The independent check has its
own half (`dvr_jax.checker.goals`). A new fact is one frozen dataclass with these methods, whose fields are names;
`register_fact` makes it known to scene files.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Protocol, TypeVar

from dvr_jax.logic import Fact


@dataclass(frozen=True, slots=True)
class EndCondition:
    """A symbolic fact about one object that has to hold, or must not hold, at the end of a plan."""

    fact: Fact
    """Predicate and arguments, as in `("on", "yellow", "plate")`."""

    item: str
    """The object that the fact is about."""

    holds: bool = True
    """Whether the fact has to hold; otherwise it must not hold."""

    @property
    def opposite(self) -> EndCondition:
        """The condition that excludes this one."""
        return EndCondition(self.fact, self.item, not self.holds)


@dataclass(frozen=True, slots=True)
class GoalWorld:
    """The names in a scene, and which of its objects touch which regions at the start."""

    arms: tuple[str, ...]
    """Names of the arms."""

    objects: tuple[str, ...]
    """Names of the objects."""

    regions: tuple[str, ...]
    """Names of the regions."""

    inside: frozenset[tuple[str, str]] = frozenset()
    """Pairs (object, region or other object) of which the object is on the other at the start."""

    touching: frozenset[tuple[str, str]] = frozenset()
    """Pairs (object, region) of which the object covers a part of the region at the start."""


class GoalFact(Protocol):
    """A statement that shall hold at the end of a plan.

    Its dataclass fields are texts. A field called `object`, `arm` or `region` holds the name of one, and a field called
    `support` that of a region or an object; validation refuses other names there.
    """

    keyword: ClassVar[str]
    """The first word of the fact in scene files, as in `["on", "yellow", "plate"]`; the fields follow it."""

    def conditions(self, world: GoalWorld) -> tuple[EndCondition, ...]:
        """Return the symbolic facts that have to hold, or must not hold, at the end.

        Args:
            world: Names in the scene.
        """
        ...

    def sentence(self) -> str:
        """Return the fact in words, for pictures and messages."""
        ...


_FACTS: dict[str, type] = {}

FactType = TypeVar("FactType", bound=type)


def register_fact(fact_type: FactType) -> FactType:
    """Make a type of facts known to scene files under its keyword; usable as a decorator."""
    keyword: str = getattr(fact_type, "keyword")  # noqa: B009
    _FACTS[keyword] = fact_type
    return fact_type


def known_facts() -> dict[str, tuple[str, ...]]:
    """Return the names of the fields of each registered type of facts, by its keyword."""
    return {keyword: field_names(kind) for keyword, kind in _FACTS.items()}


def make_fact(keyword: str, arguments: tuple[str, ...]) -> GoalFact:
    """Make a fact of a registered type.

    Args:
        keyword: Keyword of the type, one of `known_facts`.
        arguments: One text for each field of the type.
    """
    fact: GoalFact = _FACTS[keyword](*arguments)
    return fact


def field_names(fact: Any) -> tuple[str, ...]:
    """Return the names of the fields of a fact or of a type of facts."""
    return tuple(field.name for field in fields(fact))


def words_of(fact: Any) -> tuple[str, ...]:
    """Return a fact as it stands in a scene file: its keyword and its fields."""
    return (fact.keyword, *(str(getattr(fact, name)) for name in field_names(fact)))
