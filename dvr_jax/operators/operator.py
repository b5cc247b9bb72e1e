"""What an action operator is: one value that the whole planner is driven by.

The ordered tuple of operators (`dvr_jax.operators.OPERATORS`) drives the PDDL domain, transcription into an NLP, the
proposals of the keyframe beam, the programs that are compiled beforehand, the network's symbols and the printed text. A
new operator is one file with an `Operator`; its half in the independent check is another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators.proposal import Proposal
from dvr_jax.scene.types import Scene

FREE = 1e3
"""Stands for no bound of a mode parameter: finite, so that no arithmetic yields NaN."""

FourFloats = tuple[float, float, float, float]


class Parameter(Enum):
    """What kind of thing an argument of an action is."""

    ARM = "arm"
    """The arm that carries the action out."""

    OBJECT = "object"
    """The object that the action switches."""

    FACE = "face"
    """A side face of the object."""

    SUPPORT = "support"
    """A support: the table, or a region of the goal."""


@dataclass(frozen=True, slots=True)
class ObjectMode:
    """How an object is attached during a phase."""

    kind: ModeKind
    parent: int = 0
    """The arm that holds the object; 0 where it is not held."""


@dataclass(frozen=True, slots=True)
class SkeletonState:
    """What is known of a skeleton before one of its actions."""

    scene: Scene
    modes: tuple[ObjectMode, ...]
    """Mode of each object."""

    finger_opening: tuple[float, ...]
    """Distance of each arm's fingers from the hand's middle plane [m]."""


@dataclass(frozen=True, slots=True)
class ModeSwitch:
    """What an action does to the world: one object changes its mode."""

    item: int
    """Index of the object."""

    acting_arm: int
    """Arm that carries the action out."""

    arms_at_rest: frozenset[int]
    """Arms that take part in the switch and rest at it."""

    mode: ObjectMode
    """Mode of the object afterwards."""

    lower: FourFloats
    """Lower bounds of the mode parameters."""

    upper: FourFloats
    """Upper bounds; equal bounds pin a parameter."""

    finger_opening: tuple[float, ...]
    """Distance of each arm's fingers from the hand's middle plane afterwards [m]."""

    closing_yaw: float = 0.0
    """Yaw of a held object's closing axis in the object's frame [rad]."""

    support: Rectangle | None = None
    """Where the object is put, if it is put somewhere."""


@dataclass(frozen=True)
class Operator:
    """An action schema with its symbolic and its geometric meaning."""

    name: str
    """Name in the PDDL domain, in lower case."""

    parameters: tuple[Parameter, ...]
    """What each argument is, in the order of the PDDL parameters: exactly one arm and one object."""

    pddl: str
    """The ``(:action ...)`` of the domain."""

    phrase: str
    """The action in words, with the places of its arguments, as in "{0} grasps {2} at its {1} face"."""

    mode_after: ModeKind
    """Mode that the action leaves its object in."""

    refute: Callable[[Scene, Action], str | None]
    """Why an action cannot be done whatever the motion, a constant of the scene; or None."""

    is_duplicate: Callable[[Scene, Action], bool]
    """Whether an action is the same as another one by another name, so that it need not be looked at."""

    switch: Callable[[SkeletonState, Action], ModeSwitch]
    """The mode switch that an action makes in a state."""

    proposal: Callable[[ModeKind], Proposal]
    """How the keyframe beam samples the action, given the mode that its object is in before."""

    def argument(self, action: Action, parameter: Parameter) -> str:
        """Return the argument of an action that is of this kind.

        Raises:
            DvrError: The operator has no such parameter.
        """
        if parameter not in self.parameters:
            raise DvrError(
                f"the operator '{self.name}' has no parameter of the kind '{parameter.value}'."
            )
        return action.arguments[self.parameters.index(parameter)]


def operator_of(action: Action, operators: Sequence[Operator]) -> Operator:
    """Return the operator of an action.

    Raises:
        DvrError: None of the operators has the action's name; the message lists their names.
    """
    for operator in operators:
        if operator.name == action.operator:
            return operator
    known = ", ".join(operator.name for operator in operators)
    raise DvrError(f"the operator '{action.operator}' has no geometric meaning; known: {known}.")


def object_of(action: Action, operators: Sequence[Operator]) -> str:
    """Name of the object that an action switches.

    Args:
        action: The action.
        operators: The operators that are known.
    """
    return operator_of(action, operators).argument(action, Parameter.OBJECT)


def describe(action: Action, operators: Sequence[Operator]) -> str:
    """The action in words, as in "left grasps yellow at its +x face".

    Args:
        action: The action.
        operators: The operators that are known; an action of another one is printed as it is written.
    """
    for operator in operators:
        if operator.name == action.operator:
            return operator.phrase.format(*action.arguments)
    return str(action)


def refute(scene: Scene, action: Action, operators: Sequence[Operator]) -> str | None:
    """Why an action cannot be done whatever the motion, a constant of the scene; or None.

    Args:
        scene: A valid scene.
        action: One of its actions.
        operators: The operators that are known.

    Returns:
        The reason in words, or None.
    """
    return operator_of(action, operators).refute(scene, action)


def is_duplicate(scene: Scene, action: Action, operators: Sequence[Operator]) -> bool:
    """Whether an action is the same as another one by another name.

    Args:
        scene: A valid scene.
        action: One of its actions.
        operators: The operators that are known.
    """
    return operator_of(action, operators).is_duplicate(scene, action)
