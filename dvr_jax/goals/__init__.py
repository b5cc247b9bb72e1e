"""Goals of scenes: conjunctions of facts, one file for each type of facts."""

from dvr_jax.goals.clear import Clear
from dvr_jax.goals.fact import (
    EndCondition,
    GoalFact,
    GoalWorld,
    field_names,
    known_facts,
    make_fact,
    register_fact,
    words_of,
)
from dvr_jax.goals.goal import Goal
from dvr_jax.goals.hands_empty import HandsEmpty
from dvr_jax.goals.holding import Holding
from dvr_jax.goals.on import On
from dvr_jax.goals.on_region import OnRegion
from dvr_jax.goals.region import GOAL_REGION, TABLE, Inside, Region

__all__ = [
    "GOAL_REGION",
    "TABLE",
    "Clear",
    "EndCondition",
    "Goal",
    "GoalFact",
    "GoalWorld",
    "HandsEmpty",
    "Holding",
    "Inside",
    "On",
    "OnRegion",
    "Region",
    "field_names",
    "known_facts",
    "make_fact",
    "register_fact",
    "words_of",
]
