"""The simulators that can execute a plan."""

from __future__ import annotations

from enum import StrEnum


class PhysicsBackend(StrEnum):
    """What computes the states of an execution."""

    MUJOCO = "mujoco"
    """MuJoCo C, on the CPU. Repeated executions run in parallel processes."""

    MJX = "mjx"
    """MuJoCo MJX, on the device of JAX. Repeated executions run as one batch."""
