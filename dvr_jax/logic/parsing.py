"""PDDL texts to records: reading with the `pddl` library, and refusal of all that does not ground to bit masks.

Only this file sees the library. These constructs are refused by name: `or`, `imply`, `exists`, `when`, `oneof`,
numbers, derived predicates, `not` of anything but a fact, and `=` in an effect.
"""

import functools
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Protocol

from lark.exceptions import LarkError
from pddl.exceptions import PDDLError  # type: ignore[import-untyped]
from pddl.logic import base, effects, predicates  # type: ignore[import-untyped]
from pddl.parser.domain import DomainParser  # type: ignore[import-untyped]

from dvr_jax.logic.declarations import check_declarations
from dvr_jax.logic.domain import (
    EQUALITY,
    ROOT_TYPE,
    ActionSchema,
    Literal,
    Parameter,
    PredicateDeclaration,
    SymbolicDomain,
    TypedName,
    compose_domain,
    shipped_actions,
    shipped_header,
)
from dvr_jax.logic.errors import LogicError

_NOT_SUPPORTED: tuple[tuple[type, str], ...] = (
    (effects.When, "`when` (conditional effect)"),
    (base.OneOf, "`oneof` (non-deterministic effect)"),
    (base.Or, "`or`"),
    (base.Imply, "`imply`"),
    (base.ExistsCondition, "`exists`"),
    (base.Not, "`not` of anything but a fact"),
    (predicates.EqualTo, "`=` in an effect"),
)
"""Classes of the library, and the words by which messages call them."""


class _Variable(Protocol):
    """A variable of the library, which has no types of its own."""

    name: str
    type_tags: Iterable[str]


class _Constant(Protocol):
    """A constant of the library; `str` gives its name."""

    type_tag: str | None


class _Predicate(Protocol):
    """A declared predicate of the library."""

    name: str
    terms: Sequence[_Variable]


class _Action(Protocol):
    """An action of the library."""

    name: str
    parameters: Sequence[_Variable]
    precondition: object
    effect: object


class _Domain(Protocol):
    """A domain of the library."""

    name: str
    types: Mapping[str, str | None]
    constants: Iterable[_Constant]
    predicates: Iterable[_Predicate]
    actions: Iterable[_Action]
    functions: Mapping[object, object]


def read_domain(action_texts: Sequence[str] | None = None) -> SymbolicDomain:
    """Read the package's own header with actions; the same texts are parsed once per process.

    Args:
        action_texts: PDDL texts `(:action ...)`; by default those of the package's own operators.

    Returns:
        The domain.

    Raises:
        LogicError: a text is not PDDL, uses a construct that is not supported, or uses a name without declaration.
    """
    texts = shipped_actions() if action_texts is None else tuple(action_texts)
    return parse_domain(compose_domain(shipped_header(), texts))


@functools.cache
def parse_domain(text: str, source: str = "the domain") -> SymbolicDomain:
    """Read the domain written in a PDDL text.

    Args:
        text: a whole PDDL domain with its actions.
        source: the name by which error messages call the text.

    Returns:
        The domain.

    Raises:
        LogicError: the text is not PDDL, uses a construct that is not supported, or uses a name without declaration.
    """
    # Checked before parsing: with a type hierarchy, the library can loop forever over a derived predicate.
    if re.search(r"\(\s*:derived\b", re.sub(r";.*", "", text), re.IGNORECASE):
        raise LogicError(f"{source}: derived predicates (`:derived`) are not supported.")

    parsed = _parse_with_library(text, source)
    if parsed.functions:
        raise LogicError(f"{source}: numeric fluents (`:functions`) are not supported.")

    # The library keeps declarations in sets: sorting makes the order the same in every run.
    types = [
        TypedName(_lower(child), _lower(parent or ROOT_TYPE))
        for child, parent in parsed.types.items()
    ]
    constants = [
        TypedName(_lower(constant), _lower(constant.type_tag or ROOT_TYPE))
        for constant in parsed.constants
    ]
    declarations = [
        PredicateDeclaration(_lower(predicate.name), tuple(map(_parameter, predicate.terms)))
        for predicate in parsed.predicates
    ]
    actions = [_action_schema(action, source) for action in parsed.actions]
    domain = SymbolicDomain(
        name=str(parsed.name),
        types=tuple(sorted(types, key=lambda declared: declared.name)),
        constants=tuple(sorted(constants, key=lambda declared: declared.name)),
        predicates=tuple(sorted(declarations, key=lambda declared: declared.name)),
        actions=tuple(sorted(actions, key=lambda action: action.name)),
    )
    check_declarations(domain, source)
    return domain


