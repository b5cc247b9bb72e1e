"""Grounding: from a domain and the entities of one scene to ground actions with bit masks.

Every action schema is instantiated with every fitting tuple of entities, `forall` is written out, and `=` is decided.
A fact that the effect of no instance touches keeps its initial value forever: it is decided as well and gets no bit.

Entities have internal names here (`o0`, `a1`, and the names of constants), so that a user may call an object "table" or
"left". The names of the user are put on at the very end.
"""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from dvr_jax.logic.actions import Action, Fact, Masks
from dvr_jax.logic.domain import EQUALITY, ActionSchema, Literal, Parameter, SymbolicDomain
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.logic.grounding import Grounding


@dataclass(frozen=True, slots=True)
class Entity:
    """A thing that actions speak about: an arm, an object or a constant of the domain."""

    name: str
    """The internal name, which is unique."""

    type: str
    """The type by which it fits the parameters of actions and predicates."""

    label: str
    """The name that the user gave, which need not be unique."""


@dataclass(frozen=True, slots=True)
class _SignedFact:
    """A fact that shall hold or be added, or one that shall not hold or be deleted."""

    fact: Fact
    positive: bool


@dataclass(frozen=True, slots=True)
class _Instance:
    """A ground action before facts have bits."""

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
    forbidden: Collection[Fact] = (),
) -> Grounding:
    """Ground a domain over entities.

    Constants of the domain come first in all orders, by name, then the entities as given.

    Args:
        domain: the declarations and action schemas.
        entities: what the scene adds to the constants of the domain.
        initial: all facts that hold at the start, by internal names.
        goal: the facts that shall hold at the end, by internal names.
        constant_labels: the name that the user gives to a constant; any other constant keeps its own name.
        forbidden: the facts that shall not hold at the end, by internal names.

    Returns:
        The ground actions with their masks, the initial state and the goal.

    Raises:
        LogicError: entities, facts or the goal do not fit the domain, or two actions or facts would have one name.
    """
    labels = constant_labels or {}
    constants = [
        Entity(constant.name, constant.type, labels.get(constant.name, constant.name))
        for constant in domain.constants
    ]
    everything = [*constants, *entities]
    _check_entities(domain, everything)
    _check_facts(domain, everything, [*initial, *goal, *forbidden])

    # A fact that no effect touches is decided by the initial state.
    instances = [
        instance for action in domain.actions for instance in _instances(domain, action, everything)
    ]
    changing: set[Fact] = set()
    for instance in instances:
        changing |= instance.added | instance.deleted
    fixed_true = frozenset(initial) - changing
    for fact in goal:
        if fact not in changing and fact not in fixed_true:
            raise LogicError(f"the goal ({' '.join(fact)}) can never hold: no operator adds it.")
    for fact in forbidden:
        if fact in fixed_true:
            raise LogicError(f"({' '.join(fact)}) always holds: no operator deletes it.")

    applicable_somewhere = [
        instance
        for instance in instances
        if instance.required <= changing | fixed_true and not instance.forbidden & fixed_true
    ]
    return _assemble(everything, changing, applicable_somewhere, initial, goal, forbidden)


def _assemble(
    entities: Sequence[Entity],
    changing: Collection[Fact],
    instances: Sequence[_Instance],
    initial: Collection[Fact],
    goal: Collection[Fact],
    forbidden: Collection[Fact],
) -> Grounding:
    """Give a bit to each fact that can change, and the names of the user to actions and facts."""
    position = {entity.name: index for index, entity in enumerate(entities)}
    facts = sorted(changing, key=lambda fact: (fact[0], [position[name] for name in fact[1:]]))
    bit_of = {fact: 1 << index for index, fact in enumerate(facts)}

    # Fixed facts have no bit, and need none: instances that contradict them are gone.
    def mask(of_facts: Collection[Fact]) -> int:
        return sum(bit_of.get(fact, 0) for fact in set(of_facts))

    masks = [
        Masks(
            required=mask(instance.required),
            forbidden=mask(instance.forbidden),
            deleted=mask(instance.deleted),
            added=mask(instance.added),
        )
        for instance in instances
    ]

    label_of = {entity.name: entity.label for entity in entities}
    actions = [
        Action(instance.operator, tuple(label_of[name] for name in instance.arguments))
        for instance in instances
    ]
    labeled_facts = [(fact[0], *(label_of[name] for name in fact[1:])) for fact in facts]
    _check_distinct("actions", actions)
    _check_distinct("facts", labeled_facts)

    return Grounding(
        actions=tuple(actions),
        masks=tuple(masks),
        facts=tuple(labeled_facts),
        initial_state=mask(initial),
        goal=mask(goal),
        goal_forbidden=mask(forbidden),
    )


