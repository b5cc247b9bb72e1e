"""Reasons: what keeps a sequence from being feasible, at which action, and by how much.

A reason is read off the best point that the optimizer found for the keyframes of a refuted prefix: the largest
violation there, as a multiple of its tolerance, names two bodies that penetrate, a pose that an arm misses, a joint
beyond its limit, or a footprint that extends beyond its region. Such a reason is a symptom, and its sentence says so:
"Closest approach found: ...". It is confirmed only by a changed scene (`dvr_jax.search.counterfactual`). Other reasons
need no optimization, because constants of the scene state them: a width against the opening of the gripper, or an
object beyond the reach of an arm. A width is confirmed from the start. A distance is only the least by which an arm
falls short, so that it has to be confirmed too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from dvr_jax.geometry.footprint import Circle, Rectangle, fits
from dvr_jax.goals import GOAL_REGION
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.evaluation import TOLERANCES
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.transcription import walk
from dvr_jax.operators import (
    Operator,
    Parameter,
    describe,
    lower_object_of,
    object_of,
    operator_of,
)
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.search.closest_bodies import deepest_contact
from dvr_jax.search.obstruction import obstructions
from dvr_jax.search.reach import base_distance, missing_reach
from dvr_jax.solver.lane_pool import NlpSolution


class ReasonKind(StrEnum):
    """What a reason is about; each member equals its text, which files hold."""

    WIDTH = "width"
    """An object is wider than the gripper opens, by the amount [m]."""

    SIZE = "size"
    """An object is too small for the margins of a grasp, by the amount [m]."""

    FOOTPRINT = "footprint"
    """An object extends beyond the region on which it is placed, by the amount [m]."""

    REACH = "reach"
    """An arm misses the pose that an action demands, by the amount [m]; negative if it is too near to the base."""

    COLLISION = "collision"
    """Two bodies come nearer to each other than their clearance allows, by the amount [m]."""

    JOINT = "joint"
    """A joint has to turn beyond its limit, by the amount [rad]."""

    ORIENTATION = "orientation"
    """An arm misses the orientation that an action demands, by the amount [rad]."""

    MOTION = "motion"
    """The switches of the actions are possible, but no motion between them was found, or the check refused it."""

    ACTIONS = "actions"
    """More actions are needed than are allowed, by the amount."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a sequence or a scene is refuted."""

    kind: ReasonKind
    """What it is about."""

    action: str
    """The action concerned, as text; empty if the reason concerns the whole scene."""

    bodies: tuple[str, ...]
    """The bodies concerned: names of objects and fixed bodies, "left hand", "table", "goal"."""

    amount: float
    """By how much, in the unit of the kind; NaN if that is not known."""

    sentence: str
    """The reason as a complete sentence."""

    confirmed: bool = True
    """Whether it is known that the actions are possible, as far as the bound that refuted them tells, once the scene is
    changed by what the reason states. If not, it is a condition that the actions violate, which may not be the only one
    ("at least 5 cm too far"), or only what the optimizer's best point shows ("Closest approach found")."""

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence


def static_reason(scene: Scene, action: Action, operators: Sequence[Operator]) -> Reason | None:
    """Return the reason for which a constant of the scene refutes an action, or None.

    Args:
        scene: A valid scene.
        action: One of its actions.
        operators: The operators that are known.
    """
    operator = operator_of(action, operators)
    text = operator.refute(scene, action)
    if text is None:
        return None
    item = scene.objects[scene.object_index(object_of(action, operators))]
    lower = lower_object_of(scene, action, operators)
    if lower is not None:
        sentence = f"The top of '{lower}' is too small for '{item.name}' to stand on it."
        return Reason(ReasonKind.FOOTPRINT, str(action), (item.name, lower), 0.0, sentence)
    if operator.mode_after != ModeKind.HELD:
        region = scene.region(action.arguments[-1]).footprint
        lacking = _lacking_room(item, region)
        sides = f"{centimeters(2 * region.half[0])} x {centimeters(2 * region.half[1])} cm"
        sentence = f"'{item.name}' is {outline(item)} cm; its region of {sides} is {centimeters(lacking)} cm too small."
        return Reason(
            ReasonKind.FOOTPRINT, str(action), (item.name, action.arguments[-1]), lacking, sentence
        )
    if Parameter.FACE in operator.parameters:
        face = operator.argument(action, Parameter.FACE)
        width = item.kind.grip_width(item.size, face)
        opening = scene.workcell.robot.maximum_opening
        if width > opening:
            sentence = (
                f"'{item.name}' is {centimeters(width)} cm wide at its {face} face; "
                f"the gripper opens {centimeters(opening)} cm."
            )
            return Reason(ReasonKind.WIDTH, str(action), (item.name,), width - opening, sentence)
    return Reason(
        ReasonKind.SIZE, str(action), (item.name,), math.nan, text[0].upper() + text[1:] + "."
    )


