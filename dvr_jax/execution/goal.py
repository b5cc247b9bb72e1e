"""Whether a goal holds in a state that physics has reached.

The check's own rules decide (`dvr_jax.checker.goals`), with the wider limits that an executed plan needs.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.goals import check_goal
from dvr_jax.checker.kinds import (
    GOAL_OFF_HAND,
    OFF_TOP,
    REGION_COVERED,
    SUPPORT_HEIGHT,
    SUPPORT_OVERHANG,
    SUPPORT_TILT,
)
from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import FindingLog
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.mjcf import build_model, object_body_name
from dvr_jax.scene.types import Scene

LIMITS = {
    SUPPORT_TILT.name: 0.1,
    SUPPORT_HEIGHT.name: 5e-3,
    SUPPORT_OVERHANG.name: 5e-3,
    OFF_TOP.name: 5e-3,
    REGION_COVERED.name: 5e-3,
    GOAL_OFF_HAND.name: 5e-3,
}
"""Largest tilt [rad], largest height above the support, overhang over the region's edge, distance of a center beyond
the part of a top that carries it (it is still over the top then), depth in a region that has to be clear, and distance
of the gripper's center from a held object [m]."""


def goal_holds(scene: Scene, timeline: Timeline, state: Float[np.ndarray, " nq"]) -> bool:
    """Tell whether a scene's goal holds in a state.

    Args:
        scene: The scene.
        timeline: Intervals of the executed plan, which tell whether an object is still held at its end.
        state: The state.
    """
    model = build_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = state
    mujoco.mj_kinematics(model, data)

    bodies = [model.body(object_body_name(item.name)).id for item in scene.objects]
    sites = [model.site(f"{arm}/gripper").id for arm in scene.workcell.arm_names]
    still = ReplayedMotion(
        scene=scene,
        motion=Motion(np.zeros(1), state[None], np.zeros(0, int)),
        object_positions=data.xpos[None, bodies],
        object_rotations=data.xmat.reshape(-1, 3, 3)[None, bodies],
        gripper_positions=data.site_xpos[None, sites],
        gripper_rotations=data.site_xmat.reshape(-1, 3, 3)[None, sites],
    )
    log = FindingLog(np.zeros(1))
    check_goal(scene.goal, still, timeline, log)
    return all(finding.value <= LIMITS.get(finding.kind, 0.0) for finding in log.findings())