def _instances(
    domain: SymbolicDomain,
    action: ActionSchema,
    entities: Sequence[Entity],
) -> Iterator[_Instance]:
    """Yield the ground actions of a schema, without those whose precondition contradicts itself."""
    names = [parameter.name for parameter in action.parameters]
    for arguments in _assignments(domain, action.parameters, entities):
        binding = dict(zip(names, arguments, strict=True))
        condition = list(_ground_literals(domain, action.precondition, binding, entities))
        effect = list(_ground_literals(domain, action.effect, binding, entities))

        # Comparisons are decided here, so that only facts remain.
        comparisons = [signed for signed in condition if signed.fact[0] == EQUALITY]
        facts = [signed for signed in condition if signed.fact[0] != EQUALITY]
        if not all(map(_comparison_holds, comparisons)):
            continue

        instance = _Instance(
            operator=action.name,
            arguments=arguments,
            required=_facts_of_sign(facts, True),
            forbidden=_facts_of_sign(facts, False),
            deleted=_facts_of_sign(effect, False),
            added=_facts_of_sign(effect, True),
        )
        if not instance.required & instance.forbidden:
            yield instance


def _comparison_holds(comparison: _SignedFact) -> bool:
    _, left, right = comparison.fact
    return (left == right) == comparison.positive


def _facts_of_sign(signed_facts: Sequence[_SignedFact], positive: bool) -> frozenset[Fact]:
    return frozenset(signed.fact for signed in signed_facts if signed.positive == positive)


def _ground_literals(
    domain: SymbolicDomain,
    literals: Sequence[Literal],
    binding: Mapping[str, str],
    entities: Sequence[Entity],
) -> Iterator[_SignedFact]:
    """Yield the facts that literals stand for, once the parameters of the action have values."""
    for literal in literals:
        names = [variable.name for variable in literal.quantified]
        for values in _assignments(domain, literal.quantified, entities):
            inner = {**binding, **dict(zip(names, values, strict=True))}
            terms = [inner.get(term, term) for term in literal.terms]
            yield _SignedFact((literal.predicate, *terms), literal.positive)


def _assignments(
    domain: SymbolicDomain,
    parameters: Sequence[Parameter],
    entities: Sequence[Entity],
) -> Iterator[tuple[str, ...]]:
    """Yield all tuples of internal names whose types fit the parameters."""
    fitting = [
        [entity.name for entity in entities if domain.is_of_type(entity.type, parameter.types)]
        for parameter in parameters
    ]
    return itertools.product(*fitting)


def _check_entities(domain: SymbolicDomain, entities: Sequence[Entity]) -> None:
    """Raise a LogicError unless all internal names differ and all types are declared."""
    types = {declared.name for declared in domain.types} | {
        declared.type for declared in domain.types
    }
    seen: set[str] = set()
    for entity in entities:
        if entity.name in seen:
            raise LogicError(
                f"the name '{entity.name}' is given twice, or the domain has a constant of that name."
            )
        seen.add(entity.name)

        if domain.types and entity.type not in types:
            raise LogicError(
                f"'{entity.label}' is of type '{entity.type}', which domain '{domain.name}' does not declare; "
                f"declared: {listed(sorted(types))}."
            )


def _check_facts(
    domain: SymbolicDomain, entities: Sequence[Entity], facts: Collection[Fact]
) -> None:
    """Raise a LogicError unless the facts of the initial state and goal fit the declared predicates."""
    declared = {predicate.name: predicate.parameters for predicate in domain.predicates}
    for predicate, *names in facts:
        text = f"({' '.join((predicate, *names))})"
        if predicate not in declared or len(declared[predicate]) != len(names):
            raise LogicError(
                f"domain '{domain.name}' declares no predicate for {text} of the initial state or goal."
            )

        for name, parameter in zip(names, declared[predicate], strict=True):
            valid = [
                entity.name
                for entity in entities
                if domain.is_of_type(entity.type, parameter.types)
            ]
            if name not in valid:
                raise LogicError(
                    f"domain '{domain.name}': '{name}' does not fit into {text} of the initial state or goal; "
                    f"valid: {listed(valid)}."
                )


def _check_distinct(kind: str, named: Sequence[object]) -> None:
    """Raise a LogicError if two things have the same name.

    Entities may share a label, as an object "left" and the arm do, until that makes two actions or facts look alike.
    """
    seen: set[object] = set()
    for thing in named:
        if thing in seen:
            raise LogicError(
                f"two {kind} of the domain would both be called {thing}: rename one of the objects."
            )
        seen.add(thing)
