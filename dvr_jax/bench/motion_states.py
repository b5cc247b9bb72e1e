"""A planned motion with the poses of all bodies, by MuJoCo's forward kinematics, and when each hand holds what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from dvr_jax.checker.operators import CHECKS
from dvr_jax.checker.operators.operator import AttachmentInterval, Timeline
from dvr_jax.checker.timeline import attachment_timeline
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion
from dvr_jax.scene.mjcf import build_model, object_body_name
from dvr_jax.scene.types import Scene

APPROACH_ROUNDING = 1e-3
"""A hand counts as near its grasp up to this much beyond the length of its straight approach [m]."""


@dataclass(frozen=True, slots=True)
class MotionStates:
    """A motion and the world poses of all bodies of its scene at all of its samples."""

    scene: Scene
    """Scene that the motion starts in."""

    motion: Motion
    """The motion."""

    timeline: Timeline
    """Which object is attached to what, from which switch to which."""

    body_names: tuple[str, ...]
    """Names of the bodies in the scene's MuJoCo model."""

    positions: Float[np.ndarray, "samples bodies 3"]
    """Origins of the bodies in the world [m]."""

    rotations: Float[np.ndarray, "samples bodies 3 3"]
    """Rotations of the bodies in the world."""

    def pose(
        self, body: str
    ) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3 3"]]:
        """Return the positions [m] and rotations of a body, given its name in the model."""
        index = self.body_names.index(body)
        return self.positions[:, index], self.rotations[:, index]

    def pose_in(
        self, body: str, frame: str
    ) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3 3"]]:
        """Return the poses of a body in the frame of another body.

        Args:
            body: Name of the body in the model.
            frame: Name of the other body.

        Returns:
            Positions [m] and rotations.
        """
        position, rotation = self.pose(body)
        origin, axes = self.pose(frame)
        to_frame = axes.transpose(0, 2, 1)
        return np.einsum("tij,tj->ti", to_frame, position - origin), to_frame @ rotation

    def holds(self, arm: int) -> list[AttachmentInterval]:
        """Return the intervals in which an arm holds an object, in the order of time."""
        return [interval for interval in self.timeline.intervals if interval.holder == arm]

    def grasp_window(self, interval: AttachmentInterval) -> Bool[np.ndarray, " samples"]:
        """Return at which samples a hand holds an object, comes to it, or leaves it.

        The window reaches from the sample at which the hand is nearer to its grasp than the length of a straight
        approach (`Clearances.approach`) to the one at which it is as far away again. The distance is measured in the
        frame of the object, which moves in a handover.

        Args:
            interval: An interval in which an arm holds the object.
        """
        assert interval.holder is not None
        hand = f"{self.scene.workcell.arm_names[interval.holder]}/hand"
        item = object_body_name(self.scene.objects[interval.object].name)
        seen, _ = self.pose_in(hand, item)
        near = self.scene.workcell.clearances.approach + APPROACH_ROUNDING

        window = np.zeros(len(seen), bool)
        window[interval.start : interval.end] = True
        comes = np.linalg.norm(seen[: interval.start] - seen[interval.start], axis=1) > near
        leaves = np.linalg.norm(seen[interval.end :] - seen[interval.end - 1], axis=1) > near

        # Only the approach right before the grasp counts, and only the departure right after the release.
        last_far = int(np.flatnonzero(comes)[-1]) + 1 if comes.any() else 0
        first_far = int(np.flatnonzero(leaves)[0]) if leaves.any() else len(leaves)
        window[last_far : interval.end + first_far] = True
        return window


def replay_states(scene: Scene, actions: Sequence[Action], motion: Motion) -> MotionStates:
    """Compute the poses of all bodies at all samples of a motion.

    Args:
        scene: Scene that the motion starts in.
        actions: Actions of the motion, one for each switch.
        motion: The motion.

    Returns:
        The motion with its poses.

    Raises:
        MotionError: An action does not apply where it stands.
    """
    model = build_model(scene)
    data = mujoco.MjData(model)
    positions = np.empty((len(motion.time), model.nbody, 3))
    rotations = np.empty((len(motion.time), model.nbody, 3, 3))
    for sample, qpos in enumerate(motion.qpos):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        positions[sample] = data.xpos
        rotations[sample] = data.xmat.reshape(-1, 3, 3)

    names = tuple(str(model.body(body).name) for body in range(model.nbody))
    timeline = attachment_timeline(scene, actions, motion, CHECKS)
    return MotionStates(scene, motion, timeline, names, positions, rotations)
