"""The check that a domain uses only names that it declares, with fitting types.

The `pddl` library does not notice predicates without declaration, wrong numbers of arguments or variables without
declaration, so these are checked here.
"""

from collections import Counter

from dvr_jax.logic.domain import (
    EQUALITY,
    ROOT_TYPE,
    ActionSchema,
    Literal,
    Parameter,
    SymbolicDomain,
)
from dvr_jax.logic.errors import LogicError, listed

_Scope = dict[str, frozenset[str]]
"""Types of each constant and variable that a literal may use."""


def check_declarations(domain: SymbolicDomain, source: str) -> None:
    """Check that actions have different names and use declared predicates and terms of fitting types.

    Args:
        domain: the domain to check.
        source: the name by which error messages call the domain.

    Raises:
        LogicError: a name is given twice or is not declared, or a term does not fit.
    """
    numbers = Counter(action.name for action in domain.actions)
    for name, number in numbers.items():
        if number > 1:
            raise LogicError(f"{source}: two operators are named '{name}'.")

    for action in domain.actions:
        for literal in action.precondition + action.effect:
            where = f"{source}, operator '{action.name}', {literal}"
            _check_literal(domain, literal, _scope(domain, action, literal), where)


def _scope(domain: SymbolicDomain, action: ActionSchema, literal: Literal) -> _Scope:
    """Collect the types of all terms that a literal may use; a variable hides a constant of its name."""
    scope = {constant.name: frozenset((constant.type,)) for constant in domain.constants}
    for variable in action.parameters + literal.quantified:
        scope[variable.name] = variable.types
    return scope


def _check_literal(domain: SymbolicDomain, literal: Literal, scope: _Scope, where: str) -> None:
    """Raise a LogicError unless the predicate and the terms of a literal are declared and fit."""
    for term in literal.terms:
        if term not in scope:
            raise LogicError(f"{where}: '{term}' is not declared; known here: {listed(scope)}.")

    # Terms of any type may be compared.
    if literal.predicate == EQUALITY:
        return

    declared = {predicate.name: predicate.parameters for predicate in domain.predicates}
    if literal.predicate not in declared:
        raise LogicError(f"{where}: no such predicate; declared: {listed(declared)}.")

    parameters = declared[literal.predicate]
    if len(parameters) != len(literal.terms):
        raise LogicError(f"{where}: '{literal.predicate}' takes {len(parameters)} terms.")
    for term, parameter in zip(literal.terms, parameters, strict=True):
        _check_term(domain, term, scope[term], parameter, where)


def _check_term(
    domain: SymbolicDomain,
    term: str,
    types: frozenset[str],
    parameter: Parameter,
    where: str,
) -> None:
    """Raise a LogicError unless each type that a term may have fits the parameter of a predicate."""
    for type_name in types or (ROOT_TYPE,):
        if not domain.is_of_type(type_name, parameter.types):
            wanted = listed(sorted(parameter.types))
            raise LogicError(f"{where}: '{term}' is of type {type_name}, wanted here: {wanted}.")
