"""The rearrangement task of Deep Visual Reasoning: from object names to a grounding, and actions in words.

Here is all that Python knows about the contents of `domain.pddl`: which types and constants a scene fills in, that all
objects start on the table, that the goal object shall be on the goal region, and how a person would say an action.
"""

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from dvr_jax.logic.domain import read_domain
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.logic.grounder import Entity, ground_domain
from dvr_jax.logic.grounding import Action, Grounding

ARMS = ("left", "right")

FACES = ("+x", "+y", "-x", "-y")
"""Side faces of an object by their outward normal in its own frame; the paper's eta counts them, 0 to 3."""

PHRASES = {
    "grasp": "{0} grasps {2} at its {1} face",
    "place": "{0} places {1} on {2}",
}
"""Operator name to words, with the places of its arguments; an operator without an entry is printed as it is."""

OBJECT_ARGUMENT = {"grasp": 2, "place": 1}
"""Operator name to the place of the object among its arguments."""


def object_of(action: Action) -> str:
    """The object that an action moves from one holder or support to another."""
    return action.arguments[OBJECT_ARGUMENT[action.operator]]


def ground_actions(
    objects: Sequence[str], goal_object: str, arms: Sequence[str] = ARMS, domain_file: Path | None = None
) -> Grounding:
    """All actions over these objects, from all of them on the table to the goal object on the goal region.

    Names are free: they need not be PDDL identifiers, and an object may be called "table" or "left". `domain_file`
    replaces the package's `domain.pddl`; it must declare the same types, `table`, `goal` and `on`. Groundings of the
    package's own domain are kept and shared.
    """
    _check_names("object", objects)
    _check_names("arm", arms)
    if domain_file is None:
        return _ground_shipped(tuple(objects), goal_object, tuple(arms))
    return _ground(tuple(objects), goal_object, tuple(arms), domain_file)


@lru_cache(maxsize=64)
def _ground_shipped(objects: tuple[str, ...], goal_object: str, arms: tuple[str, ...]) -> Grounding:
    return _ground(objects, goal_object, arms, None)


def _ground(objects: tuple[str, ...], goal_object: str, arms: tuple[str, ...], domain_file: Path | None) -> Grounding:
    if goal_object not in objects:
        raise LogicError(f"the goal object '{goal_object}' is no object of the scene; objects: {listed(objects)}.")
    arm_entities = [Entity(f"a{i}", "arm", name) for i, name in enumerate(arms)]
    object_entities = [Entity(f"o{i}", "movable", name) for i, name in enumerate(objects)]
    return ground_domain(
        read_domain(domain_file),
        arm_entities + object_entities,
        initial=[("on", entity.name, "table") for entity in object_entities],
        goal=[("on", f"o{objects.index(goal_object)}", "goal")],
        constant_labels={f"face{eta}": name for eta, name in enumerate(FACES)},
    )


def describe(action: Action) -> str:
    """The action in words, as in "left grasps yellow at its +x face"."""
    phrase = PHRASES.get(action.operator)
    return str(action) if phrase is None else phrase.format(*action.arguments)


def _check_names(kind: str, names: Sequence[str]) -> None:
    if isinstance(names, str):
        raise LogicError(f"the {kind} names are one string, {names!r}; wanted is a sequence of names.")
    if not names:
        raise LogicError(f"there is no {kind}; at least one is needed.")
    twice = [name for name, number in Counter(names).items() if number > 1]
    if twice:
        raise LogicError(f"two {kind}s have the same name: {listed(twice)}.")
