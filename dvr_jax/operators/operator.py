"""An action operator is one object that contains everything that the planner has to know of an action.

The tuple `dvr_jax.operators.OPERATORS` determines the PDDL domain, the transcription of sequences into NLPs, the
proposals of the keyframe beam, the programs that are compiled in advance, the network's symbols and the printed text. A
new operator is one `Operator`; the independent check needs an `OperatorCheck` (`dvr_jax.checker.operators`) for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.goals import TABLE
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators.proposal import Proposal
from dvr_jax.scene.types import Scene, SceneObject

FREE = 1e3
"""Bound of a mode parameter that has no bound; it is finite, so that no arithmetic yields NaN."""

NO_BODY = -1
"""Stands for the table where the index of an object or a fixed body is wanted."""

FourFloats = tuple[float, float, float, float]


class Parameter(Enum):
    """The type of an argument of an action."""

    ARM = "arm"
    """The arm that carries the action out."""

    OBJECT = "object"
    """The object that the action switches."""

    FACE = "face"
    """A side face of the object."""

    SUPPORT = "support"
    """A support: the table, or a region."""


@dataclass(frozen=True, slots=True)
class ObjectMode:
    """How an object is attached during a phase."""

    kind: ModeKind
    """Whether the object is fixed, placed, held or absent."""

    parent: int = 0
    """Index of the arm that holds the object; 0, without meaning, if no arm holds it."""

    support: int = NO_BODY
    """Index of the body on whose top the object stands, fixed bodies after the objects; `NO_BODY` for the table, and
    where the object does not stand."""

    bottom: float = 0.0
    """Height of the bottom of a standing object above the table's top [m]; without meaning if it does not stand."""


@dataclass(frozen=True, slots=True)
class SkeletonState:
    """The discrete state of the world before an action of a sequence: modes of objects and openings of fingers."""

    scene: Scene
    modes: tuple[ObjectMode, ...]
    """Mode of each object."""

    finger_opening: tuple[float, ...]
    """Distance of each arm's fingers from the hand's middle plane [m]."""


@dataclass(frozen=True, slots=True)
class ModeSwitch:
    """The effect of an action at the end of its phase: one object changes its mode."""

    item: int
    """Index of the object."""

    acting_arm: int
    """Index of the arm that carries the action out."""

    arms_at_rest: frozenset[int]
    """Indices of the arms that take part in the switch, and therefore must not move in the interval before it."""

    mode: ObjectMode
    """Mode of the object afterwards."""

    lower: FourFloats
    """Lower bounds of the mode parameters of the new mode (`dvr_jax.modes` says what they mean) [m or rad]."""

    upper: FourFloats
    """Upper bounds of the mode parameters [m or rad]; a parameter whose two bounds are equal is constant."""

    finger_opening: tuple[float, ...]
    """Distance of each arm's fingers from the hand's middle plane afterwards [m]."""

    closing_yaw: float = 0.0
    """Yaw of the closing axis, along which the fingers close, in the frame of a held object [rad]."""

    preference: FourFloats = (0.0, 0.0, 0.0, 0.0)
    """Weights of the squared mode parameters in the cost [1/m^2 or 1/rad^2]; small parameters are preferred."""

    support: Rectangle | None = None
    """Area, seen from above, on which the object is placed; None if the action does not place it."""

    inner_prism: FourFloats = (0.0, 0.0, 0.0, 0.0)
    """Prism (hx, hy, hz, r) of the part of the object whose outline has to lie within the support: the object itself,
    or a vertical line if only its center has to [m]. Without meaning if the action does not place the object."""

    kept_clear: tuple[Rectangle, ...] = ()
    """Areas that the placed object must not cover."""


def standing_mode(scene: Scene, item: SceneObject) -> ObjectMode:
    """Return the mode of an object at the start.

    Args:
        scene: A valid scene.
        item: One of its objects.
    """
    return ObjectMode(
        ModeKind.FIXED,
        support=body_index(scene, item.support),
        bottom=scene.bottom_of(item),
    )


def body_index(scene: Scene, name: str) -> int:
    """Return the index of a fixed body among all bodies, the objects first, or `NO_BODY` for the table.

    Args:
        scene: A valid scene.
        name: Name of the support.
    """
    if name == TABLE:
        return NO_BODY
    return len(scene.objects) + [body.name for body in scene.fixed].index(name)


@dataclass(frozen=True)
class Operator:
    """An action schema with its symbolic and its geometric meaning."""

    name: str
    """Name in the PDDL domain, in lower case."""

    parameters: tuple[Parameter, ...]
    """Type of each argument, in the order of the PDDL parameters; exactly one is an arm and exactly one an object."""

    pddl: str
    """Text of the action in the PDDL domain, ``(:action ...)``."""

    phrase: str
    """The action in words, where {i} stands for argument i, as in "{0} grasps {2} at its {1} face"."""

    mode_after: ModeKind
    """Kind of the object's mode after the action."""

    refute: Callable[[Scene, Action], str | None]
    """Function that returns why a constant of the scene makes an action impossible whatever the motion is, or None."""

    is_duplicate: Callable[[Scene, Action], bool]
    """Function that returns whether an action means the same as another action, so that the search skips it."""

    switch: Callable[[SkeletonState, Action], ModeSwitch]
    """Function that returns the mode switch that an action makes in a state."""

    proposal: Callable[[ModeKind], Proposal]
    """Function that returns how the keyframe beam samples the action, given the object's kind of mode before it."""

    def argument(self, action: Action, parameter: Parameter) -> str:
        """Return the argument of an action that has this type.

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
    """Return the name of the object that an action switches.

    Args:
        action: The action.
        operators: The operators that are known.
    """
    return operator_of(action, operators).argument(action, Parameter.OBJECT)


def describe(action: Action, operators: Sequence[Operator]) -> str:
    """Return an action in words, as in "left grasps yellow at its +x face".

    Args:
        action: The action.
        operators: The operators that are known; an action of another one is printed as it is written.
    """
    for operator in operators:
        if operator.name == action.operator:
            return operator.phrase.format(*action.arguments)
    return str(action)


def refute(scene: Scene, action: Action, operators: Sequence[Operator]) -> str | None:
    """Return why a constant of the scene makes an action impossible whatever the motion is, or None.

    Args:
        scene: A valid scene.
        action: One of its actions.
        operators: The operators that are known.

    Returns:
        The reason in words, or None.
    """
    return operator_of(action, operators).refute(scene, action)


def is_duplicate(scene: Scene, action: Action, operators: Sequence[Operator]) -> bool:
    """Return whether an action means the same as another action of the scene, so that the search skips it.

    Args:
        scene: A valid scene.
        action: One of its actions.
        operators: The operators that are known.
    """
    return operator_of(action, operators).is_duplicate(scene, action)
