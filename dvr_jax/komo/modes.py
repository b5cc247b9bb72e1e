"""Kinematic modes: where an object is, given the grippers and the mode parameters, and how it moves with them.

A grasp's parameters place the gripper in the object's frame, ``T_object_hand``; a place's parameters place the object
in the world, ``T_world_object``. Arrays end with (object, slice) axes ``(N, L)``."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    add,
    compose,
    cross,
    rotate,
    rotation_about_z,
    scale,
    select,
    select_rotation,
    subtract,
    transpose,
)
from dvr_jax.komo.problem import HELD_LEFT, HELD_RIGHT, PLACED


class Attachment(NamedTuple):
    """How objects are attached, with the mode parameters of the actions that they are attached by; all of one shape,
    say (N, L)."""

    kind: Array
    """int, see `dvr_jax.komo.problem`."""
    parameters: tuple[Array, Array, Array, Array]
    """Mode parameters of the action (of no meaning where the object is fixed)."""
    face_yaw: Array
    """Yaw of the closing axis in the object's frame before the yaw parameter is added [rad]."""
    initial: tuple[Array, Array, Array, Array]
    """Where the scene has the object: x, y, z [m], yaw [rad]."""
    half_height: Array
    """Half the object's height [m]."""


class ObjectPoses(NamedTuple):
    """World poses of the objects and how they move, components ``(N, L)``."""

    R: Rotation
    p: Vector
    twists: tuple[tuple[Vector, Vector], ...]
    """For each mode parameter the object's world twist at unit rate: angular velocity, velocity of the point at the
    world's origin."""
    held: tuple[Array, Array]
    """True where the left, the right arm holds the object: it then moves with all joints of that arm."""


def grasp_frame(m: tuple[Array, Array, Array, Array], face_yaw: Array) -> tuple[Rotation, Vector, Array, Array]:
    """Gripper in the object's frame: rotation, centre, and cosine and sine of the closing axis' yaw.

    The closing axis (hand y) is the face's outward normal n, ``u = z x n`` its horizontal tangent; the approach (hand
    z) is ``sin(pitch) u - cos(pitch) z``; the centre is ``m0 u + m1 z``, in the object's middle between the fingers
    as a parallel gripper takes it."""
    phi = face_yaw + m[3]
    c, s = jnp.cos(phi), jnp.sin(phi)
    zero = jnp.zeros_like(c)
    n, u, up = (c, s, zero), (-s, c, zero), (zero, zero, zero + 1)
    approach = add(scale(jnp.sin(m[2]), u), scale(-jnp.cos(m[2]), up))
    return (cross(n, approach), n, approach), add(scale(m[0], u), scale(m[1], up)), c, s


def object_poses(attached: Attachment, hand_R: Rotation, hand_p: Vector) -> ObjectPoses:
    """World poses of objects for gripper poses with components ``(2, L)``."""
    m, kind = attached.parameters, attached.kind
    left, right, placed = kind == HELD_LEFT, kind == HELD_RIGHT, kind == PLACED
    held = left | right
    R_object_hand, p_object_hand, c, s = grasp_frame(m, attached.face_yaw)

    def hand(component: Array) -> Array:
        return jnp.where(right, component[1], component[0])

    R_hand: Rotation = tuple(tuple(hand(x) for x in column) for column in hand_R)  # type: ignore[assignment]
    p_hand: Vector = (hand(hand_p[0]), hand(hand_p[1]), hand(hand_p[2]))
    R_held = compose(R_hand, transpose(R_object_hand))
    p_held = subtract(p_hand, rotate(R_held, p_object_hand))
    x0, y0, z0, yaw0 = attached.initial
    yaw = jnp.where(placed, m[2], yaw0)
    p_standing = (jnp.where(placed, m[0], x0), jnp.where(placed, m[1], y0), jnp.where(placed, attached.half_height, z0))
    R = select_rotation(held, R_held, rotation_about_z(jnp.cos(yaw), jnp.sin(yaw)))
    p = select(held, p_held, p_standing)

    # With the hand standing still, a held object moves against the hand's motion in the object's frame.
    zero = jnp.zeros_like(yaw)
    none, ex, ey, up = (zero, zero, zero), (zero + 1, zero, zero), (zero, zero + 1, zero), (zero, zero, zero + 1)
    n = add(scale(c, R_held[0]), scale(s, R_held[1]))
    u = add(scale(-s, R_held[0]), scale(c, R_held[1]))
    z = R_held[2]
    of_held = (
        (none, scale(-1.0, u)),
        (none, scale(-1.0, z)),
        (scale(-1.0, n), cross(n, p_hand)),
        (scale(-1.0, z), cross(z, p_held)),
    )
    of_placed = ((none, ex), (none, ey), (up, cross(p_standing, up)), (none, none))
    twists = tuple(
        (
            select(held, angular_h, select(placed, angular_p, none)),
            select(held, linear_h, select(placed, linear_p, none)),
        )
        for (angular_h, linear_h), (angular_p, linear_p) in zip(of_held, of_placed, strict=True)
    )
    return ObjectPoses(R, p, twists, (left, right))
