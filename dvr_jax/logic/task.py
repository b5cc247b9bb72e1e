"""The rearrangement task of Deep Visual Reasoning: from the names of objects and arms to a grounding.

Here is all that Python knows about the contents of the domain: the types and constants that a scene fills in, the start
(all objects on the table) and the goal (the goal object on the goal region).
"""

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

from dvr_jax.logic.domain import SymbolicDomain
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.logic.grounder import Entity, ground_domain
from dvr_jax.logic.grounding import Grounding
from dvr_jax.logic.parsing import read_domain
from dvr_jax.shapes import FACES


def ground_actions(
    objects: Sequence[str],
    goal_object: str,
    arms: Sequence[str],
    action_texts: Sequence[str] | None = None,
) -> Grounding:
    """Ground the task, from all objects on the table to the goal object on the goal region.

    Names are free: they need not be PDDL identifiers, and an object may be called "table" or "left". The last 64
    groundings are kept and shared, because scenes with the same names have the same grounding.

    Args:
        objects: the names of the objects of the scene.
        goal_object: the name of the object that shall be on the goal region.
        arms: the names of the arms.
        action_texts: PDDL texts `(:action ...)` of the operators; by default those of the package's own operators.

    Returns:
        The ground actions, the initial state and the goal.

    Raises:
        LogicError: a name is given twice, there is no object or no arm, the goal object is no object, or a text is no
            PDDL action that fits the header of the domain.
    """
    _check_names("object", objects)
    _check_names("arm", arms)
    texts = None if action_texts is None else tuple(action_texts)
    return _ground_actions(tuple(objects), goal_object, tuple(arms), texts)


@lru_cache(maxsize=64)
def _ground_actions(
    objects: tuple[str, ...],
    goal_object: str,
    arms: tuple[str, ...],
    action_texts: tuple[str, ...] | None,
) -> Grounding:
    return ground_task(read_domain(action_texts), objects, goal_object, arms)


def ground_task(
    domain: SymbolicDomain,
    objects: Sequence[str],
    goal_object: str,
    arms: Sequence[str],
) -> Grounding:
    """Ground the task in any domain that has its types, constants and predicates.

    Args:
        domain: declares the types `arm` and `movable`, the constants `table` and `goal`, and the predicate `on`.
        objects: the names of the objects of the scene, all different.
        goal_object: the name of the object that shall be on the goal region.
        arms: the names of the arms, all different.

    Returns:
        The ground actions, the initial state and the goal.

    Raises:
        LogicError: the goal object is no object, or the domain does not fit the task.
    """
    if goal_object not in objects:
        raise LogicError(
            f"the goal object '{goal_object}' is no object of the scene; objects: {listed(objects)}."
        )

    arm_entities = [Entity(f"a{number}", "arm", name) for number, name in enumerate(arms)]
    object_entities = [Entity(f"o{number}", "movable", name) for number, name in enumerate(objects)]
    goal_entity = object_entities[list(objects).index(goal_object)]
    return ground_domain(
        domain,
        [*arm_entities, *object_entities],
        initial=[("on", entity.name, "table") for entity in object_entities],
        goal=[("on", goal_entity.name, "goal")],
        constant_labels={f"face{eta}": name for eta, name in enumerate(FACES)},
    )


def _check_names(kind: str, names: Sequence[str]) -> None:
    """Raise a LogicError unless the names are one or more different ones."""
    if isinstance(names, str):
        raise LogicError(
            f"the {kind} names are one string, {names!r}; wanted is a sequence of names."
        )
    if not names:
        raise LogicError(f"there is no {kind}; at least one is needed.")

    twice = [name for name, number in Counter(names).items() if number > 1]
    if twice:
        raise LogicError(f"two {kind}s have the same name: {listed(twice)}.")
