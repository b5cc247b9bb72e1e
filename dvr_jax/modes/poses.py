"""Kinematic modes: where an object is, given the grippers and the mode parameters, and how it moves with them.

A grasp's parameters place the gripper in the object's frame, ``T_object_hand``; a place's parameters place the object
in the world, ``T_world_object``. Batch axes end with (object, slice), ``(N, L)``."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    compose,
    cross,
    materialize,
    rotate,
    rotation_about_z,
    transpose,
    vector,
)
from dvr_jax.nlp.problem import HELD_LEFT, HELD_RIGHT, PARAMETERS, PLACED


class Attachment(NamedTuple):
    """How objects are attached, with the mode parameters of the actions that they are attached by; batch axes of one
    shape, say (N, L)."""

    kind: Array
    """int, see `dvr_jax.nlp.problem`."""
    parameters: Array
    """(4, ...) mode parameters of the action (of no meaning where the object is fixed)."""
    face_yaw: Array
    """Yaw of the closing axis in the object's frame before the yaw parameter is added [rad]."""
    initial: Array
    """(4, ...) where the scene has the object: x, y, z [m], yaw [rad]."""
    half_height: Array
    """Half the object's height [m]."""


class ObjectPoses(NamedTuple):
    """World poses of the objects and how they move; batch axes (N, L)."""

    R: Rotation
    p: Vector
    twists: Array
    """(6, 4, N, L): for each mode parameter the object's world twist at unit rate, angular velocity before the
    velocity of the point at the world's origin."""
    held: Array
    """(2, N, L) True where the left, the right arm holds the object: it then moves with all joints of that arm."""


def grasp_frame(m: Array, face_yaw: Array) -> tuple[Rotation, Vector, Array, Array]:
    """Gripper in the object's frame: rotation, centre, and cosine and sine of the closing axis' yaw.

    The closing axis (hand y) is the face's outward normal n, ``u = z x n`` its horizontal tangent; the approach (hand
    z) is ``sin(pitch) u - cos(pitch) z``; the centre is ``m0 u + m1 z``, in the object's middle between the fingers
    as a parallel gripper takes it."""
    phi = face_yaw + m[3]
    c, s, cp, sp = materialize((jnp.cos(phi), jnp.sin(phi), jnp.cos(m[2]), jnp.sin(m[2])))
    x, n, approach = vector(-s * cp, c * cp, sp), vector(c, s, jnp.zeros_like(c)), vector(-s * sp, c * sp, -cp)
    return jnp.stack([x, n, approach]), vector(-s * m[0], c * m[0], m[1]), c, s


def object_poses(attached: Attachment, hand_R: Rotation, hand_p: Vector) -> ObjectPoses:
    """World poses of objects for gripper poses with batch axes ``(2, L)``."""
    m, kind = attached.parameters, attached.kind
    right, placed = kind == HELD_RIGHT, kind == PLACED
    held = (kind == HELD_LEFT) | right
    R_object_hand, p_object_hand, c, s = materialize(grasp_frame(m, attached.face_yaw))
    R_hand = jnp.where(right, hand_R[:, :, 1, None], hand_R[:, :, 0, None])
    p_hand = jnp.where(right, hand_p[:, 1, None], hand_p[:, 0, None])
    R_held = materialize(compose(R_hand, transpose(R_object_hand)))
    p_held = p_hand - rotate(R_held, p_object_hand)
    yaw = jnp.where(placed, m[2], attached.initial[3])
    standing = materialize((jnp.cos(yaw), jnp.sin(yaw)))
    p_standing = jnp.where(placed, vector(m[0], m[1], attached.half_height), attached.initial[:3])
    R = jnp.where(held, R_held, rotation_about_z(*standing))
    R, p = materialize((R, jnp.where(held, p_held, p_standing)))

    # With the hand standing still, a held object moves against the hand's motion in the object's frame. One-hot
    # products in place of stacks keep this one kernel.
    def only(parameter: int) -> np.ndarray:
        return np.eye(PARAMETERS, dtype=R.dtype)[parameter][:, None, None]

    def each(v: Vector) -> Array:
        return v[:, None]

    up = np.array([0, 0, 1], R.dtype)[:, None, None, None]
    x, y = np.roll(up, -2, 0), np.roll(up, -1, 0)
    n, u = materialize((c * R_held[0] + s * R_held[1], c * R_held[1] - s * R_held[0]))
    z = R_held[2]
    spins = materialize((cross(n, p_hand), cross(z, p)))
    zero = jnp.zeros_like(yaw)
    held_angular = -each(n) * only(2) - each(z) * only(3)
    held_linear = -each(u) * only(0) - each(z) * only(1) + each(spins[0]) * only(2) + each(spins[1]) * only(3)
    placed_linear = x * only(0) + y * only(1) + each(vector(p[1], -p[0], zero)) * only(2)
    angular = jnp.where(held, held_angular, jnp.where(placed, up * only(2), 0))
    linear = jnp.where(held, held_linear, jnp.where(placed, placed_linear, 0))
    return ObjectPoses(R, p, jnp.concatenate([angular, linear]), jnp.stack([held & ~right, right]))
