"""What the copies of a batch record: their states at the motion's samples, and what touched since the sample before.

The compiled program returns `StepRecords`, one record for each time step. `BatchRecorder` keeps those of them that the
report needs, so that the memory does not grow with the number of time steps.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import jax
import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.execution.task import ExecutionTask, SimulatedStates

HostOrDevice: TypeAlias = np.ndarray | jax.Array
"""An array on the host, or on the device or in a program."""

NO_CONTACT = -1
"""Code of a contact that is not active."""


class StepRecords(NamedTuple):
    """What the program returns for each step of a chunk."""

    qpos: Float[HostOrDevice, "*steps copies nq"]
    """States before the step."""

    touching: Int[HostOrDevice, "*steps copies contacts"]
    """Pairs of bodies in contact before the step, as ``first body * number of bodies + second body``; `NO_CONTACT`
    where a contact is not active."""

    is_stable: Bool[HostOrDevice, "*steps copies"]
    """Whether all numbers after the step are finite and below MuJoCo's limit."""

    is_crowded: Bool[HostOrDevice, "*steps copies"]
    """Whether all reserved contacts were active, so that there may have been more."""


class BatchRecorder:
    """Collects the states at the recorded times, and the touches between them, of all copies."""

    is_crowded: Bool[np.ndarray, " copies"]
    """Whether a copy had as many contacts as are reserved at some step."""

    def __init__(self, task: ExecutionTask, model: mujoco.MjModel, copies: int) -> None:
        """Prepare empty records.

        Args:
            task: The motion, which says when states are recorded.
            model: The model that is simulated.
            copies: Number of copies.
        """
        self._record_steps = task.record_steps(model.opt.timestep)
        self._bodies = model.nbody
        self._states = np.empty((copies, len(self._record_steps), model.nq))
        self._touches: list[list[frozenset[tuple[int, int]]]] = [[] for _ in range(copies)]
        self._pending: list[set[int]] = [set() for _ in range(copies)]
        self._is_stable = np.ones(copies, bool)
        self.is_crowded = np.zeros(copies, bool)

    def add(self, first: int, records: StepRecords) -> None:
        """Add the records of consecutive steps.

        Args:
            first: Number of the first of these steps.
            records: The records, with a leading axis of steps.
        """
        self._is_stable &= np.all(records.is_stable, axis=0)
        self.is_crowded |= np.any(records.is_crowded, axis=0)

        # A record ends the interval of touches before its step.
        number = len(records.qpos)
        begin = 0
        while (taken := len(self._touches[0])) < len(self._record_steps):
            end = self._record_steps[taken] - first
            if end >= number:
                break
            self._collect(records.touching[begin:end])
            self._states[:, taken] = records.qpos[end]
            self._take()
            begin = end
        self._collect(records.touching[begin:])

    def _collect(self, touching: Int[HostOrDevice, "steps copies contacts"]) -> None:
        """Remember the touches of some steps for the next record."""
        for copy, pending in enumerate(self._pending):
            pending.update(np.unique(touching[:, copy]).tolist())

    def _take(self) -> None:
        """Append the remembered touches to those of the records."""
        for touches, pending in zip(self._touches, self._pending, strict=True):
            codes = pending - {NO_CONTACT}
            touches.append(frozenset(divmod(code, self._bodies) for code in codes))
            pending.clear()

    def simulated(self, copy: int) -> SimulatedStates:
        """Return what was recorded of one copy."""
        return SimulatedStates(self._states[copy], self._touches[copy], bool(self._is_stable[copy]))
