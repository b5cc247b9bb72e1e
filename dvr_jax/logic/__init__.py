"""The symbolic layer: PDDL operators, their grounding to bit masks, states, goal and sequences. It has no arrays."""

from dvr_jax.logic.actions import Action, Fact
from dvr_jax.logic.domain import compose_domain, domain_signature, shipped_action
from dvr_jax.logic.errors import LogicError
from dvr_jax.logic.grounding import Grounding
from dvr_jax.logic.sequences import count_sequences, enumerate_sequences
from dvr_jax.logic.task import Task, ground_actions, ground_task

__all__ = [
    "Action",
    "Fact",
    "Grounding",
    "LogicError",
    "Task",
    "compose_domain",
    "count_sequences",
    "domain_signature",
    "enumerate_sequences",
    "ground_actions",
    "ground_task",
    "shipped_action",
]