def reach_reason(
    scene: Scene, window: Sequence[Action | None], operators: Sequence[Operator]
) -> Reason | None:
    """Return the reason for which the last action of a window is out of reach, or None.

    Args:
        scene: A valid scene.
        window: Actions that follow each other on one object; None in the first place stands for the start.
        operators: The operators that are known.
    """
    missing = missing_reach(scene, window, operators)
    action = window[-1]
    if missing <= 0 or action is None:
        return None
    actions = [action for action in window if action is not None]
    _, switches = walk(scene, actions, (), operators)
    switch = switches[-1]
    item = scene.objects[switch.item]
    arm = scene.workcell.arms[switch.acting_arm]
    if switch.mode.kind == ModeKind.PLACED and switch.support is not None:
        place = np.asarray(switch.support.center)
        name = action.arguments[-1]
        what = target_words(scene, name)
    else:
        place = np.asarray(item.position)
        name = item.name
        what = f"'{name}'"
    far = base_distance(scene, switch.acting_arm, (float(place[0]), float(place[1])))
    sentence = (
        f"The {arm.name} arm does not reach {what}: it is {far:.2f} m from the base, "
        f"at least {centimeters(missing)} cm too far."
    )
    bodies = (f"{arm.name} arm", name)
    return Reason(ReasonKind.REACH, str(action), bodies, missing, sentence, confirmed=False)


def obstruction_reason(
    scene: Scene, action: Action, blocker: str, operators: Sequence[Operator]
) -> Reason:
    """Return the reason that an object stands where another one has to be placed.

    Args:
        scene: A valid scene.
        action: The action that places the object.
        blocker: Name of the object that is in the way.
        operators: The operators that are known.
    """
    name = object_of(action, operators)
    overlap = obstructions(scene, name, action.arguments[-1])[blocker]
    sentence = (
        f"'{blocker}' stands on {target_words(scene, action.arguments[-1])}: wherever '{name}' is placed there, "
        f"they overlap by at least {centimeters(overlap)} cm."
    )
    bodies = (name, blocker)
    return Reason(ReasonKind.COLLISION, str(action), bodies, overlap, sentence, confirmed=False)


NO_MOTION = "Keyframes exist, but no motion. "
"""Beginning of the sentence where no motion between the switches was found."""

APPROACH = "Closest approach found: "
"""Beginning of the sentence of a reason that is not confirmed."""


def as_symptom(reason: Reason) -> Reason:
    """Return a reason as one that is not confirmed, whose sentence says so."""
    text = reason.sentence
    return replace(reason, confirmed=False, sentence=APPROACH + text[0].lower() + text[1:])


def as_cause(reason: Reason) -> Reason:
    """Return a symptom as a confirmed reason, the inverse of `as_symptom`; what precedes the symptom stays."""
    before, found, text = reason.sentence.partition(APPROACH)
    sentence = before + text[0].upper() + text[1:] if found else reason.sentence
    return replace(reason, confirmed=True, sentence=sentence)


NAMED_PART = 0.2
"""Bodies are named if their penetration is at least this part of the distance by which a pose is missed."""


def evidence_reason(
    scene: Scene,
    actions: Sequence[Action],
    problem: Problem,
    solution: NlpSolution,
    operators: Sequence[Operator],
) -> Reason:
    """Return the symptom that the best point of an infeasible NLP shows, a reason that is not confirmed.

    Args:
        scene: A valid scene.
        actions: The actions of the NLP; a window's first one is over before the first slice.
        problem: The NLP.
        solution: The best point that was found.
        operators: The operators that are known.
    """
    return as_symptom(_largest_violation(scene, actions, problem, solution, operators))


