"""The symbolic layer: PDDL operators, their grounding to bit masks, states, goal and sequences. It has no arrays."""

from dvr_jax.logic.actions import Action, Fact
from dvr_jax.logic.domain import compose_domain, domain_signature
from dvr_jax.logic.errors import LogicError
from dvr_jax.logic.grounding import Grounding
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
    "compose_domain",
    "count_sequences",
    "describe",
    "domain_signature",
    "enumerate_sequences",
    "ground_actions",
    "object_of",
]
