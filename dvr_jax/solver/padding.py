"""Keyframe NLPs of few sizes: those with an odd number of phases get one more, which has no effect, before the first.

Compiling the program of an iteration takes seconds, and it is compiled for each number of phases. One call of it
evaluates as many slices whatever this number is, so that one more phase costs nothing as long as few NLPs are solved
together.

In the phase that is added the arms are at home, and all objects but one are absent. This object has the same mode
before and after the switch, so that the switch has no effect. The mode parameters of the phase are pinned to zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem, Variables

MULTIPLE = 2
"""Keyframe NLPs have a multiple of this number of phases."""

NO_CLEARANCE = -10.0
"""Clearance of bodies that may penetrate as deep as they like in the slice that is added [m]."""


def missing_phases(phases: int) -> int:
    """Return how many phases are added to a keyframe NLP with this number of phases."""
    return -phases % MULTIPLE


def pad_keyframes(problem: Problem, start: Variables) -> tuple[Problem, Variables]:
    """Return a keyframe NLP and its start with the phases that are missing.

    Args:
        problem: The NLP, without batch axes.
        start: A starting point of it.
    """
    for _ in range(missing_phases(len(start.m))):
        problem = _with_idle_phase(problem)
        home = np.asarray(problem.home)[None]
        q = np.concatenate([home, np.asarray(start.q)])
        m = np.concatenate([np.zeros_like(start.m[:1]), np.asarray(start.m)])
        start = Variables(q, m)
    return problem, start


def _with_idle_phase(problem: Problem) -> Problem:
    """Return the NLP with one more phase, before its first one."""
    kind = np.asarray(problem.mode_kind)
    parent = np.asarray(problem.mode_parent)
    action = np.asarray(problem.mode_action)

    # An object that no gripper holds, if there is one.
    item = int(np.argmax(kind[0] != ModeKind.HELD))
    idle = np.full_like(kind[0], ModeKind.ABSENT)
    idle[item] = kind[0, item]

    return problem._replace(
        regularization_target=_before(problem.home, problem.regularization_target),
        regularization_weight=_repeated(problem.regularization_weight),
        mode_kind=_before(idle, kind),
        mode_parent=_repeated(parent),
        mode_action=_repeated(action + 1),
        switched_object=_before(item, problem.switched_object),
        acting_arm=_repeated(problem.acting_arm),
        arm_at_rest=_zero_before(problem.arm_at_rest),
        straight_arm=_repeated(problem.straight_arm),
        straight_distance=_zero_before(problem.straight_distance),
        straight_kind=_repeated(problem.straight_kind),
        still_arm=_zero_before(problem.still_arm),
        finger_opening=_repeated(problem.finger_opening),
        on_support=_zero_before(problem.on_support),
        closing_yaw=_zero_before(problem.closing_yaw),
        parameter_lower=_zero_before(problem.parameter_lower),
        parameter_upper=_zero_before(problem.parameter_upper),
        preference=_zero_before(problem.preference),
        support=_zero_before(problem.support),
        inner_prism=_zero_before(problem.inner_prism),
        kept_clear=_zero_before(problem.kept_clear),
        top_object=_zero_before(problem.top_object),
        top_half=_zero_before(problem.top_half),
        phase_clearance=_repeated(problem.phase_clearance),
        clearance=_before(np.full(problem.clearance.shape[1:], NO_CLEARANCE), problem.clearance),
        sample_fraction=_repeated(problem.sample_fraction),
        sample_offset=_zero_before(problem.sample_offset),
    )


def _before(row: Any, rows: Any) -> np.ndarray:
    """Return an array with one more row before the first one."""
    rows = np.asarray(rows)
    return np.concatenate([np.asarray(row, rows.dtype)[None], rows])


def _repeated(rows: Any) -> np.ndarray:
    """Return an array with its first row twice."""
    return _before(np.asarray(rows)[0], rows)


def _zero_before(rows: Any) -> np.ndarray:
    """Return an array with a row of zeros before the first one."""
    return _before(np.zeros_like(np.asarray(rows)[0]), rows)
