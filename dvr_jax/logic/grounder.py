"""From a domain and the entities of one scene to bit masks, for any domain that `domain.py` accepts.

Every operator is instantiated with every fitting tuple of entities, `forall` is written out, `=` is decided. A fact
that no instance's effect touches keeps its initial value for ever: it is decided as well and gets no bit.
Entities have internal names here (`o0`, `a1`, the constants' own), so that a user may call an object "table" or "left";
the user's names are put on at the very end.
"""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from dvr_jax.logic.domain import EQUALITY, Literal, Operator, Parameter, SymbolicDomain
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.logic.grounding import Action, Fact, Grounding, Masks


@dataclass(frozen=True, slots=True)
class Entity:
    """Something that operators speak about: an arm, an object, a constant of the domain."""

    name: str
    """Internal, unique."""
    type: str
    label: str
    """What the user calls it; need not be unique."""


@dataclass(frozen=True, slots=True)
class _Instance:
    """A ground operator before facts have bits."""

    operator: str
    arguments: tuple[str, ...]
    required: frozenset[Fact]
    forbidden: frozenset[Fact]
    deleted: frozenset[Fact]
    added: frozenset[Fact]


def ground_domain(
    domain: SymbolicDomain,
    entities: Sequence[Entity],
    initial: Collection[Fact],
    goal: Collection[Fact],
    constant_labels: Mapping[str, str] | None = None,
) -> Grounding:
    """Ground a domain over entities, by internal names: `initial` lists all facts that hold, `goal` those that shall.

    Constants of the domain come first in all orders, by name, then the entities as given. `constant_labels` says what
    the user calls a constant; without an entry it is called by its own name.
    """
    labels = constant_labels or {}
    everything = [Entity(name, kind, labels.get(name, name)) for name, kind in domain.constants] + list(entities)
    _check_entities(domain, everything)
    _check_facts(domain, everything, [*initial, *goal])

    instances = [instance for operator in domain.operators for instance in _instances(domain, operator, everything)]
    changing = frozenset[Fact]().union(*(i.added | i.deleted for i in instances))
    fixed_true = frozenset(initial) - changing

    order = {entity.name: position for position, entity in enumerate(everything)}
    facts = sorted(changing, key=lambda fact: (fact[0], [order[name] for name in fact[1:]]))
    bit_of = {fact: 1 << i for i, fact in enumerate(facts)}
    kept = [i for i in instances if i.required <= changing | fixed_true and not i.forbidden & fixed_true]
    for fact in goal:
        if fact not in changing and fact not in fixed_true:
            raise LogicError(f"the goal ({' '.join(fact)}) can never hold: no operator adds it.")

    def mask(of_facts: Collection[Fact]) -> int:
        return sum(bit_of[fact] for fact in of_facts if fact in bit_of)

    label_of = {entity.name: entity.label for entity in everything}
    actions = tuple(Action(i.operator, tuple(label_of[name] for name in i.arguments)) for i in kept)
    labelled_facts = tuple((fact[0], *(label_of[name] for name in fact[1:])) for fact in facts)
    _check_distinct("actions", actions)
    _check_distinct("facts", labelled_facts)
    return Grounding(
        actions=actions,
        masks=tuple(Masks(mask(i.required), mask(i.forbidden), mask(i.deleted), mask(i.added)) for i in kept),
        facts=labelled_facts,
        initial_state=mask(frozenset(initial)),
        goal=mask(frozenset(goal)),
    )


def _instances(domain: SymbolicDomain, operator: Operator, entities: Sequence[Entity]) -> Iterator[_Instance]:
    for arguments in _assignments(domain, operator.parameters, entities):
        binding = dict(zip((parameter.name for parameter in operator.parameters), arguments, strict=True))
        condition = list(_ground(domain, operator.precondition, binding, entities))
        effect = list(_ground(domain, operator.effect, binding, entities))
        if any((fact[1] == fact[2]) != positive for fact, positive in condition if fact[0] == EQUALITY):
            continue
        instance = _Instance(
            operator=operator.name,
            arguments=arguments,
            required=frozenset(fact for fact, positive in condition if positive and fact[0] != EQUALITY),
            forbidden=frozenset(fact for fact, positive in condition if not positive and fact[0] != EQUALITY),
            deleted=frozenset(fact for fact, positive in effect if not positive),
            added=frozenset(fact for fact, positive in effect if positive),
        )
        if not instance.required & instance.forbidden:
            yield instance


def _ground(
    domain: SymbolicDomain, literals: Sequence[Literal], binding: Mapping[str, str], entities: Sequence[Entity]
) -> Iterator[tuple[Fact, bool]]:
    """The facts that literals stand for, each with its sign, once the operator's parameters have values."""
    for literal in literals:
        for values in _assignments(domain, literal.quantified, entities):
            inner = dict(binding) | dict(zip((variable.name for variable in literal.quantified), values, strict=True))
            yield (literal.predicate, *(inner.get(term, term) for term in literal.terms)), literal.positive


def _assignments(
    domain: SymbolicDomain, parameters: Sequence[Parameter], entities: Sequence[Entity]
) -> Iterator[tuple[str, ...]]:
    fitting = ([e.name for e in entities if domain.is_of_type(e.type, parameter.types)] for parameter in parameters)
    return itertools.product(*fitting)


def _check_entities(domain: SymbolicDomain, entities: Sequence[Entity]) -> None:
    types = {name for pair in domain.types for name in pair}
    seen: set[str] = set()
    for entity in entities:
        if entity.name in seen:
            raise LogicError(f"the name '{entity.name}' is given twice, or the domain has a constant of that name.")
        seen.add(entity.name)
        if domain.types and entity.type not in types:
            raise LogicError(
                f"'{entity.label}' is of type '{entity.type}', which domain '{domain.name}' does not declare; "
                f"declared: {listed(sorted(types))}."
            )


def _check_facts(domain: SymbolicDomain, entities: Sequence[Entity], facts: Collection[Fact]) -> None:
    type_of = {entity.name: entity.type for entity in entities}
    declared = dict(domain.predicates)
    for predicate, *names in facts:
        text = f"({' '.join((predicate, *names))})"
        if predicate not in declared or len(declared[predicate]) != len(names):
            raise LogicError(
                f"domain '{domain.name}' declares no predicate for {text} of the initial state or goal."
            )
        for name, place in zip(names, declared[predicate], strict=True):
            if name not in type_of or not domain.is_of_type(type_of[name], place.types):
                raise LogicError(
                    f"domain '{domain.name}': '{name}' does not fit into {text} of the initial state or goal; "
                    f"valid: {listed(e.name for e in entities if domain.is_of_type(e.type, place.types))}."
                )


def _check_distinct(kind: str, named: Sequence[object]) -> None:
    """Entities may share a label, as an object "left" and the arm do, until that makes two things look alike."""
    seen: set[object] = set()
    for thing in named:
        if thing in seen:
            raise LogicError(f"two {kind} of the domain would both be called {thing}: rename one of the objects.")
        seen.add(thing)
