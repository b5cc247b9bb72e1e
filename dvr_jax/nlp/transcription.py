"""From symbols to arrays: a scene and a sequence of actions become one `Problem`.

What an operator means geometrically is registered here by its name in the domain (`OPERATORS`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import fits
from dvr_jax.logic import ARMS, FACES, Action
from dvr_jax.nlp.problem import ABSENT, FIXED, HELD_LEFT, HELD_RIGHT, PARAMETERS, PLACED, Problem
from dvr_jax.nlp.tolerances import POSITION_TOLERANCE
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.workcell.constants import FINGER_OPEN, MAXIMUM_OPENING, TABLE_HALF_EXTENTS

GRASP_MARGIN = 0.01
"""How far inside the object the gripper's centre stays [m]."""

ATTRACTION = 1e-2
"""Weight of the pull of keyframes to the home posture [1/rad^2]."""

PITCH_LIMIT = 2.2
"""Largest tilt of the approach from straight down, either way [rad]: past the horizontal, as handovers need."""

_FREE = 1e3
"""Stands for no bound: finite, so that no arithmetic yields NaN."""


@dataclass(slots=True)
class _Draft:
    """A problem while its actions are transcribed one after the other."""

    scene: Scene
    attachment: list[list[int]]
    attached_by: list[list[int]]
    switched: list[int] = field(default_factory=list)
    resting: list[list[float]] = field(default_factory=list)
    is_grasp: list[float] = field(default_factory=list)
    face_yaw: list[float] = field(default_factory=list)
    lower: list[list[float]] = field(default_factory=list)
    upper: list[list[float]] = field(default_factory=list)
    support: list[list[float]] = field(default_factory=list)
    grip: list[list[float]] = field(default_factory=list)
    """Finger openings of both arms in each phase."""


def grip_width(item: SceneObject, face: str) -> float:
    """Extent of an object along the closing axis when it is grasped at this face [m]."""
    if item.shape == "cylinder":
        return 2 * item.size[0]
    return item.size[0] if FACES.index(face) % 2 == 0 else item.size[1]


def refute(scene: Scene, action: Action) -> str | None:
    """Why an action cannot be done whatever the motion (a constant of the scene), or None."""
    if action.operator != "grasp":
        _, name, support = action.arguments
        width, depth = scene.goal.region.size
        spare = 2 * POSITION_TOLERANCE  # a footprint may stick out as far
        footprint = scene.objects[scene.object_index(name)].footprint
        if support == "goal" and not fits(footprint, (width + spare, depth + spare)):
            return f"{name} does not fit on the goal region of {100 * width:.1f} x {100 * depth:.1f} cm"
        return None
    _, face, name = action.arguments
    item = scene.objects[scene.object_index(name)]
    width = grip_width(item, face)
    if width > MAXIMUM_OPENING:
        widest = f"the gripper opens {100 * MAXIMUM_OPENING:.0f} cm"
        return f"{name} is {100 * width:.1f} cm wide at its {face} face, {widest}"
    if min(_grasp_room(item, face)) < 0:
        return f"{name} is too small to hold the gripper's centre with its margin of {100 * GRASP_MARGIN:.0f} cm"
    return None


def is_duplicate(scene: Scene, action: Action) -> bool:
    """Whether an action is the same as another one by another name: a cylinder's faces are not distinguished, and a
    grasp at +x, whose yaw is free, stands for all four."""
    if action.operator != "grasp":
        return False
    _, face, name = action.arguments
    return scene.objects[scene.object_index(name)].shape == "cylinder" and face != FACES[0]


def _grasp_room(item: SceneObject, face: str) -> tuple[float, float]:
    """Half ranges of the gripper's centre along the face's tangent and along the object's axis [m]."""
    half = item.half_extents
    tangent = half[1] if FACES.index(face) % 2 == 0 else half[0]
    # A radial closing axis passes through a cylinder's own: no room beside it.
    along = 0.0 if item.shape == "cylinder" else tangent - GRASP_MARGIN
    return min(along, tangent - GRASP_MARGIN), half[2] - GRASP_MARGIN


def _transcribe_grasp(draft: _Draft, action: Action) -> None:
    arm_name, face, name = action.arguments
    arm, n = ARMS.index(arm_name), draft.scene.object_index(name)
    item = draft.scene.objects[n]
    giver = draft.attachment[-1][n]
    resting = [0.0, 0.0]
    resting[arm] = 1.0
    if giver >= HELD_LEFT:
        resting[giver - HELD_LEFT] = 1.0
    tangent, height = _grasp_room(item, face)
    yaw_room = _FREE if item.shape == "cylinder" else 0.0
    _switch(draft, n, (HELD_LEFT, HELD_RIGHT)[arm], resting)
    draft.is_grasp.append(1.0)
    draft.face_yaw.append(FACES.index(face) * math.pi / 2)
    draft.lower.append([-tangent, -height, -PITCH_LIMIT, -yaw_room])
    draft.upper.append([tangent, height, PITCH_LIMIT, yaw_room])
    draft.support.append([0.0] * 5)
    grip = list(draft.grip[-1])
    if giver >= HELD_LEFT:
        grip[giver - HELD_LEFT] = FINGER_OPEN
    grip[arm] = grip_width(item, face) / 2
    draft.grip.append(grip)


