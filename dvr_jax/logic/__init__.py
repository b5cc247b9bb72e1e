"""The symbolic layer: `domain.pddl`, its grounding to bit masks, states, goal and action sequences. No arrays here."""

from dvr_jax.logic.domain import domain_signature
from dvr_jax.logic.errors import LogicError
from dvr_jax.logic.grounding import Action, Fact, Grounding
from dvr_jax.logic.sequences import count_sequences, enumerate_sequences
from dvr_jax.logic.task import ARMS, FACES, OBJECT_ARGUMENT, describe, ground_actions, object_of

__all__ = [
    "ARMS",
    "FACES",
    "OBJECT_ARGUMENT",
    "Action",
    "Fact",
    "Grounding",
    "LogicError",
    "count_sequences",
    "describe",
    "domain_signature",
    "enumerate_sequences",
    "ground_actions",
    "object_of",
]
