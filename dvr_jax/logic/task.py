"""The rearrangement task of Deep Visual Reasoning: from the names of objects, arms and regions to a grounding.

Here is all that Python knows about the contents of the domain: the types and constants that a scene fills in, the start
(all objects on the table, and perhaps on regions too) and the goal. In the paper's goal, one object is on the region
`goal`, which is a constant of the domain. Other regions are added as supports, and the constant is left out where a
scene has no region of this name. The tops of objects may be supports too (`dvr_jax.logic.stacking`).
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from dvr_jax.logic.actions import Fact
from dvr_jax.logic.domain import SymbolicDomain
from dvr_jax.logic.errors import LogicError, listed
from dvr_jax.logic.grounder import Entity, ground_domain
from dvr_jax.logic.grounding import Grounding
from dvr_jax.logic.parsing import read_domain
from dvr_jax.logic.stacking import with_stacking_rules
from dvr_jax.shapes import FACES

TABLE = "table"
"""Constant of the domain that stands for the table."""

GOAL_REGION = "goal"
"""Constant of the domain that stands for the region of the paper's goal."""


@dataclass(frozen=True, slots=True)
class Task:
    """What a scene adds to the domain, by the names that the user gave."""

    objects: tuple[str, ...]
    """Names of the objects, all different."""

    arms: tuple[str, ...]
    """Names of the arms, all different."""

    regions: tuple[str, ...]
    """Names of the regions, all different, and none of them "table"."""

    goal: tuple[Fact, ...]
    """Facts that hold at the end, as in `("on", "yellow", "goal")`."""

    forbidden: tuple[Fact, ...] = ()
    """Facts that do not hold at the end."""

    initial: tuple[Fact, ...] = ()
    """Facts that hold at the start, beside that every object is on the table."""

    tops: tuple[str, ...] = ()
    """Names of objects whose tops are supports; none of them is the name of a region, or "table"."""


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
    return ground_task(paper_task(objects, goal_object, arms), texts)


def paper_task(objects: Sequence[str], goal_object: str, arms: Sequence[str]) -> Task:
    """Return the task of the paper: from all objects on the table to one object on the region `goal`.

    Args:
        objects: the names of the objects of the scene.
        goal_object: the name of the object that shall be on the region.
        arms: the names of the arms.

    Raises:
        LogicError: the goal object is no object.
    """
    if goal_object not in objects:
        raise LogicError(
            f"the goal object '{goal_object}' is no object of the scene; objects: {listed(objects)}."
        )

    return Task(tuple(objects), tuple(arms), (GOAL_REGION,), (("on", goal_object, GOAL_REGION),))


@lru_cache(maxsize=64)
def ground_task(task: Task, action_texts: tuple[str, ...] | None = None) -> Grounding:
    """Ground a task; the last 64 groundings are kept and shared.

    Args:
        task: the names in the scene, the start and the goal.
        action_texts: PDDL texts `(:action ...)` of the operators; by default those of the package's own operators.

    Returns:
        The ground actions, the initial state and the goal.

    Raises:
        LogicError: a text is no PDDL action that fits the header of the domain.
    """
    return ground_task_in(read_domain(action_texts), task)


def ground_task_in(domain: SymbolicDomain, task: Task) -> Grounding:
    """Ground a task in any domain that has its types, constants and predicates.

    Args:
        domain: declares the types `arm`, `movable` and `support`, the constant `table`, and the predicates of the task.
        task: the names in the scene, the start and the goal.

    Returns:
        The ground actions, the initial state and the goal.

    Raises:
        LogicError: the domain does not fit the task.
    """
    if GOAL_REGION not in task.regions:
        domain = _without_goal_region(domain)

    # The names of the user are replaced by internal ones. The first arguments of `on` and the second ones of `holding`
    # are objects, so an object may have the name of an arm.
    arms = {name: f"a{number}" for number, name in enumerate(task.arms)}
    objects = {name: f"o{number}" for number, name in enumerate(task.objects)}
    regions = {name: f"s{number}" for number, name in enumerate(task.regions)}
    regions |= {GOAL_REGION: GOAL_REGION, TABLE: TABLE}
    # The top of an object is a support of its own, because an object is of the type `movable`.
    tops = {name: f"t{number}" for number, name in enumerate(task.tops)}
    of_predicate = {"on": (objects, regions | tops), "holding": (arms, objects)}

    def internal(fact: Fact) -> Fact:
        predicate, *arguments = fact
        names = of_predicate[predicate]
        return (predicate, *(of[name] for of, name in zip(names, arguments, strict=True)))

    added = [name for name in task.regions if name != GOAL_REGION]
    on_table = [("on", name, TABLE) for name in task.objects]
    grounding = ground_domain(
        domain,
        [
            *(Entity(arms[name], "arm", name) for name in task.arms),
            *(Entity(objects[name], "movable", name) for name in task.objects),
            *(Entity(regions[name], "support", name) for name in added),
            *(Entity(tops[name], "support", name) for name in task.tops),
        ],
        initial=[internal(fact) for fact in (*on_table, *task.initial)],
        goal=[internal(fact) for fact in task.goal],
        forbidden=[internal(fact) for fact in task.forbidden],
        constant_labels={f"face{eta}": name for eta, name in enumerate(FACES)},
    )
    return with_stacking_rules(grounding, task.tops)


def _without_goal_region(domain: SymbolicDomain) -> SymbolicDomain:
    """Leave out the constant of the paper's goal region, unless an action names it."""
    terms = {
        term
        for action in domain.actions
        for literal in (*action.precondition, *action.effect)
        for term in literal.terms
    }
    if GOAL_REGION in terms:
        return domain
    constants = tuple(constant for constant in domain.constants if constant.name != GOAL_REGION)
    return replace(domain, constants=constants)


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
