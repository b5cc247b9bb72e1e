"""What the operators mean to the check, one file each, apart from the planner's operators."""

from dvr_jax.checker.operators.grasp import GRASP_CHECK
from dvr_jax.checker.operators.operator import (
    Attachment,
    AttachmentInterval,
    Held,
    Moving,
    OperatorCheck,
    Standing,
    Timeline,
)
from dvr_jax.checker.operators.parameter import (
    ARM,
    FACE,
    OBJECT,
    SUPPORT,
    Arguments,
    Parameter,
)
from dvr_jax.checker.operators.place import PLACE_CHECK

CHECKS: tuple[OperatorCheck, ...] = (GRASP_CHECK, PLACE_CHECK)
"""The operators of this package."""

__all__ = [
    "ARM",
    "CHECKS",
    "FACE",
    "GRASP_CHECK",
    "OBJECT",
    "PLACE_CHECK",
    "SUPPORT",
    "Arguments",
    "Attachment",
    "AttachmentInterval",
    "Held",
    "Moving",
    "OperatorCheck",
    "Parameter",
    "Standing",
    "Timeline",
]
