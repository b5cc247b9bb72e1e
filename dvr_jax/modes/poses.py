"""World poses of objects by the mode of each, and how the objects move with their mode parameters."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Bool, Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import materialize, rotation_about_z
from dvr_jax.modes import fixed, held, placed
from dvr_jax.modes.mode import Attachment, HandPoses, ModeKind, ObjectPoses


def object_poses(attached: Attachment, hands: HandPoses) -> ObjectPoses:
    """Compute the world poses of objects, and their twists at unit rate of each mode parameter.

    Args:
        attached: How the objects are attached, batch axes (N, L).
        hands: Poses of the grippers of all arms, batch axes (A, L).

    Returns:
        Poses and twists, batch axes (N, L).
    """
    is_held = attached.kind == ModeKind.HELD
    is_placed = attached.kind == ModeKind.PLACED

    # All modes are evaluated for all objects, and one is selected, because a compiled program has no branches.
    as_held = held.poses(attached, hands)
    standing = jnp.where(is_placed, placed.standing_pose(attached), fixed.standing_pose(attached))
    cosine, sine = materialize((jnp.cos(standing[3]), jnp.sin(standing[3])))
    R = jnp.where(is_held, as_held.rotation, rotation_about_z(cosine, sine))
    R, p = materialize((R, jnp.where(is_held, as_held.position, standing[:3])))

    # The twists are selected in the same way; those of a fixed object are zero.
    held_angular, held_linear = held.twists(as_held, p)
    placed_angular, placed_linear = placed.twists(p)
    angular = jnp.where(is_held, held_angular, jnp.where(is_placed, placed_angular, 0))
    linear = jnp.where(is_held, held_linear, jnp.where(is_placed, placed_linear, 0))

    arms = range(hands.position.shape[1])
    by_arm = jnp.stack([is_held & (attached.parent == arm) for arm in arms])
    return ObjectPoses(R, p, jnp.concatenate([angular, linear]), by_arm)


def chain_depth(joints: int, is_held: Bool[Array, "*batch"]) -> Float[Array, "columns *batch"]:
    """Return the places of D joints and of an object's mode parameters in the chain that moves the object.

    A variable moves all columns that have a greater place. The pose of a held object follows from the hand by its
    pitch, then by its tangent and its height, then by its yaw; that of a placed object by x and y, then by its yaw.

    Args:
        joints: Number D of joints, in the order of the chain.
        is_held: Whether a hand holds the object.
    """
    held_order = jnp.asarray([1.0, 2.0, 0.0, 3.0])
    placed_order = jnp.asarray([0.0, 1.0, 2.0, 3.0])
    axes = (slice(None), *(None,) * is_held.ndim)
    of_joints = jnp.broadcast_to(jnp.arange(float(joints))[axes], (joints, *is_held.shape))
    of_parameters = jnp.where(is_held, held_order[axes], placed_order[axes])
    return jnp.concatenate([of_joints, joints + of_parameters])
