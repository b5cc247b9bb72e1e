"""A PDDL domain as plain records: read with the `pddl` library, checked, and reduced to lists of literals.

Only this file sees the library. What is kept of PDDL: types with `either` and a hierarchy, constants, and operators
whose precondition and effect are conjunctions of facts and negated facts, each perhaps under `forall`; preconditions
may compare terms with `=`. Such operators ground to bit masks. Everything else (`or`, `imply`, `exists`, `when`,
`oneof`, numbers, derived predicates) is refused by name. The library does not notice undeclared predicates, wrong
numbers of arguments or undeclared variables, so these are checked here.
"""

import functools
import hashlib
import importlib.resources
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lark.exceptions import LarkError
from pddl.exceptions import PDDLError  # type: ignore[import-untyped]
from pddl.logic import base, effects, predicates  # type: ignore[import-untyped]
from pddl.parser.domain import DomainParser  # type: ignore[import-untyped]

from dvr_jax.logic.errors import LogicError, listed

EQUALITY = "="
ROOT_TYPE = "object"

_NOT_SUPPORTED: tuple[tuple[type, str], ...] = (
    (effects.When, "`when` (conditional effect)"),
    (base.OneOf, "`oneof` (non-deterministic effect)"),
    (base.Or, "`or`"),
    (base.Imply, "`imply`"),
    (base.ExistsCondition, "`exists`"),
    (base.Not, "`not` of anything but a fact"),
    (predicates.EqualTo, "`=` in an effect"),
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A typed variable of an operator, of a `forall` or of a predicate's declaration."""

    name: str
    """With its question mark, as in `?arm`; no constant can have that name."""
    types: frozenset[str]
    """The entity must be of one of these types, or of a type below one of them; empty: any entity."""


@dataclass(frozen=True, slots=True)
class Literal:
    """A fact or a negated fact, for all values of the quantified variables."""

    predicate: str
    """Name of the predicate, or `EQUALITY`."""
    terms: tuple[str, ...]
    """Variables (with question mark) and constants."""
    positive: bool
    quantified: tuple[Parameter, ...]
    """Variables of the enclosing `forall`s, outermost first: an inner one hides an outer one of the same name."""


@dataclass(frozen=True, slots=True)
class Operator:
    """An action schema: conjunctions of literals over its parameters."""

    name: str
    parameters: tuple[Parameter, ...]
    precondition: tuple[Literal, ...]
    effect: tuple[Literal, ...]
    """Negative literals are deleted first, positive ones added afterwards."""


@dataclass(frozen=True, slots=True)
class SymbolicDomain:
    """What a PDDL domain file declares, sorted by name, and in lower case because PDDL ignores case."""

    name: str
    types: tuple[tuple[str, str], ...]
    """(type, the type above it)."""
    constants: tuple[tuple[str, str], ...]
    """(constant, its type)."""
    predicates: tuple[tuple[str, tuple[Parameter, ...]], ...]
    operators: tuple[Operator, ...]

    def is_of_type(self, type_name: str, allowed: frozenset[str]) -> bool:
        """Whether the type is one of the allowed ones or lies below one of them; an empty set allows all."""
        above = dict(self.types)
        while type_name not in allowed and type_name in above:
            type_name = above[type_name]
        return not allowed or type_name in allowed or ROOT_TYPE in allowed


def read_domain(path: Path | None = None) -> SymbolicDomain:
    """The domain of a PDDL file; without a path, the package's own `domain.pddl`. A text is parsed once per process."""
    if path is not None:
        return parse_domain(path.read_text(encoding="utf-8"), str(path))
    return parse_domain(_packaged(), "domain.pddl")


def domain_signature(text: str | None = None) -> str:
    """What a domain means, in 16 hexadecimal digits: a hash of its text (by default the package's own `domain.pddl`)
    without comments, case and spacing. Labels and networks made under another one speak of other actions."""
    text = re.sub(r";.*", "", _packaged() if text is None else text).lower()
    return hashlib.sha256(" ".join(re.findall(r"[()]|[^\s()]+", text)).encode()).hexdigest()[:16]


def _packaged() -> str:
    return importlib.resources.files("dvr_jax.logic").joinpath("domain.pddl").read_text(encoding="utf-8")


@functools.cache
def parse_domain(text: str, source: str = "the domain") -> SymbolicDomain:
    """The domain written in a PDDL text; `source` is what error messages call it."""
    # Checked before parsing: with a type hierarchy, the library can loop forever over a derived predicate.
    if re.search(r"\(\s*:derived\b", re.sub(r";.*", "", text), re.IGNORECASE):
        raise LogicError(f"{source}: derived predicates (`:derived`) are not supported.")
    parsed = _parse_with_library(text, source)
    if parsed.functions:
        raise LogicError(f"{source}: numeric fluents (`:functions`) are not supported.")
    constants = sorted((_lower(constant), str(constant.type_tag or ROOT_TYPE).lower()) for constant in parsed.constants)
    declared = SymbolicDomain(
        name=str(parsed.name),
        types=tuple(sorted((_lower(child), _lower(parent or ROOT_TYPE)) for child, parent in parsed.types.items())),
        constants=tuple(constants),
        predicates=tuple(sorted((_lower(p.name), tuple(map(_parameter, p.terms))) for p in parsed.predicates)),
        operators=tuple(sorted((_operator(action, source) for action in parsed.actions), key=lambda o: o.name)),
    )
    _check(declared, source)
    return declared


def _parse_with_library(text: str, source: str) -> Any:
    """The library's own domain object; all that it raises becomes one sentence."""
    had_limit, limit = hasattr(sys, "tracebacklimit"), getattr(sys, "tracebacklimit", None)
    try:
        return DomainParser()(text)
    except (PDDLError, LarkError, ValueError, AssertionError) as error:
        reason = " ".join(str(error).split())
        raise LogicError(f"{source} is not a PDDL domain that can be read: {reason}") from error
    finally:
        # The library leaves tracebacklimit at 0 after a syntax error, which would hide every later traceback.
        if had_limit:
            sys.tracebacklimit = limit
        elif hasattr(sys, "tracebacklimit"):
            del sys.tracebacklimit


def _lower(name: object) -> str:
    return str(name).lower()


def _parameter(variable: Any) -> Parameter:
    return Parameter("?" + _lower(variable.name), frozenset(map(_lower, variable.type_tags)))


def _operator(action: Any, source: str) -> Operator:
    where = f"{source}, operator '{action.name}'"
    return Operator(
        name=_lower(action.name),
        parameters=tuple(map(_parameter, action.parameters)),
        precondition=tuple(_conjunction(action.precondition, where, is_effect=False)),
        effect=tuple(_conjunction(action.effect, where, is_effect=True)),
    )


def _conjunction(formula: Any, where: str, is_effect: bool) -> Iterator[Literal]:
    """The literals of an operator's precondition or effect, which may be missing or `()`."""
    empty = formula is None or (isinstance(formula, base.Or) and not formula.operands)  # the library reads () as (or)
    if not empty:
        yield from _literals(formula, (), where, is_effect)


def _literals(formula: Any, quantified: tuple[Parameter, ...], where: str, is_effect: bool) -> Iterator[Literal]:
    if isinstance(formula, base.And):
        for operand in formula.operands:
            yield from _literals(operand, quantified, where, is_effect)
        return
    if isinstance(formula, effects.Forall | base.ForallCondition):
        # The library keeps these variables in a set; their order means nothing, but ours must not vary between runs.
        inner = tuple(sorted(map(_parameter, formula.variables), key=lambda variable: variable.name))
        body = formula.effect if isinstance(formula, effects.Forall) else formula.condition
        yield from _literals(body, quantified + inner, where, is_effect)
        return
    positive = not isinstance(formula, base.Not)
    fact = formula if positive else formula.argument
    if isinstance(fact, predicates.Predicate):
        yield Literal(_lower(fact.name), tuple(_lower(term) for term in fact.terms), positive, quantified)
    elif isinstance(fact, predicates.EqualTo) and not is_effect:
        yield Literal(EQUALITY, (_lower(fact.left), _lower(fact.right)), positive, quantified)
    else:
        raise LogicError(
            f"{where}: {_construct(formula)} is not supported, in {formula}. "
            "Supported: `and`, `not` of a fact, `forall`, and `=` in preconditions."
        )


def _construct(formula: Any) -> str:
    for kind, words in _NOT_SUPPORTED:
        if isinstance(formula, kind):
            return words
    return f"a numeric expression ({type(formula).__name__})"


def _check(domain: SymbolicDomain, source: str) -> None:
    """Each operator has its own name and uses declared predicates, variables and fitting types."""
    names = [operator.name for operator in domain.operators]
    for name in names:
        if names.count(name) > 1:
            raise LogicError(f"{source}: two operators are named '{name}'.")
    declared = dict(domain.predicates)
    for operator in domain.operators:
        for literal in operator.precondition + operator.effect:
            where = f"{source}, operator '{operator.name}', ({' '.join((literal.predicate, *literal.terms))})"
            scope = {name: frozenset((type_name,)) for name, type_name in domain.constants}
            scope |= {variable.name: variable.types for variable in operator.parameters + literal.quantified}
            for term in literal.terms:
                if term not in scope:
                    raise LogicError(f"{where}: '{term}' is not declared; known here: {listed(scope)}.")
            if literal.predicate == EQUALITY:
                continue
            if literal.predicate not in declared:
                raise LogicError(f"{where}: no such predicate; declared: {listed(declared)}.")
            places = declared[literal.predicate]
            if len(places) != len(literal.terms):
                raise LogicError(f"{where}: '{literal.predicate}' takes {len(places)} terms.")
            for term, place in zip(literal.terms, places, strict=True):
                for type_name in scope[term] or (ROOT_TYPE,):
                    if not domain.is_of_type(type_name, place.types):
                        wanted = listed(sorted(place.types))
                        raise LogicError(f"{where}: '{term}' is of type {type_name}, wanted here: {wanted}.")