def _transcribe_place(draft: _Draft, action: Action) -> None:
    arm_name, name, support = action.arguments
    arm, n = ARMS.index(arm_name), draft.scene.object_index(name)
    resting = [0.0, 0.0]
    resting[arm] = 1.0
    _switch(draft, n, PLACED, resting)
    draft.is_grasp.append(0.0)
    draft.face_yaw.append(0.0)
    if support == "table":
        rectangle = [0.0, 0.0, 0.0, *TABLE_HALF_EXTENTS]
    else:
        region = draft.scene.goal.region
        rectangle = [*region.position, region.yaw, region.size[0] / 2, region.size[1] / 2]
    draft.lower.append([-_FREE, -_FREE, -_FREE, 0.0])
    draft.upper.append([_FREE, _FREE, _FREE, 0.0])
    draft.support.append(rectangle)
    grip = list(draft.grip[-1])
    grip[arm] = FINGER_OPEN
    draft.grip.append(grip)


OPERATORS: dict[str, Callable[[_Draft, Action], None]] = {"grasp": _transcribe_grasp, "place": _transcribe_place}
"""Geometric meaning of each operator of the domain: the mode switch that it makes, its mode parameters and their
bounds."""


def _switch(draft: _Draft, n: int, attachment: int, resting: list[float]) -> None:
    k = len(draft.switched)
    draft.attachment.append([*draft.attachment[-1]])
    draft.attached_by.append([*draft.attached_by[-1]])
    draft.attachment[-1][n], draft.attached_by[-1][n] = attachment, k
    draft.switched.append(n)
    draft.resting.append(resting)


def transcribe(scene: Scene, actions: Sequence[Action], ignored: Sequence[str] = ()) -> Problem:
    """The keyframe NLP of a sequence as NumPy arrays (no batch axes).

    Args:
        actions: applicable one after the other (the logic sees to that); they need not reach the goal.
        ignored: objects left out of the world (a relaxation); no action may use them.
    """
    if not actions:
        raise DvrError("there is no action to transcribe; a sequence has at least one.")
    N = len(scene.objects)
    start = [ABSENT if item.name in ignored else FIXED for item in scene.objects]
    draft = _Draft(scene, [start], [[0] * N], grip=[[FINGER_OPEN, FINGER_OPEN]])
    for action in actions:
        if action.operator not in OPERATORS:
            known = ", ".join(OPERATORS)
            raise DvrError(f"operator '{action.operator}' has no geometric meaning; registered: {known}.")
        OPERATORS[action.operator](draft, action)
    half = [
        (0, 0, item.height / 2, item.size[0]) if item.shape == "cylinder" else (*item.half_extents, 0)
        for item in scene.objects
    ]
    assert len(draft.lower[0]) == PARAMETERS

    def floats(values: Sequence[object]) -> np.ndarray:
        return np.array(values, dtype=float)

    return Problem(
        half=floats(half),
        initial_pose=floats([(*item.center, item.yaw) for item in scene.objects]),
        home=floats(scene.home).reshape(-1),
        reference=np.tile(floats(scene.home).reshape(-1), (len(actions), 1)),
        attraction=np.full((len(actions), 14), ATTRACTION),
        attachment=np.array(draft.attachment, np.int32),
        attached_by=np.array(draft.attached_by, np.int32),
        switched_object=np.array(draft.switched, np.int32),
        resting=floats(draft.resting),
        opening=floats(draft.grip),
        is_grasp=floats(draft.is_grasp),
        face_yaw=floats(draft.face_yaw),
        lower=floats(draft.lower),
        upper=floats(draft.upper),
        support=floats(draft.support),
        share=np.ones((len(actions), 1)),
        offset=np.zeros((len(actions), 1, 14)),
    )


def transcribe_switch(scene: Scene, before: Action, action: Action, ignored: Sequence[str] = ()) -> Problem:
    """The keyframe NLP of an action alone, its object being held as an earlier grasp says: a relaxation of all
    sequences in which the action follows that grasp as the next one on its object.

    How the object came to be held is free: the first of the two slices is empty but for what the gripper holds, and
    nothing is switched there."""
    problem = transcribe(scene, [before, action], ignored)
    attachment = problem.attachment.copy()
    item = problem.switched_object[0]
    attachment[0] = ABSENT
    attachment[0, item] = attachment[1, item]
    return problem._replace(attachment=attachment)
