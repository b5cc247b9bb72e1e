"""Scenes whose goal holds from the start: their plan has no action, and its motion is a rest at home."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvr_jax.checker import OperatorCheck, check_motion
from dvr_jax.motion.motion import Motion, make_motion
from dvr_jax.motion.retiming import TIME_STEP
from dvr_jax.operators import Operator
from dvr_jax.planning.result import Plan
from dvr_jax.scene.layout import home_qpos
from dvr_jax.scene.start import goal_holds_at_start
from dvr_jax.scene.types import Scene
from dvr_jax.search.status import PlanStatus


def resting_plan(
    scene: Scene,
    operators: Sequence[Operator],
    checks: Sequence[OperatorCheck],
    options: dict[str, object],
) -> Plan | None:
    """Return the plan without any action, if the goal of a scene holds already and the check accepts a rest.

    Args:
        scene: The scene.
        operators: Operators of the plan.
        checks: The operators' counterparts in the independent check.
        options: Options of the plan.
    """
    if not goal_holds_at_start(scene):
        return None

    motion = resting_motion(scene)
    report = check_motion(scene, (), motion, checks)
    if not report.passed:
        return None

    return Plan(
        scene=scene,
        status=PlanStatus.SOLVED,
        actions=(),
        motion=motion,
        report=report,
        path=None,
        violations={},
        seconds={"total": 0.0},
        nlps={},
        verdicts={},
        rejected=0,
        options=options,
        operators=tuple(operators),
    )


def resting_motion(scene: Scene) -> Motion:
    """Return a motion of two samples in which all arms stay at home."""
    qpos = home_qpos(scene)
    return make_motion([0.0, TIME_STEP], np.stack([qpos, qpos]), np.zeros(0, dtype=np.int64))
