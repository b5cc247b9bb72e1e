"""Kinematic modes: where an object is, given the joint angles and the mode parameters, and how it moves with them.

A *mode transform* of action k is, for a grasp, the gripper's pose in the object's frame ``T_object_hand`` and, for a place, the
object's pose in the world ``T_world_object``. Twists are (angular velocity, velocity of the point at the frame's origin).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import compose_rotations, cross, rotate, rotation_about_z, transpose
from dvr_jax.komo.problem import FIXED, HELD_LEFT, HELD_RIGHT, PLACED, Problem


class ModeTransforms(NamedTuple):
    """Poses of the actions' mode transforms and their derivatives, actions last."""

    R: Array
    """(3, 3, K) rotations."""
    p: Array
    """(3, K) positions [m]."""
    twists: Array
    """(6, 4, K) twist of the transformed frame per unit of each mode parameter, about the reference frame's origin."""


class ObjectPoses(NamedTuple):
    """World poses of the objects in one slice, objects last."""

    R: Array
    """(3, 3, N) rotations."""
    p: Array
    """(3, N) positions of the centres [m]."""
    twists: Array
    """(6, 4, N) world twist of each object per unit of the mode parameters that it depends on."""
    held: Array
    """(2, N): 1 where arm a holds object n: it then moves with all joints of that arm."""


def mode_transforms(problem: Problem, m: Array) -> ModeTransforms:
    """Mode transforms of all K actions for mode parameters ``(K, 4)``."""
    m = m.T
    zero, one = jnp.zeros_like(m[0]), jnp.ones_like(m[0])
    up = jnp.stack([zero, zero, one])
    # Grasp: n is the outward normal of the face, u = z x n its horizontal tangent.
    phi = problem.face_yaw + m[3]
    cos_phi, sin_phi = jnp.cos(phi), jnp.sin(phi)
    n = jnp.stack([cos_phi, sin_phi, zero])
    u = jnp.stack([-sin_phi, cos_phi, zero])
    approach = jnp.sin(m[2]) * u - jnp.cos(m[2]) * up
    R_grasp = jnp.stack([cross(n, approach), n, approach], axis=1)
    p_grasp = m[0] * u + m[1] * up
    nothing = jnp.zeros_like(up)
    twists_grasp = jnp.stack(
        [
            jnp.concatenate([nothing, u]),
            jnp.concatenate([nothing, up]),
            jnp.concatenate([n, cross(p_grasp, n)]),
            jnp.concatenate([up, nothing]),
        ],
        axis=1,
    )
    # Place: the bottom face lies on the support, so only x, y and yaw are left.
    height = problem.half[problem.switched_object, 2]
    p_place = jnp.stack([m[0], m[1], height])
    ex, ey = jnp.stack([one, zero, zero]), jnp.stack([zero, one, zero])
    twists_place = jnp.stack(
        [
            jnp.concatenate([nothing, ex]),
            jnp.concatenate([nothing, ey]),
            jnp.concatenate([up, cross(p_place, up)]),
            jnp.zeros((6, *zero.shape), m.dtype),
        ],
        axis=1,
    )
    grasp = problem.is_grasp > 0
    return ModeTransforms(
        R=jnp.where(grasp, R_grasp, rotation_about_z(m[2])),
        p=jnp.where(grasp, p_grasp, p_place),
        twists=jnp.where(grasp, twists_grasp, twists_place),
    )


def object_poses(
    problem: Problem, modes: ModeTransforms, attachment: Array, attached_by: Array, hand_R: Array, hand_p: Array
) -> ObjectPoses:
    """World poses of all objects in one slice.

    Args:
        attachment, attached_by: (N,) row of the problem's arrays for the phase.
        hand_R, hand_p: (3, 3, 2) and (3, 2) world poses of the two grippers.
    """
    R_mode, p_mode, twists_mode = modes.R[:, :, attached_by], modes.p[:, attached_by], modes.twists[:, :, attached_by]
    left, right = attachment == HELD_LEFT, attachment == HELD_RIGHT
    held = left | right
    # Held: T_world_object = T_world_hand T_object_hand^-1.
    R_hand = jnp.where(right, hand_R[:, :, 1, None], hand_R[:, :, 0, None])
    p_hand = jnp.where(right, hand_p[:, 1, None], hand_p[:, 0, None])
    R_held = compose_rotations(R_hand, transpose(R_mode))
    p_held = p_hand - rotate(R_held, p_mode)
    R_fixed = rotation_about_z(problem.initial_pose[:, 3])
    placed = attachment == PLACED
    R = jnp.where(held, R_held, jnp.where(placed, R_mode, R_fixed))
    p = jnp.where(held, p_held, jnp.where(placed, p_mode, problem.initial_pose[:, :3].T))
    # With the hand standing still, the object moves against the hand's motion in the object's frame.
    angular = rotate(R_held[:, :, None], twists_mode[:3])
    linear = rotate(R_held[:, :, None], twists_mode[3:]) + cross(jnp.broadcast_to(p_held[:, None], angular.shape), angular)
    twists_held = -jnp.concatenate([angular, linear])
    twists = jnp.where(held, twists_held, jnp.where(placed, twists_mode, 0))
    return ObjectPoses(R, p, twists, jnp.stack([left, right]).astype(p.dtype))


def is_movable(attachment: Array) -> Array:
    """True where an object can move in a phase of the problem (it is held)."""
    return attachment >= HELD_LEFT


def is_standing(attachment: Array) -> Array:
    """True where an object stands on a support."""
    return (attachment == FIXED) | (attachment == PLACED)