def _largest_violation(
    scene: Scene,
    actions: Sequence[Action],
    problem: Problem,
    solution: NlpSolution,
    operators: Sequence[Operator],
) -> Reason:
    """Return the reason that the largest violation of a point states, as a share of its tolerance."""
    violations = solution.violations
    ratio = {name: value / TOLERANCES[name] for name, value in violations.items()}
    worst = max(ratio, key=lambda name: ratio[name])

    # A pose that is missed and bodies that penetrate often share one cause: the optimizer spreads a violation.
    # Bodies are named wherever they penetrate by a part of the violation that is not small.
    depth = violations.get("penetration", 0.0)
    is_penetrating = depth > TOLERANCES["penetration"]
    if is_penetrating and depth > NAMED_PART * violations.get("position", 0.0):
        return _collision_reason(scene, actions, problem, solution, operators)

    last = actions[-1]
    amount = violations[worst]
    doing = describe(last, operators)
    item = object_of(last, operators)
    arm = operator_of(last, operators).argument(last, Parameter.ARM)
    bodies = (f"{arm} arm", item)
    if worst == "footprint":
        sentence = f"When {doing}, it extends {centimeters(amount)} cm beyond its region."
        bodies = (item, last.arguments[-1])
        return Reason(ReasonKind.FOOTPRINT, str(last), bodies, amount, sentence)
    if worst == "on_top":
        sentence = f"When {doing}, its center is {centimeters(amount)} cm beyond the top of '{last.arguments[-1]}'."
        bodies = (item, last.arguments[-1])
        return Reason(ReasonKind.FOOTPRINT, str(last), bodies, amount, sentence)
    if worst == "kept_clear":
        sentence = (
            f"When {doing}, it covers {centimeters(amount)} cm of a region that has to be clear."
        )
        bodies = (item, last.arguments[-1])
        return Reason(ReasonKind.FOOTPRINT, str(last), bodies, amount, sentence)
    if worst == "joint_limit":
        return _joint_reason(scene, last, solution, operators)
    if worst == "rotation":
        angle = math.degrees(amount)
        sentence = f"When {doing}, the {arm} arm misses the orientation by {angle:.1f} degrees."
        return Reason(ReasonKind.ORIENTATION, str(last), bodies, amount, sentence)
    sentence = f"When {doing}, the {arm} arm falls {centimeters(amount)} cm short."
    return Reason(ReasonKind.REACH, str(last), bodies, amount, sentence)


def _collision_reason(
    scene: Scene,
    actions: Sequence[Action],
    problem: Problem,
    solution: NlpSolution,
    operators: Sequence[Operator],
) -> Reason:
    """Return the reason that two bodies penetrate at a slice."""
    slice_index, bodies, depth = deepest_contact(scene, problem, solution)
    action = actions[slice_index * len(actions) // len(solution.q)]
    sentence = (
        f"When {describe(action, operators)}, {bodies[0]} and {bodies[1]} "
        f"are {centimeters(depth)} cm too close."
    )
    return Reason(ReasonKind.COLLISION, str(action), bodies, depth, sentence)


def _joint_reason(
    scene: Scene, action: Action, solution: NlpSolution, operators: Sequence[Operator]
) -> Reason:
    """Return the reason that a joint has to turn beyond its limit."""
    index, excess = _worst_joint(scene, solution)
    arm, joint = divmod(index, scene.workcell.robot.number_of_joints)
    name = f"joint {joint + 1} of the {scene.workcell.arm_names[arm]} arm"
    angle = math.degrees(excess)
    doing = describe(action, operators)
    sentence = f"When {doing}, {name} turns {angle:.1f} degrees beyond its limit."
    return Reason(ReasonKind.JOINT, str(action), (name,), excess, sentence)


def _worst_joint(scene: Scene, solution: NlpSolution) -> tuple[int, float]:
    """Return the index of the joint that is farthest beyond its limit, and the excess [rad]."""
    low, high = np.tile(scene.workcell.robot.joint_limits, (1, scene.workcell.number_of_arms))
    excess = np.maximum(low - solution.q, solution.q - high).max(axis=0)
    index = int(np.argmax(excess))
    return index, float(excess[index])


def _lacking_room(item: SceneObject, region: Rectangle) -> float:
    """Return by how much both sides of a region have to grow until an object fits [m]."""
    low, high = 0.0, 2 * math.hypot(*item.half_extents)
    for _ in range(40):
        middle = (low + high) / 2
        sides = (2 * region.half[0] + middle, 2 * region.half[1] + middle)
        if fits(item.footprint, sides):
            high = middle
        else:
            low = middle
    return high


def outline(item: SceneObject) -> str:
    """Return the sides or the diameter of a footprint in words [cm]."""
    if isinstance(item.footprint, Circle):
        return f"{centimeters(2 * item.footprint.radius)}"
    return " x ".join(centimeters(2 * half) for half in item.footprint.half)


def target_words(scene: Scene, support: str) -> str:
    """Return how sentences call a support: the region of the paper's goal is the target."""
    if support == GOAL_REGION:
        return "the target"
    return f"the region '{support}'" if support in scene.region_names else f"the {support}"


def centimeters(length: float) -> str:
    """Return a length in centimeters."""
    text = f"{100 * length:.1f}"
    return text.removesuffix(".0")
