"""The constraints of the NLP in blocks, one file for each block; the tuple `CONSTRAINT_BLOCKS` contains all of them."""

from dvr_jax.nlp.blocks.block import (
    ConstraintBlock,
    ConstraintKind,
    Evaluation,
    EvaluationInput,
    Horizon,
    Measure,
    SwitchGeometry,
)
from dvr_jax.nlp.blocks.collision import COLLISION
from dvr_jax.nlp.blocks.footprint import FOOTPRINT
from dvr_jax.nlp.blocks.joint_limit import JOINT_LIMIT
from dvr_jax.nlp.blocks.kept_clear import KEPT_CLEAR
from dvr_jax.nlp.blocks.mode_switch import MODE_SWITCH
from dvr_jax.nlp.blocks.on_top import ON_TOP
from dvr_jax.nlp.blocks.parameter_bound import PARAMETER_BOUND
from dvr_jax.nlp.blocks.rest import REST
from dvr_jax.nlp.blocks.straight_motion import STRAIGHT_CORRIDOR, STRAIGHT_LINE

CONSTRAINT_BLOCKS: tuple[ConstraintBlock, ...] = (
    COLLISION,
    MODE_SWITCH,
    REST,
    JOINT_LIMIT,
    PARAMETER_BOUND,
    FOOTPRINT,
    KEPT_CLEAR,
    ON_TOP,
    STRAIGHT_LINE,
    STRAIGHT_CORRIDOR,
)
"""All constraint blocks, in the order in which their rows are stored."""

__all__ = [
    "COLLISION",
    "CONSTRAINT_BLOCKS",
    "FOOTPRINT",
    "JOINT_LIMIT",
    "KEPT_CLEAR",
    "MODE_SWITCH",
    "ON_TOP",
    "PARAMETER_BOUND",
    "REST",
    "STRAIGHT_CORRIDOR",
    "STRAIGHT_LINE",
    "ConstraintBlock",
    "ConstraintKind",
    "Evaluation",
    "EvaluationInput",
    "Horizon",
    "Measure",
    "SwitchGeometry",
]
