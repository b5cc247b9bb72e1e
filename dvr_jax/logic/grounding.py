"""A grounded domain: its states, which actions apply in them, and when the goal is reached.

A state is a Python int, bit i of it telling whether `facts[i]` holds. A ground action has four masks: it applies in a
state s if `s & required == required` and `s & forbidden == 0`, and leads to `s & ~deleted | added`. A sequence of
actions ends as soon as the goal first holds, so no action is counted after that.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

from dvr_jax.logic.errors import LogicError, listed

Fact = tuple[str, ...]
"""Predicate and arguments by the names the user gave, as in `("holding", "left", "yellow")`."""


@dataclass(frozen=True, order=True, slots=True)
class Action:
    """A ground action by the names the user gave, as in `Action("grasp", ("left", "+x", "yellow"))`."""

    operator: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.operator}({', '.join(self.arguments)})"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The action that `str` wrote, as in "grasp(left, +x, yellow)"."""
        match = re.fullmatch(r"\s*([^\s(),]+)\s*\(([^()]*)\)\s*", text)
        if match is None:
            raise LogicError(f"'{text}' is no action; valid is for instance 'grasp(left, +x, yellow)'.")
        return cls(match[1], tuple(argument.strip() for argument in match[2].split(",")))


@dataclass(frozen=True, slots=True)
class Masks:
    """What a ground action asks of a state and does to it, as bits over `Grounding.facts`."""

    required: int
    forbidden: int
    deleted: int
    added: int

    def allow(self, state: int) -> bool:
        """Whether the action is applicable in this state."""
        return state & self.required == self.required and not state & self.forbidden


@dataclass(frozen=True, slots=True)
class Grounding:
    """All ground actions over one scene's objects, with the initial state and the goal."""

    actions: tuple[Action, ...]
    """In a fixed order: by operator name, then by arguments in the order in which they were given."""
    masks: tuple[Masks, ...]
    """One per action."""
    facts: tuple[Fact, ...]
    """The facts that an action can change; a state's bit i is facts[i]."""
    initial_state: int
    goal: int
    """The bits that all must hold."""
    _bit_of: dict[Fact, int] = field(default_factory=dict, init=False, repr=False, compare=False)
    _index_of: dict[Action, int] = field(default_factory=dict, init=False, repr=False, compare=False)
    _applicable: dict[int, tuple[int, ...]] = field(default_factory=dict, init=False, repr=False, compare=False)
    _reaches: dict[tuple[int, int], bool] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._bit_of.update({fact: 1 << i for i, fact in enumerate(self.facts)})
        self._index_of.update({action: i for i, action in enumerate(self.actions)})

    def applicable(self, state: int) -> tuple[int, ...]:
        """Indices of the actions applicable in this state, ascending; the rule that the goal ends all is not in it."""
        # Kept per state: a tree search asks for the same few hundred states at thousands of nodes.
        if state not in self._applicable:
            self._applicable[state] = tuple(i for i, masks in enumerate(self.masks) if masks.allow(state))
        return self._applicable[state]

    def successor(self, state: int, index: int) -> int:
        """The state after action number `index`; an inapplicable action is an error."""
        masks = self.masks[index]
        if not masks.allow(state):
            raise LogicError(f"{self._why_not(state, index)} {self._what_instead(state)}")
        return state & ~masks.deleted | masks.added

    def is_goal(self, state: int) -> bool:
        """Whether the goal holds, so that a sequence ends here."""
        return state & self.goal == self.goal

    def holds(self, state: int, predicate: str, *arguments: str) -> bool:
        """Whether a fact holds in this state, as in `holds(state, "holding", "left", "yellow")`."""
        fact = (predicate, *arguments)
        if fact not in self._bit_of:
            raise LogicError(f"no fact {_text(fact)} is ever changed; valid: {listed(map(_text, self.facts))}.")
        return bool(state & self._bit_of[fact])

    def facts_in(self, state: int) -> tuple[Fact, ...]:
        """The facts that hold in this state."""
        return tuple(fact for fact, bit in self._bit_of.items() if state & bit)

    def reaches_goal_in(self, state: int, length: int) -> bool:
        """Whether the goal can first be reached by exactly `length` more actions."""
        if self.is_goal(state) or length <= 0:
            return self.is_goal(state) and length == 0
        key = (state, length)
        if key not in self._reaches:
            successors = dict.fromkeys(self.successor(state, i) for i in self.applicable(state))
            self._reaches[key] = any(self.reaches_goal_in(after, length - 1) for after in successors)
        return self._reaches[key]

    def can_reach_goal(self, state: int, remaining: int) -> bool:
        """Whether the goal holds, or can be reached by at most `remaining` more actions."""
        return any(self.reaches_goal_in(state, length) for length in range(remaining + 1))

    def index(self, action: Action) -> int:
        """The number of an action in `actions`; an unknown one is an error that names what is wrong with it."""
        if action not in self._index_of:
            raise LogicError(self._why_unknown(action))
        return self._index_of[action]

    def apply(self, sequence: Sequence[Action]) -> tuple[int, ...]:
        """The K + 1 states before, between and after K actions; the first inapplicable action is an error."""
        states = [self.initial_state]
        for step, action in enumerate(sequence, start=1):
            try:
                states.append(self.successor(states[-1], self.index(action)))
            except LogicError as error:
                raise LogicError(f"action {step} of {len(sequence)}: {error}") from None
        return tuple(states)

    def check_sequence(self, sequence: Sequence[Action]) -> tuple[int, ...]:
        """As `apply`, and the goal must hold after the last action and not before."""
        states = self.apply(sequence)
        goal = " and ".join(map(_text, self.facts_in(self.goal)))
        first = next((step for step, state in enumerate(states) if self.is_goal(state)), None)
        if first is None:
            raise LogicError(f"this sequence of length {len(sequence)} does not reach the goal {goal}.")
        if first < len(sequence):
            raise LogicError(
                f"the goal {goal} holds after {first} of {len(sequence)} actions: the sequence must end there."
            )
        return states

    def _why_not(self, state: int, index: int) -> str:
        masks = self.masks[index]
        missing = [f"{_text(fact)} does not hold" for fact in self.facts_in(masks.required & ~state)]
        in_the_way = [f"{_text(fact)} holds" for fact in self.facts_in(masks.forbidden & state)]
        return f"{self.actions[index]} is not applicable, because {' and '.join(missing + in_the_way)}."

    def _what_instead(self, state: int) -> str:
        return f"Applicable there: {listed(self.actions[i] for i in self.applicable(state))}."

    def _why_unknown(self, action: Action) -> str:
        operators = dict.fromkeys(known.operator for known in self.actions)
        if action.operator not in operators:
            return f"{action}: there is no operator '{action.operator}'; valid: {listed(operators)}."
        same = [known.arguments for known in self.actions if known.operator == action.operator]
        if len(action.arguments) != len(same[0]):
            example = Action(action.operator, same[0])
            return f"{action}: {action.operator} takes {len(same[0])} arguments, as in {example}."
        for place, argument in enumerate(action.arguments):
            valid = dict.fromkeys(arguments[place] for arguments in same)
            if argument not in valid:
                return f"{action}: argument {place + 1} is '{argument}'; valid: {listed(valid)}."
        return f"{action} can never be applied: what it requires is fixed and does not hold."


def _text(fact: Fact) -> str:
    return f"{fact[0]}({', '.join(fact[1:])})"
