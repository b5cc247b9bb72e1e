"""Forward kinematics of all arms, their joint screws, and their collision capsules.

There are A arms with J joints and C capsules each, and L slices. Link 0 is the base, and link frame i (1 to J) moves
with joints 0 to i - 1. With the constant rotation ``R_i`` and offset ``p_i`` of link i + 1 in link i, and with the turn
``Rot_z(q_i)`` of joint i,

    R_world_{i+1} = R_world_i R_i Rot_z(q_i),        p_world_{i+1} = p_world_i + R_world_i p_i.

Poses (`dvr_jax.geometry.vectors`) have batch axes ``(A, L)``. All constants come from a `WorkcellModel`, which is read
from the robot's MJCF, so the simulation and the optimizer use the same numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    compose,
    cross,
    materialize,
    rotate,
    transform_point,
)
from dvr_jax.workcell.model import WorkcellModel


class BasePoses(NamedTuple):
    """World poses of the arms' bases in every slice."""

    rotation: Float[Array, "3 3 arms slices"]
    """Axes of the base frames, columns first."""

    position: Float[Array, "3 arms slices"]
    """Origins of the base frames [m]."""


class LinkPoses(NamedTuple):
    """World poses of the link frames 0 to J of all arms."""

    rotations: tuple[Rotation, ...]
    """Rotations (3, 3, A, L), one for each link."""

    positions: tuple[Vector, ...]
    """Origins (3, A, L) [m], one for each link."""


def link_poses(
    model: WorkcellModel,
    bases: BasePoses,
    q: Float[Array, "joints arms slices"],
) -> LinkPoses:
    """World poses of all link frames, by the recursion in the module's docstring.

    Args:
        model: Arms of the workcell.
        bases: Poses of the bases.
        q: Joint angles [rad].

    Returns:
        Poses of the links 0 (the base) to J.
    """
    R: Array = jnp.broadcast_to(bases.rotation, (3, 3, *q.shape[1:]))
    p: Array = jnp.broadcast_to(bases.position, (3, *q.shape[1:]))
    rotations = [R]
    positions = [p]
    turns = materialize(_joint_rotations(model, q))
    offsets = jnp.asarray(model.link_offsets, q.dtype)

    for i, axes in enumerate(model.structure.offset_axes):
        # The last axis comes first, because the order decides how the sum is rounded, and which of two equally good
        # plans is found can depend on it.
        products = [R[axis] * offsets[i, axis] for axis in reversed(axes)]
        origin = p + sum(products[1:], products[0]) if products else p
        R, p = materialize((compose(R, turns[i]), origin))
        rotations.append(R)
        positions.append(p)

    return LinkPoses(tuple(rotations), tuple(positions))


def _joint_rotations(model: WorkcellModel, q: Array) -> Float[Array, "joints 3 3 arms slices"]:
    """Rotation of link frame i + 1 in link frame i: the constant rotation, then the joint's turn about z.

    With the columns x, y, z of the constant rotation, the product has the columns

        cos(q) x + sin(q) y,        cos(q) y - sin(q) x,        z.
    """
    R = jnp.asarray(model.link_rotations, q.dtype)
    # Each column is (J, 3).
    x = R[:, :, 0]
    y = R[:, :, 1]
    z = R[:, :, 2]
    zero = jnp.zeros_like(x)

    def columns(*vectors: Array) -> Array:
        """Stack columns to (J, 3, 3, 1, 1)."""
        return jnp.stack(vectors, axis=1)[..., None, None]

    cosine = materialize(jnp.cos(q))[:, None, None]
    sine = materialize(jnp.sin(q))[:, None, None]
    return columns(x, y, zero) * cosine + columns(y, -x, zero) * sine + columns(zero, zero, z)


def joint_screws(links: LinkPoses) -> Float[Array, "6 arms joints slices"]:
    """World twist of each joint at unit speed.

    Joint i turns about the z axis of link frame i + 1. With this axis a and the frame's origin o, the twist is the
    angular velocity a, then the velocity ``o x a`` of the point at the world's origin.
    """
    axis = materialize(jnp.stack([R[2] for R in links.rotations[1:]], axis=2))
    origin = materialize(jnp.stack(links.positions[1:], axis=2))
    return jnp.concatenate([axis, cross(origin, axis)])


def hand_pose(model: WorkcellModel, links: LinkPoses) -> tuple[Rotation, Vector]:
    """World poses of the gripper frames.

    Args:
        model: Arms of the workcell.
        links: Poses of the arms' links.

    Returns:
        Axes (3, 3, A, L) of the hands and gripper centers (3, A, L) [m]. The fingers close along a hand's y axis, and
        the hand approaches an object along its z axis.
    """
    R = links.rotations[-1]
    hand = jnp.asarray(model.hand_rotation, R.dtype)
    axes = [rotate(R, hand[:, j, None, None]) for j in range(3)]
    center = jnp.asarray(model.gripper_center, R.dtype)[:, None, None]
    return jnp.stack(axes), transform_point(R, links.positions[-1], center)


def capsule_segments(
    model: WorkcellModel,
    links: LinkPoses,
    finger_opening: Float[Array, "arms slices"],
) -> tuple[Float[Array, "3 arms capsules slices"], Float[Array, "3 arms capsules slices"]]:
    """World ends of the segments of all collision capsules.

    Args:
        model: Arms of the workcell.
        links: Poses of the arms' links.
        finger_opening: Distance of each finger from its hand's middle plane [m].

    Returns:
        First and second ends of the segments [m].
    """
    of_capsule = model.structure.capsule_links
    R = materialize(jnp.stack([links.rotations[link] for link in of_capsule], axis=3))
    p = materialize(jnp.stack([links.positions[link] for link in of_capsule], axis=2))

    def constant(value: Array) -> Array:
        """A constant of each capsule with broadcast axes for arms and slices: (C, 3) to (3, 1, C, 1)."""
        return jnp.asarray(value, finger_opening.dtype).T[:, None, :, None]

    # The capsules of the fingers slide as the gripper opens; the direction of all others is zero.
    slide = constant(model.finger_directions) * finger_opening[:, None]
    start = p + rotate(R, constant(model.capsule_starts) + slide)
    end = p + rotate(R, constant(model.capsule_ends) + slide)
    return start, end
