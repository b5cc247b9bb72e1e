"""Add an action operator: a hand with closed fingers holds an object by its top face, as a suction cup does.

Everything that a planner has to know of the operator stands in this file: its PDDL text, its geometry, its proposals,
and its half in the independent check. Nothing in the package changes. With it, objects that are too wide for the
gripper can be moved; the script plans such a scene.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

import dvr_jax as dvr
from dvr_jax.checker import CHECKS, FindingKind, FindingLog, OperatorCheck
from dvr_jax.checker.operators import ARM, OBJECT, Arguments, AttachmentInterval, Held, Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.geometry.arrays import Array
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators import ModeSwitch, ObjectMode, Operator, Parameter, SkeletonState
from dvr_jax.operators.grasp import propose_grasp
from dvr_jax.operators.operator import FREE
from dvr_jax.operators.proposal import BeamStep, ObjectBefore, Proposal, ProposedPoses
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.types import Scene

STAND_OFF = 0.0165
"""Height of the gripper's center above the top face [m]: the capsules of the fingers reach 15.3 mm beyond the
center."""

MARGIN = 0.01
"""How far inside the top face the gripper's center stays [m]."""

PDDL = """
; The arm's hand is empty, and nobody holds the object.
(:action suction
  :parameters (?arm - arm ?item - movable)
  :precondition (and
    (forall (?held - movable) (not (holding ?arm ?held)))
    (forall (?other - arm) (not (holding ?other ?item))))
  :effect (and
    (forall (?support - support) (not (on ?item ?support)))
    (holding ?arm ?item)))
"""


def _room(scene: Scene, action: Action) -> float:
    """Half range of the gripper's center on the top face, along any direction [m]."""
    item = scene.objects[scene.object_index(action.arguments[1])]
    return min(item.half_extents[:2]) - MARGIN


def _refute(scene: Scene, action: Action) -> str | None:
    if _room(scene, action) < 0:
        return f"the top face of {action.arguments[1]} is too small"
    return None


def _switch(state: SkeletonState, action: Action) -> ModeSwitch:
    scene = state.scene
    arm_name, name = action.arguments
    arm = scene.workcell.arm_index(arm_name)
    room = max(_room(scene, action), 0.0)
    height = scene.objects[scene.object_index(name)].half_extents[2] + STAND_OFF
    opening = list(state.finger_opening)
    opening[arm] = 0.0
    return ModeSwitch(
        item=scene.object_index(name),
        acting_arm=arm,
        arms_at_rest=frozenset({arm}),
        mode=ObjectMode(ModeKind.HELD, arm),
        # Tangent and yaw are free; height and pitch are pinned: straight from above.
        lower=(-room, height, 0.0, -FREE),
        upper=(room, height, 0.0, FREE),
        finger_opening=tuple(opening),
    )


@Program
def propose_suction(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Propose grasps within the bounds of the mode parameters, which say all that is special here."""
    return propose_grasp(step, before, u)


# The operator, as the planner takes it.
SUCTION = Operator(
    name="suction",
    parameters=(Parameter.ARM, Parameter.OBJECT),
    pddl=PDDL,
    phrase="{0} lifts {1} by its top face",
    mode_after=ModeKind.HELD,
    refute=_refute,
    is_duplicate=lambda scene, action: False,
    switch=_switch,
    proposal=lambda before: Proposal("suction", propose_suction, sibling_penalty=0.01),
)

# What the independent check can find. It computes each quantity from the replayed motion alone, without the optimizer.
BESIDE = FindingKind(
    "suction center", "the center of the {1} gripper is {value} off the top face of {0}", "mm"
)
TILT = FindingKind(
    "suction tilt", "the approach of {1} is tilted by {value} against the axis of {0}", "mrad"
)
FINGERS = FindingKind(
    "suction fingers", "the {1} gripper holds {0} with its fingers {value} open", "mm"
)


def _refusal(arguments: Arguments, holding: Mapping[str, str]) -> str:
    if arguments["arm"] in holding:
        return f"{arguments['arm']} holds an object."
    if arguments["object"] in holding.values():
        return f"{arguments['object']} is held; only what stands can be lifted."
    return ""


def _attachment(scene: Scene, arguments: Arguments) -> Held:
    return Held(scene.workcell.arm_index(arguments["arm"]))


def _check(
    motion: ReplayedMotion, timeline: Timeline, interval: AttachmentInterval, log: FindingLog
) -> None:
    arm = motion.scene.workcell.arm_index(interval.arguments["arm"])
    names = (motion.object_label(interval.object), motion.arm_name(arm))
    half = np.array(motion.scene.objects[interval.object].size) / 2

    to_object = motion.object_rotations[interval.start, interval.object].T
    offset = (
        motion.gripper_positions[interval.start, arm]
        - motion.object_positions[interval.start, interval.object]
    )
    center = to_object @ offset
    beside = np.maximum(np.abs(center[:2]) - half[:2], 0.0)
    above = max(abs(center[2] - half[2] - 0.01) - 0.01, 0.0)
    log.add(BESIDE, interval.start, names, float(np.linalg.norm([*beside, above])), 1e-3)

    approach = to_object @ motion.gripper_rotations[interval.start, arm][:, 2]
    log.add(
        TILT, interval.start, names, float(np.arctan2(np.hypot(*approach[:2]), -approach[2])), 0.02
    )

    # The fingers may open just before the interval ends, once the action that ends it has secured the object.
    travels = motion.finger_travels(arm).max(axis=1)
    following = timeline.after(interval)
    if following is not None:
        travels = np.where(following.operator.secured(motion, following), 0.0, travels)
    log.add_worst(FINGERS, interval.start, names, travels[interval.start : interval.end], 1e-3)


SUCTION_CHECK = OperatorCheck("suction", (ARM, OBJECT), _refusal, _attachment, _check)
"""The half in the independent check."""


def main() -> None:
    """Plan a box that no gripper can grasp, first without and then with the operator."""
    crate = dvr.SceneObject("crate", "box", (0.10, 0.12, 0.08), (-0.35, 0.25), yaw=0.4)
    goal = dvr.OnRegion("crate", dvr.Region((-0.35, -0.25), yaw=0.2, size=(0.2, 0.2)))
    scene = dvr.Scene((crate,), goal)

    refused = dvr.plan(scene, "mbts", k_max=2, time_limit=600)
    print("without suction:", refused.status)

    found = dvr.plan(
        scene,
        "mbts",
        k_max=2,
        time_limit=600,
        operators=(*dvr.OPERATORS, SUCTION),
        checks=(*CHECKS, SUCTION_CHECK),
    )
    print("with suction:", found.status, *found.action_descriptions, sep="\n  ")


if __name__ == "__main__":
    main()
