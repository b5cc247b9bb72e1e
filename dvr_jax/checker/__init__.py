"""The independent check of a plan.

`check_motion` replays a motion in MuJoCo C and compares it with the actions that it claims to carry out. Nothing in
this package knows the planner: what operators, shapes and goals mean to the check is written here a second time, in
`operators`, `shapes` and `goals`.
"""

from dvr_jax.checker.goals import check_goal
from dvr_jax.checker.kinds import KINDS, FindingKind
from dvr_jax.checker.operators import CHECKS, OperatorCheck
from dvr_jax.checker.replay import check_motion
from dvr_jax.checker.report import CheckReport, Finding, FindingLog, describe
from dvr_jax.checker.shapes import ShapeCheck, register_shape_check
from dvr_jax.checker.tolerances import DEEPEST_CONTACT

__all__ = [
    "CHECKS",
    "DEEPEST_CONTACT",
    "KINDS",
    "CheckReport",
    "Finding",
    "FindingKind",
    "FindingLog",
    "OperatorCheck",
    "ShapeCheck",
    "check_goal",
    "check_motion",
    "describe",
    "register_shape_check",
]
