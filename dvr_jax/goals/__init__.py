"""Goals of scenes, one file each."""

from dvr_jax.goals.goal import Fact, Goal
from dvr_jax.goals.on_region import GOAL_SUPPORT, OnRegion, Region

__all__ = ["GOAL_SUPPORT", "Fact", "Goal", "OnRegion", "Region"]