def _parse_with_library(text: str, source: str) -> _Domain:
    """Call the library's parser; every error that it raises becomes one sentence."""
    try:
        with _kept_traceback_limit():
            domain: _Domain = DomainParser()(text)
    except (PDDLError, LarkError, ValueError, AssertionError) as error:
        reason = " ".join(str(error).split())
        raise LogicError(f"{source} is not a PDDL domain that can be read: {reason}") from error
    return domain


@contextmanager
def _kept_traceback_limit() -> Iterator[None]:
    """Restore `sys.tracebacklimit` on exit.

    The library leaves the limit at 0 after a syntax error, which would hide every later traceback.
    """
    had_limit = hasattr(sys, "tracebacklimit")
    limit = getattr(sys, "tracebacklimit", None)
    try:
        yield
    finally:
        if had_limit:
            sys.tracebacklimit = limit
        elif hasattr(sys, "tracebacklimit"):
            del sys.tracebacklimit


def _lower(name: object) -> str:
    return str(name).lower()


def _parameter(variable: _Variable) -> Parameter:
    types = frozenset(map(_lower, variable.type_tags))
    return Parameter("?" + _lower(variable.name), types)


def _action_schema(action: _Action, source: str) -> ActionSchema:
    where = f"{source}, operator '{action.name}'"
    return ActionSchema(
        name=_lower(action.name),
        parameters=tuple(map(_parameter, action.parameters)),
        precondition=tuple(_conjunction(action.precondition, where, is_effect=False)),
        effect=tuple(_conjunction(action.effect, where, is_effect=True)),
    )


def _conjunction(formula: object, where: str, is_effect: bool) -> Iterator[Literal]:
    """Yield the literals of the precondition or effect of an action, which may be missing or `()`."""
    # The library reads `()` as `(or)`.
    is_empty = formula is None or (isinstance(formula, base.Or) and not formula.operands)
    if not is_empty:
        yield from _literals(formula, (), where, is_effect)


def _literals(
    formula: object,
    quantified: tuple[Parameter, ...],
    where: str,
    is_effect: bool,
) -> Iterator[Literal]:
    """Yield the literals of a formula below the quantified variables of the enclosing `forall`s."""
    if isinstance(formula, base.And):
        for operand in formula.operands:
            yield from _literals(operand, quantified, where, is_effect)
        return

    if isinstance(formula, effects.Forall | base.ForallCondition):
        # The library keeps these variables in a set. Their order has no meaning, but must not vary between runs.
        inner = sorted(map(_parameter, formula.variables), key=lambda variable: variable.name)
        body = formula.effect if isinstance(formula, effects.Forall) else formula.condition
        yield from _literals(body, (*quantified, *inner), where, is_effect)
        return

    is_negated = isinstance(formula, base.Not)
    fact = formula.argument if isinstance(formula, base.Not) else formula
    if isinstance(fact, predicates.Predicate):
        terms = tuple(_lower(term) for term in fact.terms)
        yield Literal(_lower(fact.name), terms, not is_negated, quantified)
    elif isinstance(fact, predicates.EqualTo) and not is_effect:
        terms = (_lower(fact.left), _lower(fact.right))
        yield Literal(EQUALITY, terms, not is_negated, quantified)
    else:
        raise LogicError(
            f"{where}: {_name_of_construct(formula)} is not supported, in {formula}. "
            "Supported: `and`, `not` of a fact, `forall`, and `=` in preconditions."
        )


def _name_of_construct(formula: object) -> str:
    for kind, words in _NOT_SUPPORTED:
        if isinstance(formula, kind):
            return words
    return f"a numeric expression ({type(formula).__name__})"
