"""World poses of objects by the mode of each, and how the objects move with their mode parameters."""

from __future__ import annotations

import jax.numpy as jnp

from dvr_jax.geometry.vectors import materialize, rotation_about_z
from dvr_jax.modes import fixed, held, placed
from dvr_jax.modes.mode import Attachment, HandPoses, ModeKind, ObjectPoses


def object_poses(attached: Attachment, hands: HandPoses) -> ObjectPoses:
    """World poses of objects and their twists by the mode parameters.

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
