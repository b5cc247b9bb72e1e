"""What has to hold at the end of a motion, by the type of the goal.

A further type of goal registers a function of its own::

    @check_goal.register
    def check_my_goal(goal: MyGoal, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None: ...
"""

from __future__ import annotations

from functools import singledispatch

from dvr_jax.checker.kinds import GOAL_HELD
from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.checker.supports import check_standing
from dvr_jax.errors import SceneError
from dvr_jax.goals import GOAL_SUPPORT, OnRegion


@singledispatch
def check_goal(goal: object, motion: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Check that a goal holds at the last sample of a motion.

    Args:
        goal: The goal; its type selects the check.
        motion: The replayed motion.
        timeline: Its intervals.
        log: Takes the findings.

    Raises:
        SceneError: No check is registered for goals of this type.
    """
    known = ", ".join(kind.__name__ for kind in check_goal.registry if kind is not object)
    raise SceneError(
        f"the check does not know goals of the type {type(goal).__name__}; it knows {known}."
    )


@check_goal.register
def check_on_region(
    goal: OnRegion, motion: ReplayedMotion, timeline: Timeline, log: FindingLog
) -> None:
    """Check that the goal's object stands on the region and that no arm holds it.

    Args:
        goal: The goal.
        motion: The replayed motion.
        timeline: Its intervals.
        log: Takes the findings.
    """
    index = motion.scene.object_index(goal.object)
    last = motion.last_sample

    holder = timeline.last(index).holder
    if holder is not None:
        names = (motion.object_label(index), motion.arm_name(holder))
        log.add(GOAL_HELD, last, names, 1.0, 0.0)

    check_standing(motion, index, GOAL_SUPPORT, last, log)
