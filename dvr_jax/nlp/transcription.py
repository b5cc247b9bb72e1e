"""Transcription turns a scene and a sequence of actions into the arrays of a keyframe NLP, a `Problem`.

The operator of an action (`dvr_jax.operators`) defines its geometric meaning. This module applies the actions of a
sequence one after the other, keeps track of the modes of all objects, and stores the mode switches as arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Rectangle
from dvr_jax.logic import Action
from dvr_jax.modes.mode import PARAMETERS, ModeKind
from dvr_jax.nlp.blocks.straight_motion import StraightKind
from dvr_jax.nlp.body_clearances import PhasePart, body_clearances
from dvr_jax.nlp.problem import Problem
from dvr_jax.operators import (
    OPERATORS,
    ModeSwitch,
    ObjectMode,
    Operator,
    SkeletonState,
    operator_of,
    standing_mode,
)
from dvr_jax.scene.start import cleared_regions
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.workcell import base_positions, base_rotations

KEYFRAME_REGULARIZATION = 1e-2
"""Weight of the squared distance of keyframes from the home posture in the cost [1/rad^2]."""


def transcribe(
    scene: Scene,
    actions: Sequence[Action],
    ignored: Sequence[str] = (),
    operators: Sequence[Operator] = OPERATORS,
) -> Problem:
    """Write the keyframe NLP of a sequence as NumPy arrays without batch axes.

    Args:
        scene: A valid scene.
        actions: Actions that the logic allows one after the other; they need not reach the goal.
        ignored: Names of objects that are left out of the world (a relaxation); no action may use them.
        operators: The operators that are known.

    Raises:
        DvrError: There is no action, or one of an unknown operator.
    """
    if not actions:
        raise DvrError("there is no action to transcribe; a sequence has at least one.")
    states, switches = walk(scene, actions, ignored, operators)
    number = len(actions)
    arms = range(scene.workcell.number_of_arms)
    home = np.array(scene.home, dtype=float).reshape(-1)
    clearance = body_clearances(scene, states, switches)
    straight = _straight_motions(scene, states, switches)

    return Problem(
        prism=_floats([item.kind.prism(item.size) for item in scene.objects], 4),
        initial_pose=_floats([(*scene.center_of(item), item.yaw) for item in scene.objects], 4),
        fixed_prism=_floats([body.kind.prism(body.size) for body in scene.fixed], 4),
        fixed_pose=_floats([(*body.position, body.yaw) for body in scene.fixed], 4),
        base_rotation=base_rotations(scene.workcell),
        base_position=base_positions(scene.workcell),
        home=home,
        regularization_target=np.tile(home, (number, 1)),
        regularization_weight=np.full((number, len(home)), KEYFRAME_REGULARIZATION),
        mode_kind=np.array([[mode.kind for mode in state.modes] for state in states], np.int32),
        mode_parent=np.array([[mode.parent for mode in state.modes] for state in states], np.int32),
        mode_action=_mode_actions(switches, len(scene.objects)),
        switched_object=np.array([switch.item for switch in switches], np.int32),
        acting_arm=np.array([switch.acting_arm for switch in switches], np.int32),
        arm_at_rest=_floats(
            [[float(arm in switch.arms_at_rest) for arm in arms] for switch in switches], len(arms)
        ),
        straight_arm=straight.arm,
        straight_distance=straight.distance,
        straight_kind=straight.kind,
        still_arm=straight.still,
        finger_opening=_floats([state.finger_opening for state in states], len(arms)),
        on_support=np.array([float(switch.support is not None) for switch in switches]),
        closing_yaw=np.array([switch.closing_yaw for switch in switches]),
        parameter_lower=_floats([switch.lower for switch in switches], PARAMETERS),
        parameter_upper=_floats([switch.upper for switch in switches], PARAMETERS),
        preference=_floats([switch.preference for switch in switches], PARAMETERS),
        preference_scale=np.zeros(()),
        support=_floats([_support_numbers(switch.support) for switch in switches], 5),
        inner_prism=_floats([switch.inner_prism for switch in switches], 4),
        kept_clear=_kept_clear(switches, len(cleared_regions(scene))),
        phase_clearance=clearance,
        clearance=clearance[:-1, PhasePart.END],
        sample_fraction=np.ones((number, 1)),
        sample_offset=np.zeros((number, 1, len(home))),
    )


class _StraightMotions(NamedTuple):
    """The straight motions of a sequence: in each phase one that leaves a switch (0) and one that comes to one (1)."""

    arm: Int[np.ndarray, "phases 2"]
    """The arm that moves."""

    distance: Float[np.ndarray, "phases 2"]
    """Least length [m]; 0 where there is no such motion."""

    kind: Int[np.ndarray, "phases 2"]
    """`StraightKind` of the motion."""

    still: Float[np.ndarray, "phases 2 arms"]
    """1 for an arm that holds the object meanwhile."""


def _straight_motions(
    scene: Scene, states: Sequence[SkeletonState], switches: Sequence[ModeSwitch]
) -> _StraightMotions:
    """Return the straight motions before and after each switch.

    A hand comes straight to an object that it grasps, and leaves straight an object that it has released. An object is
    lifted from its support after its grasp, and lowered before it is placed.
    """
    K = len(switches)
    found = _StraightMotions(
        np.zeros((K, 2), np.int32),
        np.zeros((K, 2)),
        np.full((K, 2), StraightKind.APPROACH, np.int32),
        np.zeros((K, 2, scene.workcell.number_of_arms)),
    )
    leaves, comes = 0, 1
    clearances = scene.workcell.clearances
    lengths = {
        StraightKind.APPROACH: clearances.approach,
        StraightKind.VERTICAL: clearances.lift,
    }

    def add(phase: int, motion: int, arm: int, kind: StraightKind) -> None:
        found.arm[phase, motion] = arm
        found.distance[phase, motion] = lengths[kind]
        found.kind[phase, motion] = kind

    for k, switch in enumerate(switches):
        old = states[k].modes[switch.item]
        new = states[k + 1].modes[switch.item]
        was_held = old.kind == ModeKind.HELD
        is_held = new.kind == ModeKind.HELD

        # Before the switch, the hand that grasps comes to the object, or the hand that holds it lowers it.
        if is_held:
            add(k, comes, new.parent, StraightKind.APPROACH)
        elif was_held:
            add(k, comes, old.parent, StraightKind.VERTICAL)

        # After it, the hand that released the object leaves it, or the hand that grasped it lifts it.
        if k + 1 < K and was_held:
            add(k + 1, leaves, old.parent, StraightKind.APPROACH)
        elif k + 1 < K and is_held:
            add(k + 1, leaves, new.parent, StraightKind.VERTICAL)

        # At a handover, the other hand holds still.
        if was_held and is_held:
            found.still[k, comes, old.parent] = 1
            if k + 1 < K:
                found.still[k + 1, leaves, new.parent] = 1
    return found


def walk(
    scene: Scene, actions: Sequence[Action], ignored: Sequence[str], operators: Sequence[Operator]
) -> tuple[list[SkeletonState], list[ModeSwitch]]:
    """Apply the actions of a sequence one after the other, and return all states and mode switches.

    Args:
        scene: A valid scene.
        actions: The sequence.
        ignored: Names of objects that are left out of the world.
        operators: The operators that are known.

    Returns:
        The K + 1 states before, between and after the K actions, and the K switches.
    """
    modes = tuple(
        ObjectMode(ModeKind.ABSENT) if item.name in ignored else standing_mode(scene, item)
        for item in scene.objects
    )
    opening = (scene.workcell.robot.finger_travel,) * scene.workcell.number_of_arms
    states = [SkeletonState(scene, modes, opening)]
    switches: list[ModeSwitch] = []

    for action in actions:
        switch = operator_of(action, operators).switch(states[-1], action)
        switches.append(switch)
        after = list(states[-1].modes)
        after[switch.item] = switch.mode
        states.append(SkeletonState(scene, tuple(after), switch.finger_opening))
    return states, switches


def transcribe_switch(
    scene: Scene,
    before: Action,
    action: Action,
    ignored: Sequence[str] = (),
    operators: Sequence[Operator] = OPERATORS,
) -> Problem:
    """Write the keyframe NLP of one action alone, before which an earlier action left the object in a gripper.

    This is `transcribe_window` for a single action.

    Args:
        scene: A valid scene.
        before: The action that leaves the object in a gripper.
        action: The next action on the same object.
        ignored: Names of objects left out of the world.
        operators: The operators that are known.
    """
    return transcribe_window(scene, before, [action], ignored, operators)


def transcribe_window(
    scene: Scene,
    before: Action,
    actions: Sequence[Action],
    ignored: Sequence[str] = (),
    operators: Sequence[Operator] = OPERATORS,
) -> Problem:
    """Write the keyframe NLP of actions on one object, before which an earlier action left it in a gripper.

    This is a relaxation of all sequences in which the actions follow `before` as the next ones on their object. The
    object may be held with any mode parameters within the bounds of `before`. The NLP of K actions has K + 1 slices. In
    the first one all other objects are absent and the object is held already, so that there is no switch.

    Args:
        scene: A valid scene.
        before: The action that leaves the object in a gripper.
        actions: The next actions on the same object.
        ignored: Names of objects left out of the world.
        operators: The operators that are known.
    """
    problem = transcribe(scene, [before, *actions], ignored, operators)

    # The switched object is held in phase 0 as in phase 1, and all others are absent in phase 0.
    item = problem.switched_object[0]
    kind = np.array(problem.mode_kind)
    parent = np.array(problem.mode_parent)
    kind[0] = ModeKind.ABSENT
    kind[0, item] = kind[1, item]
    parent[0, item] = parent[1, item]
    return problem._replace(mode_kind=kind, mode_parent=parent)


def _floats(rows: Sequence[Sequence[float]], width: int) -> Float[np.ndarray, "rows width"]:
    """Return rows of numbers as a two-dimensional array, even if there are no rows."""
    return np.array(rows, dtype=float).reshape(len(rows), width)


def _mode_actions(switches: Sequence[ModeSwitch], number_of_objects: int) -> np.ndarray:
    """Return `Problem.mode_action` (K + 1, N): the last action that switched each object before each phase."""
    rows = np.zeros((len(switches) + 1, number_of_objects), np.int32)
    for k, switch in enumerate(switches):
        rows[k + 1 :, switch.item] = k
    return rows


def _kept_clear(
    switches: Sequence[ModeSwitch], number: int
) -> Float[np.ndarray, "phases regions 5"]:
    """Return `Problem.kept_clear`, with zeros in the place of regions that an action may cover."""
    rows = np.zeros((len(switches), number, 5))
    for k, switch in enumerate(switches):
        for index, area in enumerate(switch.kept_clear):
            rows[k, index] = _support_numbers(area)
    return rows


def _support_numbers(support: Rectangle | None) -> tuple[float, ...]:
    """Return center x, y, yaw and half extents of a support, or zeros without one."""
    if support is None:
        return (0.0,) * 5
    return (*support.center, support.yaw, *support.half)
