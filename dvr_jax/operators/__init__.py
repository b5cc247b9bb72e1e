"""Action operators, one file each; the ordered tuple `OPERATORS` drives everything that depends on them."""

from dvr_jax.operators.grasp import GRASP
from dvr_jax.operators.grounding import OPERATORS, ground_scene
from dvr_jax.operators.operator import (
    NO_BODY,
    ModeSwitch,
    ObjectMode,
    Operator,
    Parameter,
    SkeletonState,
    describe,
    is_duplicate,
    object_of,
    operator_of,
    refute,
    standing_mode,
)
from dvr_jax.operators.place import PLACE

__all__ = [
    "GRASP",
    "NO_BODY",
    "OPERATORS",
    "PLACE",
    "ModeSwitch",
    "ObjectMode",
    "Operator",
    "Parameter",
    "SkeletonState",
    "describe",
    "ground_scene",
    "is_duplicate",
    "object_of",
    "operator_of",
    "refute",
    "standing_mode",
]
