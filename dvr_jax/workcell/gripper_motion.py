"""Small straight motions of a gripper, by the robot's closed-form inverse kinematics."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.runtime.compilation import Program
from dvr_jax.workcell.kinematics import BasePoses, hand_pose, link_poses
from dvr_jax.workcell.model import WorkcellModel

LARGEST_CHANGE = 1.0
"""Largest change of a joint by which a solution still counts as near [rad]."""


@Program
def shift_gripper(
    model: WorkcellModel,
    q: Float[Array, "lanes joints"],
    up: Bool[Array, " lanes"],
    distance: Float[Array, " lanes"],
    free_change: Float[Array, " lanes"],
) -> Float[Array, "lanes joints"]:
    """Joint angles of one arm each with the gripper moved straight up, or back along its approach.

    Args:
        model: Arms of the workcell.
        q: Joint angles [rad].
        up: True: straight up; False: back.
        distance: How far [m].
        free_change: By how much the free joints of the inverse kinematics change [rad].

    Returns:
        The solution nearest to `q` with these free joints, or `q` itself where there is none near.
    """
    # Bases stand upright, so that up in the base's frame is up in the world.
    identity = jnp.eye(3, dtype=q.dtype)[:, :, None, None]
    bases = BasePoses(identity, jnp.zeros((3, 1, 1), q.dtype))
    R, p = hand_pose(model, link_poses(model, bases, q.T[:, None]))
    R = R[:, :, 0]
    p = p[:, 0]

    straight = jnp.asarray([0.0, 0.0, 1.0], q.dtype)[:, None]
    target = p + distance * jnp.where(up, straight, -R[2])
    kinematics = model.structure.inverse_kinematics
    free = q.T[jnp.asarray(kinematics.free_joints, int)] + free_change
    solutions, failure = kinematics.solve(model, R, target, free)

    change = jnp.where(failure == 0, jnp.abs(solutions - q.T[:, None]).max(0), jnp.inf)
    best = jnp.argmin(change, axis=0)
    nearest = jnp.take_along_axis(solutions, best[None, None], axis=1)[:, 0]
    return jnp.where(change.min(0) < LARGEST_CHANGE, nearest, q.T).T
