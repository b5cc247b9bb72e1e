"""The mode of an object that a gripper holds: it is rigidly attached to the hand.

The mode parameters ``m = (tangent, height, pitch, yaw)`` place the gripper in the object's frame, ``T_object_hand``.
With the yaw ``phi = closing_yaw + yaw``,

    closing axis (hand y)         n = (cos(phi), sin(phi), 0),
    horizontal tangent            u = z x n = (-sin(phi), cos(phi), 0),
    approach axis (hand z)        sin(pitch) u - cos(pitch) z,  straight down at pitch 0,
    hand x                        cos(pitch) u + sin(pitch) z,
    center of the gripper         tangent u + height z.

The center has no component along n, because a parallel gripper takes the object in the middle between its fingers.

The object's pose in the world follows from the pose of the hand:

    T_world_object = T_world_hand T_object_hand^-1.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation as HostRotation

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    compose,
    cross,
    materialize,
    rotate,
    transpose,
    vector,
)
from dvr_jax.modes.mode import PARAMETERS, Attachment, HandPoses


class GraspFrame(NamedTuple):
    """A gripper in the frame of the object that it holds."""

    rotation: Rotation
    """Axes of the hand (3, 3, ...)."""

    position: Vector
    """Gripper center (3, ...) [m]."""

    cosine: Array
    """Cosine of the closing axis' yaw."""

    sine: Array
    """Sine of the closing axis' yaw."""


class HeldPoses(NamedTuple):
    """World poses of held objects, and what `twists` computes their twists from."""

    rotation: Rotation
    """Axes of the objects (3, 3, ...)."""

    position: Vector
    """Centers of the objects (3, ...) [m]."""

    hand_position: Vector
    """Center of the gripper that holds each object (3, ...) [m]."""

    frame: GraspFrame
    """The gripper in the object's frame."""


def grasp_frame(m: Float[Array, "4 *#batch"], closing_yaw: Float[Array, "*#batch"]) -> GraspFrame:
    """The gripper in the object's frame, by the definition in the module's docstring.

    Args:
        m: Mode parameters.
        closing_yaw: Yaw of the closing axis before the fourth parameter is added [rad].

    Returns:
        Pose of the gripper in the object's frame.
    """
    phi = closing_yaw + m[3]
    c, s, cp, sp = materialize((jnp.cos(phi), jnp.sin(phi), jnp.cos(m[2]), jnp.sin(m[2])))
    x = vector(-s * cp, c * cp, sp)
    closing = vector(c, s, jnp.zeros_like(c))
    approach = vector(-s * sp, c * sp, -cp)
    center = vector(-s * m[0], c * m[0], m[1])
    return GraspFrame(jnp.stack([x, closing, approach]), center, c, s)


def poses(attached: Attachment, hands: HandPoses) -> HeldPoses:
    """World poses of all objects as if each were held by its parent.

    Args:
        attached: How the objects are attached, batch axes (N, L).
        hands: Poses of the grippers.

    Returns:
        Poses with the same batch axes; they have no meaning where an object is not held.
    """
    frame = materialize(grasp_frame(attached.parameters, attached.closing_yaw))

    # The hand of each object's parent, selected arm after arm.
    hand_R = hands.rotation[:, :, 0, None]
    hand_p = hands.position[:, 0, None]
    for arm in range(1, hands.position.shape[1]):
        is_parent = attached.parent == arm
        hand_R = jnp.where(is_parent, hands.rotation[:, :, arm, None], hand_R)
        hand_p = jnp.where(is_parent, hands.position[:, arm, None], hand_p)

    R = materialize(compose(hand_R, transpose(frame.rotation)))
    p = hand_p - rotate(R, frame.position)
    return HeldPoses(R, p, hand_p, frame)


def twists(
    held: HeldPoses, position: Vector
) -> tuple[Float[Array, "3 4 *#batch"], Float[Array, "3 4 *#batch"]]:
    """World twist of held objects at unit rate of each mode parameter, while the hand stands still.

    The object moves against the motion that the hand would have in the object's frame. With the closing axis n and the
    tangent u in world axes, and with the object's own vertical axis z,

        tangent    velocity -u,
        height     velocity -z,
        pitch      angular velocity -n about the center of the gripper,
        yaw        angular velocity -z about the center of the object.

    A body that turns with angular velocity w about a point c has the velocity ``c x w`` at the world's origin.

    Args:
        held: Poses of the objects, as if all were held.
        position: Centers of the objects (3, ...) [m], materialized.

    Returns:
        Angular velocities, and velocities of the point at the world's origin.
    """
    frame = held.frame
    axes = held.rotation
    normal, tangent = materialize(
        (
            frame.cosine * axes[0] + frame.sine * axes[1],
            frame.cosine * axes[1] - frame.sine * axes[0],
        )
    )
    z = axes[2]
    pitch_spin, yaw_spin = materialize((cross(normal, held.hand_position), cross(z, position)))
    batch = (1,) * (position.ndim - 1)

    def column(values: Vector, parameter: int) -> Array:
        """Twist by one parameter: (3, ...) to (3, 4, ...), with zero for all other parameters."""
        # One-hot products in place of stacks keep this one kernel.
        one_hot = np.eye(PARAMETERS, dtype=position.dtype)[parameter].reshape(-1, *batch)
        return values[:, None] * one_hot

    angular = -column(normal, 2) - column(z, 3)
    linear = -column(tangent, 0) - column(z, 1) + column(pitch_spin, 2) + column(yaw_spin, 3)
    return angular, linear


def frame_on_host(
    m: Float[np.ndarray, " 4"], closing_yaw: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """The gripper in the object's frame for one object with NumPy, as `grasp_frame`.

    Args:
        m: Mode parameters.
        closing_yaw: Yaw of the closing axis before the fourth parameter is added [rad].

    Returns:
        Rotation of the hand and gripper center [m].
    """
    phi = closing_yaw + m[3]
    normal = np.array([np.cos(phi), np.sin(phi), 0.0])
    tangent = np.array([-np.sin(phi), np.cos(phi), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    approach = np.sin(m[2]) * tangent - np.cos(m[2]) * up
    rotation = np.stack([np.cross(normal, approach), normal, approach], axis=1)
    return rotation, m[0] * tangent + m[1] * up


def pose_on_host(
    m: Float[np.ndarray, " 4"],
    closing_yaw: float,
    hand_rotation: Float[np.ndarray, "samples 3 3"],
    hand_position: Float[np.ndarray, "samples 3"],
) -> tuple[HostRotation, Float[np.ndarray, "samples 3"]]:
    """World poses of one held object with NumPy.

    Args:
        m: Mode parameters.
        closing_yaw: Yaw of the closing axis before the fourth parameter is added [rad].
        hand_rotation: Rotations of the hand that holds the object.
        hand_position: Centers of its gripper [m].

    Returns:
        Rotations and positions [m] of the object.
    """
    R_object_hand, p_object_hand = frame_on_host(m, closing_yaw)
    rotation = hand_rotation @ R_object_hand.T
    return HostRotation.from_matrix(rotation), hand_position - rotation @ p_object_hand
