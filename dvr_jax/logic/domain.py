"""The records of a PDDL domain, and the composition of the domain from a header and the texts of the operators.

What is kept of PDDL: types with `either` and a hierarchy, constants, and action schemas. The precondition and the
effect of an action schema are conjunctions of facts and negated facts, each perhaps under `forall`. A precondition may
also compare terms with `=`. Such action schemas ground to bit masks.

`dvr_jax.logic.parsing` reads these records from a text.
"""

import hashlib
import importlib.resources
import re
from collections.abc import Sequence
from dataclasses import dataclass

from dvr_jax.logic.errors import LogicError

EQUALITY = "="
"""The predicate of a literal that compares two terms."""

ROOT_TYPE = "object"
"""The type above all others in PDDL."""

SHIPPED_ACTIONS = ("grasp", "place")
"""Files `NAME.pddl` of this package, in the order in which they enter the domain and its signature."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A typed variable of an action schema, of a `forall` or of the declaration of a predicate."""

    name: str
    """The name with its question mark, as in `?arm`; no constant can have that name."""

    types: frozenset[str]
    """The entity must be of one of these types or of a type below one of them; an empty set allows any entity."""


@dataclass(frozen=True, slots=True)
class Literal:
    """A fact or a negated fact, for all values of the quantified variables."""

    predicate: str
    """The name of the predicate, or `EQUALITY`."""

    terms: tuple[str, ...]
    """Variables (with question mark) and constants."""

    positive: bool
    """Whether the fact is not negated."""

    quantified: tuple[Parameter, ...]
    """Variables of the enclosing `forall`s, outermost first: an inner one hides an outer one of the same name."""

    def __str__(self) -> str:
        return f"({' '.join((self.predicate, *self.terms))})"


@dataclass(frozen=True, slots=True)
class ActionSchema:
    """A PDDL action: conjunctions of literals over its parameters."""

    name: str
    """The name of the operator."""

    parameters: tuple[Parameter, ...]
    """The variables in the order of the arguments of a ground action."""

    precondition: tuple[Literal, ...]
    """All of these must hold before the action."""

    effect: tuple[Literal, ...]
    """Negative literals are deleted first, positive ones are added afterwards."""


@dataclass(frozen=True, slots=True)
class TypedName:
    """A type with the type above it, or a constant with its type."""

    name: str
    """The type or constant that is declared."""

    type: str
    """The type above it or of it."""


@dataclass(frozen=True, slots=True)
class PredicateDeclaration:
    """A predicate with the types of its arguments."""

    name: str
    """The predicate."""

    parameters: tuple[Parameter, ...]
    """One for each argument."""


@dataclass(frozen=True, slots=True)
class SymbolicDomain:
    """The declarations of a PDDL domain, sorted by name, and in lower case because PDDL ignores case."""

    name: str
    """The name that the text gives to the domain."""

    types: tuple[TypedName, ...]
    """Each type with the type above it."""

    constants: tuple[TypedName, ...]
    """Each constant with its type."""

    predicates: tuple[PredicateDeclaration, ...]
    """The predicates with the types of their arguments."""

    actions: tuple[ActionSchema, ...]
    """One for each operator."""

    def is_of_type(self, type_name: str, allowed: frozenset[str]) -> bool:
        """Return whether a type is one of the allowed ones or lies below one of them.

        Args:
            type_name: the type in question.
            allowed: the types wanted; an empty set allows all.

        Returns:
            True if the type is allowed.
        """
        if not allowed or ROOT_TYPE in allowed:
            return True

        type_above = {declared.name: declared.type for declared in self.types}
        while type_name not in allowed and type_name in type_above:
            type_name = type_above[type_name]
        return type_name in allowed


def compose_domain(header: str, actions: Sequence[str]) -> str:
    """Insert the texts of actions into the header of a domain.

    Comments are left out, so that a parenthesis in a comment cannot be mistaken for the end of the header.

    Args:
        header: a whole PDDL domain `(define (domain ...) ...)` that declares types, constants and predicates.
        actions: PDDL texts `(:action ...)`; they go before the last closing parenthesis of the header.

    Returns:
        The PDDL text of the domain with these actions.

    Raises:
        LogicError: the header has no closing parenthesis.
    """
    before, parenthesis, after = _without_comments(header).rpartition(")")
    if not parenthesis:
        raise LogicError(
            "the header of the domain has no closing parenthesis; valid is a text '(define (domain NAME) ...)'."
        )

    lines = [before.rstrip()]
    for action in actions:
        lines.append(_without_comments(action).rstrip())
    lines.append(parenthesis + after)
    return "\n".join(lines)


def shipped_header() -> str:
    """Return the package's own header: the types, constants and predicates of two-arm rearrangement."""
    return _packaged_text("domain.pddl")


def shipped_action(name: str) -> str:
    """Return the PDDL text of one of the package's own actions."""
    return _packaged_text(f"{name}.pddl")


def shipped_actions() -> tuple[str, ...]:
    """Return the PDDL texts of the package's own operators."""
    return tuple(_packaged_text(f"{name}.pddl") for name in SHIPPED_ACTIONS)


def shipped_domain() -> str:
    """Return the package's own domain: its header with the texts of its own operators."""
    return compose_domain(shipped_header(), shipped_actions())


def domain_signature(text: str | None = None) -> str:
    """Return a hash of the meaning of a domain, as 16 hexadecimal digits.

    The hash ignores comments, case and spacing. Labels and networks that were made under a domain with another
    signature speak of other actions.

    Args:
        text: the PDDL text of a whole domain; by default the package's own.

    Returns:
        The first 16 digits of the SHA-256 hash of the tokens of the text.
    """
    if text is None:
        text = shipped_domain()

    tokens = re.findall(r"[()]|[^\s()]+", _without_comments(text).lower())
    return hashlib.sha256(" ".join(tokens).encode()).hexdigest()[:16]


def _without_comments(text: str) -> str:
    """Remove PDDL comments, which reach from a semicolon to the end of the line."""
    return re.sub(r";.*", "", text)


def _packaged_text(file_name: str) -> str:
    return (
        importlib.resources.files("dvr_jax.logic").joinpath(file_name).read_text(encoding="utf-8")
    )
