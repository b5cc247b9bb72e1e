"""The independent check as the public API offers it: for a motion of any origin and the actions that it carries out."""

from __future__ import annotations

from collections.abc import Sequence

from dvr_jax.checker import CHECKS, CheckReport, OperatorCheck
from dvr_jax.checker.replay import check_motion
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.planning.arguments import parse_actions, require_motion, require_scene
from dvr_jax.scene.types import Scene


def check(
    scene: Scene,
    actions: Sequence[Action | str],
    motion: Motion,
    checks: Sequence[OperatorCheck] = CHECKS,
    dynamics: bool = False,
) -> CheckReport:
    """Replay a motion in MuJoCo and report everything that is wrong with it.

    The check is independent: it shares no code with the optimizer. It is kinematic unless `dynamics` is set.

    Args:
        scene: Valid scene in whose initial state the motion starts.
        actions: Actions that the motion claims to carry out, as `Action` or as text such as "grasp(left, +x, yellow)";
            one for each switch of the motion.
        motion: States of the whole scene, sampled in time.
        checks: What the operators of the actions mean to the check.
        dynamics: Whether jerks and torques of the joints are checked as well, which about doubles the time.

    Returns:
        The verdict, and the findings with their times.

    Raises:
        OptionError: An argument has a wrong type.
        DvrError: The motion cannot be replayed: its arrays do not fit the scene, or its actions do not apply.
    """
    valid_scene = require_scene(scene)
    valid_actions = parse_actions("the list of actions", actions)
    valid_motion = require_motion(motion)

    return check_motion(valid_scene, valid_actions, valid_motion, checks, dynamics)
