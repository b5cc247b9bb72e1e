"""Execution of plans in physics: MuJoCo simulates arms, fingers, contacts and friction, open loop.

The independent check (`dvr_jax.checker`) is kinematic: it assumes that a closed gripper carries its object. Here forces
decide. The arms follow the motion by their joint servos, the fingers squeeze, and nothing corrects what goes wrong.
"""

from dvr_jax.execution.backend import PhysicsBackend
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.executor import execute
from dvr_jax.execution.report import Deviation, DeviationCause, ExecutionReport
from dvr_jax.execution.task import Execution

__all__ = [
    "Deviation",
    "DeviationCause",
    "Execution",
    "ExecutionConditions",
    "ExecutionReport",
    "PhysicsBackend",
    "execute",
]
