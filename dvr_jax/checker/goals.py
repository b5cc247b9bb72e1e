"""What has to hold at the end of a motion, by the type of the goal or of the fact of a goal.

A further type of goals or facts registers a function of its own::

    @check_goal.register
    def check_my_fact(fact: MyFact, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None: ...
"""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from dvr_jax.checker.kinds import GOAL_HELD, GOAL_NOT_HELD, GOAL_OFF_HAND
from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.shapes import shape_check_named
from dvr_jax.checker.supports import check_not_covering, check_standing
from dvr_jax.checker.tolerances import GRIP_TOLERANCE
from dvr_jax.errors import SceneError
from dvr_jax.goals import Clear, Goal, HandsEmpty, Holding, On, OnRegion


@singledispatch
def check_goal(goal: object, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that a goal or a fact holds at the last sample of a motion.

    Args:
        goal: The goal or the fact; its type selects the check.
        motion: The replayed motion.
        timeline: Its intervals.
        log: Takes the findings.

    Raises:
        SceneError: No check is registered for goals or facts of this type.
    """
    known = ", ".join(kind.__name__ for kind in check_goal.registry if kind is not object)
    raise SceneError(
        f"the check does not know goals of the type {type(goal).__name__}; it knows {known}."
    )


@check_goal.register
def check_on_region(
    goal: OnRegion, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
) -> None:
    """Check that the goal's object stands on the region and that no arm holds it."""
    check_facts(Goal(goal.facts), motion, timeline, log)


@check_goal.register
def check_facts(goal: Goal, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check all facts of a conjunction."""
    for fact in goal.facts:
        check_goal(fact, motion, timeline, log)


@check_goal.register
def check_on(fact: On, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that the object stands on the region or the other object, and that no arm holds one of the two."""
    index = motion.scene.object_index(fact.object)
    _check_released(index, motion, timeline, log)
    check_standing(motion, index, fact.support, motion.last_sample, log)
    if fact.support not in motion.scene.supports():
        _check_released(motion.scene.object_index(fact.support), motion, timeline, log)


@check_goal.register
def check_hands_empty(
    fact: HandsEmpty, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
) -> None:
    """Check that no arm holds any object."""
    for index in range(len(motion.scene.objects)):
        _check_released(index, motion, timeline, log)


@check_goal.register
def check_holding(
    fact: Holding, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
) -> None:
    """Check that the arm holds the object, and that the center of its gripper is within the object."""
    index = motion.scene.object_index(fact.object)
    arm = motion.scene.workcell.arm_names.index(fact.arm)
    last = motion.last_sample
    names = (motion.object_label(index), motion.arm_name(arm))
    if timeline.last(index).holder != arm:
        log.add(GOAL_NOT_HELD, last, names, 1.0, 0.0)

    item = motion.scene.objects[index]
    offset = motion.gripper_positions[last, arm] - motion.object_positions[last, index]
    point = motion.object_rotations[last, index].T @ offset
    distance = shape_check_named(item.shape).distance_outside(item.size, np.asarray(point))
    log.add(GOAL_OFF_HAND, last, names, distance, GRIP_TOLERANCE)


@check_goal.register
def check_clear(fact: Clear, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that no object covers any part of the region."""
    for index in range(len(motion.scene.objects)):
        check_not_covering(motion, index, fact.region, motion.last_sample, log)


def _check_released(
    index: int, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
) -> None:
    """Check that no arm holds an object at the end."""
    holder = timeline.last(index).holder
    if holder is not None:
        names = (motion.object_label(index), motion.arm_name(holder))
        log.add(GOAL_HELD, motion.last_sample, names, 1.0, 0.0)
