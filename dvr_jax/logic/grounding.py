"""A grounded domain: its states, the actions that apply in a state, and the goal.

A state is a Python int. Bit i of a state tells whether `facts[i]` holds. A sequence of actions ends as soon as the goal
first holds, so no action is counted after that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from dvr_jax.logic.actions import Action, Fact, Masks, text_of_fact
from dvr_jax.logic.errors import LogicError, listed


@dataclass(frozen=True, slots=True)
class Grounding:
    """All ground actions over the objects of one scene, with the initial state and the goal."""

    actions: tuple[Action, ...]
    """In a fixed order: by operator name, then by arguments in the order in which they were given."""

    masks: tuple[Masks, ...]
    """One for each action."""

    facts: tuple[Fact, ...]
    """The facts that an action can change; bit i of a state stands for facts[i]."""

    initial_state: int
    """The bits of the facts that hold at the start."""

    goal: int
    """The bits that all must hold at the end."""

    goal_forbidden: int = 0
    """The bits of which none may hold at the end."""

    _bit_of: dict[Fact, int] = field(default_factory=dict, init=False, repr=False, compare=False)
    _index_of: dict[Action, int] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _applicable: dict[int, tuple[int, ...]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _reaches: dict[tuple[int, int], bool] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        self._bit_of.update({fact: 1 << index for index, fact in enumerate(self.facts)})
        self._index_of.update({action: index for index, action in enumerate(self.actions)})

    def applicable(self, state: int) -> tuple[int, ...]:
        """Return the indices of the actions that apply in this state, ascending.

        The rule that a sequence ends at the goal is not part of this: actions apply in a goal state too.
        """
        # Kept per state: a tree search asks for the same few hundred states at thousands of nodes.
        if state not in self._applicable:
            self._applicable[state] = tuple(
                index for index, masks in enumerate(self.masks) if masks.allow(state)
            )
        return self._applicable[state]

    def successor(self, state: int, index: int) -> int:
        """Return the state after an action.

        Args:
            state: the state before the action.
            index: the number of the action in `actions`.

        Returns:
            The state after the action.

        Raises:
            LogicError: the action does not apply in this state; the message names those that do.
        """
        masks = self.masks[index]
        if not masks.allow(state):
            reason = self._explain_inapplicable(state, index)
            applicable = listed(self.actions[other] for other in self.applicable(state))
            raise LogicError(f"{reason} Applicable there: {applicable}.")
        return masks.apply(state)

    def is_goal(self, state: int) -> bool:
        """Return whether the goal holds, so that a sequence ends here."""
        return state & self.goal == self.goal and not state & self.goal_forbidden

    def holds(self, state: int, predicate: str, *arguments: str) -> bool:
        """Return whether a fact holds, as in `holds(state, "holding", "left", "yellow")`.

        Args:
            state: the state to look at.
            predicate: the name of the predicate.
            *arguments: the arguments of the predicate, by the names that the user gave.

        Returns:
            True if the fact holds in the state.

        Raises:
            LogicError: no action changes this fact, or there is no such fact.
        """
        fact = (predicate, *arguments)
        if fact not in self._bit_of:
            valid = listed(map(text_of_fact, self.facts))
            raise LogicError(f"no fact {text_of_fact(fact)} is ever changed; valid: {valid}.")
        return bool(state & self._bit_of[fact])

    def facts_in(self, state: int) -> tuple[Fact, ...]:
        """Return the facts that hold in this state."""
        return tuple(fact for fact, bit in self._bit_of.items() if state & bit)

    def reaches_goal_in(self, state: int, length: int) -> bool:
        """Return whether the goal can first be reached by exactly this number of further actions.

        Args:
            state: the state to start from.
            length: the number of further actions.

        Returns:
            True if a sequence of this length ends where the goal first holds.
        """
        if self.is_goal(state) or length <= 0:
            return self.is_goal(state) and length == 0

        key = (state, length)
        if key not in self._reaches:
            successors = dict.fromkeys(
                self.successor(state, index) for index in self.applicable(state)
            )
            self._reaches[key] = any(
                self.reaches_goal_in(after, length - 1) for after in successors
            )
        return self._reaches[key]

    def can_reach_goal(self, state: int, remaining: int) -> bool:
        """Return whether the goal holds, or can be reached by few enough further actions.

        Args:
            state: the state to start from.
            remaining: the largest number of further actions.

        Returns:
            True if a sequence of at most this length ends where the goal first holds.
        """
        return any(self.reaches_goal_in(state, length) for length in range(remaining + 1))

    def index(self, action: Action) -> int:
        """Return the number of an action in `actions`.

        Args:
            action: the action, by the names that the user gave.

        Returns:
            The number.

        Raises:
            LogicError: there is no such action; the message names what is wrong with it.
        """
        if action not in self._index_of:
            raise LogicError(self._explain_unknown(action))
        return self._index_of[action]

    def apply(self, sequence: Sequence[Action]) -> tuple[int, ...]:
        """Apply actions one after the other, from the initial state on.

        Args:
            sequence: K actions.

        Returns:
            The K + 1 states before, between and after the actions.

        Raises:
            LogicError: an action is unknown or does not apply; the message names the first one.
        """
        states = [self.initial_state]
        for step, action in enumerate(sequence, start=1):
            try:
                state = self.successor(states[-1], self.index(action))
            except LogicError as error:
                raise LogicError(f"action {step} of {len(sequence)}: {error}") from None
            states.append(state)
        return tuple(states)

    def check_sequence(self, sequence: Sequence[Action]) -> tuple[int, ...]:
        """Apply actions, and require that the goal holds after the last one and not before.

        Args:
            sequence: K actions.

        Returns:
            The K + 1 states before, between and after the actions.

        Raises:
            LogicError: an action does not apply, or the goal first holds elsewhere than at the end.
        """
        states = self.check_prefix(sequence)
        if not self.is_goal(states[-1]):
            raise LogicError(
                f"this sequence of length {len(sequence)} does not reach the goal {self._goal_text}."
            )
        return states

    def check_prefix(self, sequence: Sequence[Action]) -> tuple[int, ...]:
        """Apply actions, and require that the goal does not hold before the last one.

        Args:
            sequence: K actions.

        Returns:
            The K + 1 states before, between and after the actions.

        Raises:
            LogicError: an action does not apply, or the goal holds before the end.
        """
        states = self.apply(sequence)
        first = next((step for step, state in enumerate(states) if self.is_goal(state)), None)
        if first is not None and first < len(sequence):
            raise LogicError(
                f"the goal {self._goal_text} holds after {first} of {len(sequence)} actions: "
                "the sequence must end there."
            )
        return states

    @property
    def _goal_text(self) -> str:
        """The facts of the goal, as text."""
        wanted = [text_of_fact(fact) for fact in self.facts_in(self.goal)]
        unwanted = [f"not {text_of_fact(fact)}" for fact in self.facts_in(self.goal_forbidden)]
        return " and ".join(wanted + unwanted)

    def _explain_inapplicable(self, state: int, index: int) -> str:
        """Say which facts keep an action from applying in a state."""
        masks = self.masks[index]
        missing = self.facts_in(masks.required & ~state)
        in_the_way = self.facts_in(masks.forbidden & state)
        reasons = [f"{text_of_fact(fact)} does not hold" for fact in missing]
        reasons += [f"{text_of_fact(fact)} holds" for fact in in_the_way]
        return f"{self.actions[index]} is not applicable, because {' and '.join(reasons)}."

    def _explain_unknown(self, action: Action) -> str:
        """Say what is wrong with an action that is not in `actions`, and what would be valid."""
        operators = dict.fromkeys(known.operator for known in self.actions)
        if action.operator not in operators:
            return (
                f"{action}: there is no operator '{action.operator}'; valid: {listed(operators)}."
            )

        arguments_of_operator = [
            known.arguments for known in self.actions if known.operator == action.operator
        ]
        example = Action(action.operator, arguments_of_operator[0])
        number = len(example.arguments)
        if len(action.arguments) != number:
            return f"{action}: {action.operator} takes {number} arguments, as in {example}."

        for place, argument in enumerate(action.arguments):
            valid = dict.fromkeys(arguments[place] for arguments in arguments_of_operator)
            if argument not in valid:
                return f"{action}: argument {place + 1} is '{argument}'; valid: {listed(valid)}."
        return f"{action} can never be applied: what it requires is fixed and does not hold."
