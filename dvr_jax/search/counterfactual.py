"""Confirms reasons: a cause is named only if the actions become possible without it.

The best point of an infeasible NLP shows a symptom, and not always its cause: an arm that has to fold because an object
stands too near to its base penetrates itself. Changed scenes tell the cause. In each of them one thing is different: an
object or a fixed body is gone, or the object or the region is nearer to the acting arm or farther away from it. The
changes are judged in one batch, and the smallest change with which the actions are possible is the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dvr_jax.errors import DvrError
from dvr_jax.goals import TABLE
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.transcription import walk
from dvr_jax.operators import Operator, describe, ground_scene, object_of
from dvr_jax.scene.types import Scene
from dvr_jax.search.node import Node
from dvr_jax.search.reasons import (
    NO_MOTION,
    Reason,
    ReasonKind,
    as_cause,
    centimeters,
    target_words,
)
from dvr_jax.search.session import SearchSession
from dvr_jax.search.tree import SequenceTree
from dvr_jax.search.work import Steps, run_together

FAR_AWAY = 50.0
"""Where bodies are put that are left out, along x and y [m]."""

SHIFTS = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4, 0.55)
"""Distances by which objects and regions are moved [m]."""


_NOT_CONFIRMED = (ReasonKind.WIDTH, ReasonKind.SIZE, ReasonKind.ACTIONS)
"""Kinds of reasons that no change of a position confirms."""


@dataclass(frozen=True, slots=True)
class Change:
    """A scene and actions with one difference, and the reason that it confirms."""

    scene: Scene
    """The changed scene."""

    actions: tuple[Action, ...]
    """The actions, without those on an object that is left out."""

    reason: Reason
    """The reason if the actions are possible in the changed scene."""


def is_possible(
    scene: Scene,
    actions: Sequence[Action],
    seed: int,
    operators: Sequence[Operator],
    has_motion: bool = False,
) -> Steps[bool]:
    """Judge whether keyframes exist for actions that the logic allows, and a motion if that is asked for.

    Args:
        scene: A scene, which need not be valid.
        actions: The actions.
        seed: Seed of all sampling.
        operators: The operators that are known.
        has_motion: Whether a feasible path has to exist too.
    """
    try:
        tree = SequenceTree(scene, len(actions), seed, operators=operators, is_relaxed=False)
    except DvrError:
        # Something collides in the initial state of the changed scene.
        return False
    node = tree.root
    for action in actions:
        node = Node((*node.actions, action), 0, node, reaches_goal=False)
        yield from tree.judge_sequences([node])
        yield from tree.retry_refuted([node])
        if not node.feasible:
            return False
    if has_motion and node is not tree.root:
        session = SearchSession(tree, accept=lambda *_: True, progress=lambda _: None)
        return (yield from session.try_path(node)) is not None
    return True


def _removals(
    scene: Scene, actions: tuple[Action, ...], symptom: Reason, operators: Sequence[Operator]
) -> Iterator[Change]:
    """Yield the scenes without one of the bodies that the last action does not switch, those of the symptom first."""
    item = object_of(actions[-1], operators)
    names = [*scene.object_names, *(body.name for body in scene.fixed)]
    for name in sorted(names, key=lambda name: name not in symptom.bodies):
        if name == item:
            continue
        left = tuple(action for action in actions if object_of(action, operators) != name)
        changed = without_body(scene, name)
        if not _is_allowed(changed, left, operators):
            continue
        reason = as_cause(symptom)
        if name not in symptom.bodies:
            doing = describe(actions[-1], operators)
            is_motion = symptom.kind is ReasonKind.MOTION
            sentence = f"{NO_MOTION if is_motion else ''}When {doing}, '{name}' is in the way."
            bodies = (item, name)
            kind = ReasonKind.MOTION if is_motion else ReasonKind.COLLISION
            reason = Reason(kind, str(actions[-1]), bodies, math.nan, sentence)
        yield Change(changed, left, reason)


def _is_allowed(scene: Scene, actions: Sequence[Action], operators: Sequence[Operator]) -> bool:
    """Return whether the logic allows actions one after the other."""
    try:
        ground_scene(scene, operators).apply(actions)
    except DvrError:
        return False
    return True


def without_body(scene: Scene, name: str) -> Scene:
    """Return a scene with a body far away from everything else.

    Args:
        scene: A valid scene.
        name: Name of an object or of a fixed body.
    """
    objects = tuple(
        replace(item, position=(FAR_AWAY, FAR_AWAY), support=TABLE) if item.name == name else item
        for item in scene.objects
    )
    fixed = tuple(
        replace(body, position=(FAR_AWAY, FAR_AWAY, body.position[2]))
        if body.name == name
        else body
        for body in scene.fixed
    )
    return replace(scene, objects=objects, fixed=fixed)


def _shifts(
    scene: Scene, actions: tuple[Action, ...], symptom: Reason, operators: Sequence[Operator]
) -> Iterator[Change]:
    """Yield the scenes in which the object or the region is nearer to the acting arm, or farther away from it.

    Small shifts come first.
    """
    last = actions[-1]
    _, switches = walk(scene, actions, (), operators)
    switch = switches[-1]
    item = scene.objects[switch.item]
    arm = scene.workcell.arms[switch.acting_arm]
    is_place = switch.mode.kind == ModeKind.PLACED
    if is_place and last.arguments[-1] not in scene.region_names:
        return
    if not is_place and any(object_of(a, operators) == item.name for a in actions[:-1]):
        return
    what = last.arguments[-1] if is_place else item.name
    start = scene.region(what).position if is_place else item.position
    shown = target_words(scene, what) if is_place else f"'{item.name}'"
    doing = describe(last, operators)
    # An arm that certainly falls short may need a longer shift than an arm that may reach.
    is_short = symptom.kind == ReasonKind.REACH and symptom.amount > SHIFTS[0]
    lengths = sorted({*SHIFTS, *(symptom.amount + length for length in SHIFTS if is_short)})
    for shift, (sign, words) in product(lengths, ((-1, "too far from"), (1, "too near to"))):
        position = shifted(start, arm.position, sign * shift)
        changed = (
            scene.with_region(replace(scene.region(what), position=position))
            if is_place
            else move_object(scene, item.name, position)
        )
        before = NO_MOTION if symptom.kind is ReasonKind.MOTION else ""
        sentence = f"{before}When {doing}, {shown} is {centimeters(shift)} cm {words} the base of the {arm.name} arm."
        bodies = (f"{arm.name} arm", what)
        yield Change(
            changed, actions, Reason(ReasonKind.REACH, str(last), bodies, -sign * shift, sentence)
        )


def shifted(
    point: tuple[float, float], base: tuple[float, float], distance: float
) -> tuple[float, float]:
    """Return a point that is farther from a base by a distance [m], along the line through both.

    Args:
        point: Point (x, y) [m].
        base: Position (x, y) of the base [m].
        distance: The distance; negative brings the point nearer [m].
    """
    offset = np.subtract(point, base)
    length = max(float(np.linalg.norm(offset)), 1e-9)
    moved = np.asarray(base) + offset * (max(length + distance, 0.0) / length)
    return float(moved[0]), float(moved[1])


def move_object(scene: Scene, name: str, position: tuple[float, float]) -> Scene:
    """Return a scene with an object at another position.

    Args:
        scene: A valid scene.
        name: Name of the object.
        position: Its new position (x, y) [m].
    """
    objects = tuple(
        replace(item, position=position) if item.name == name else item for item in scene.objects
    )
    return replace(scene, objects=objects)


def confirm(
    scene: Scene,
    cases: Sequence[tuple[tuple[Action, ...], Reason]],
    seed: int,
    operators: Sequence[Operator],
) -> list[Reason]:
    """Return confirmed reasons of refuted actions, or the symptoms where no change makes the actions possible.

    Args:
        scene: A valid scene.
        cases: Actions of which the last one is impossible, and the reason that the best point of their NLP shows.
        seed: Seed of all sampling.
        operators: The operators that are known.
    """
    confirmed = [symptom for _, symptom in cases]
    waiting = [
        index for index, (_, symptom) in enumerate(cases) if symptom.kind not in _NOT_CONFIRMED
    ]
    for proposal in (_removals, _shifts):
        jobs = [
            (index, change)
            for index in waiting
            for change in proposal(scene, *cases[index], operators)
        ]
        judged = run_together(
            is_possible(
                change.scene,
                change.actions,
                seed,
                operators,
                has_motion=cases[index][1].kind is ReasonKind.MOTION,
            )
            for index, change in jobs
        )
        possible = {number for number, verdict in judged if verdict}
        for number, (index, change) in enumerate(jobs):
            if number in possible and index in waiting:
                confirmed[index] = change.reason
                waiting.remove(index)
    return confirmed
