"""Closed-form inverse kinematics of a Panda arm, with the last joint's angle as the free parameter.

The Panda's wrist is offset (a7 = 8.8 cm), so there is no spherical wrist; but once q7 is chosen, the centre O6 of
joint 6 is known, and shoulder S, elbow O4 and O6 form a triangle with two known sides. What is left are two choices
of two: which way the forearm folds about the line S - O6 (two roots of one trigonometric equation in q6) and which
way the shoulder turns (q2 and -q2). Derived here from Franka's Denavit-Hartenberg table; the same decomposition is in
He and Liu, "Analytical inverse kinematics for Franka Emika Panda", 2021."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.angles import arctan2
from dvr_jax.geometry.vectors import Rotation, Vector, compose, cross, dot, materialize, rotate_back, transpose
from dvr_jax.runtime.compilation import Program
from dvr_jax.workcell.kinematics import base_pose, hand_pose, link_poses, load_arm

BRANCHES = 4
"""Solutions for each value of q7."""

_SHOULDER_HEIGHT = 0.333
_UPPER, _FOREARM, _ELBOW, _WRIST = 0.316, 0.384, 0.0825, 0.088
"""d3, d5, a4 and a7 of the Denavit-Hartenberg table [m]."""

# In the plane of the triangle, with O4 as origin and (x3, z3) as axes: S lies at (-a4, -d3), and O6 at (-a4, d5)
# turned by q4.
_SIDE_UPPER = math.hypot(_UPPER, _ELBOW)
_SIDE_FOREARM = math.hypot(_FOREARM, _ELBOW)
_ANGLE_AT_ZERO = math.atan2(_FOREARM, -_ELBOW) - math.atan2(-_UPPER, -_ELBOW)
_COS_AT_ZERO, _SIN_AT_ZERO = math.cos(_ANGLE_AT_ZERO), math.sin(_ANGLE_AT_ZERO)


def _gripper_in_flange() -> tuple[np.ndarray, float]:
    """Rotation of the hand in link frame 7 and the distance of the gripper centre along its z [m]."""
    arm = load_arm()
    return arm.hand_rotation, float(arm.gripper_center[2])


def _sine_of(cosine: Array) -> Array:
    """Sine of the angle in [0, pi] with this cosine, which is within [-1, 1]."""
    return jnp.sqrt((1 - cosine) * (1 + cosine))


def _half_turn(angle: Array) -> Array:
    """The opposite direction, in [-pi, pi] as ``angle`` is."""
    return jnp.where(angle > 0, angle - math.pi, angle + math.pi)


def arm_angles(arm: Array, R: Rotation, p: Vector, q7: Array) -> tuple[Array, Array]:
    """Joint angles that bring a gripper to world poses.

    Two values of q4, on either side of -0.467 rad, give the same distance from shoulder to wrist; only the more bent
    one is taken. The others hold the wrist within 1.4 cm of its greatest distance.

    Args:
        arm: (L,) int, 0 left, 1 right.
        R, p: gripper axes (y closes, z approaches) ``(3, 3, L)`` and centre ``(3, L)`` [m].
        q7: (L,) angle of the last joint [rad].

    Returns:
        Angles (7, 4, L) [rad], and by how much each branch (4, L) fails: 0 where it reaches the pose within the joint
        limits; else how far the triangle is from closing (a difference of cosines or of lengths [m]) plus the largest
        excess over a limit [rad], and the angles are those of the nearest closed triangle.
    """
    left, right = (base_pose(a) for a in range(2))

    def of_base(i: int) -> Array:
        of_left, of_right = (jnp.asarray(base[i].T, q7.dtype)[..., None] for base in (left, right))
        return jnp.where(arm == 0, of_left, of_right)

    base_R, base_p = of_base(0), of_base(1)
    in_base = compose(transpose(base_R), R)
    x_hand, y_hand, z7 = in_base[0], in_base[1], in_base[2]
    center = rotate_back(base_R, p - base_p)

    hand_rotation, reach = _gripper_in_flange()
    # Columns of link frame 7 from those of the hand: R_7 = R_hand hand_rotation^T, a turn about z.
    c, s = float(hand_rotation[0, 0]), float(hand_rotation[0, 1])
    x7, z7, center = materialize((c * x_hand + s * y_hand, z7, center))
    y7 = cross(z7, x7)
    c7, s7 = materialize((jnp.cos(q7), jnp.sin(q7)))
    x6, z6 = materialize((c7 * x7 - s7 * y7, s7 * x7 + c7 * y7))
    y6 = -z7
    O6 = materialize(center - reach * z7 - _WRIST * x6)

    to_shoulder = materialize(jnp.stack([-O6[0], -O6[1], _SHOULDER_HEIGHT - O6[2]]))
    distance = jnp.sqrt(dot(to_shoulder, to_shoulder))
    cosine = (_SIDE_UPPER**2 + _SIDE_FOREARM**2 - distance**2) / (2 * _SIDE_UPPER * _SIDE_FOREARM)
    gap = jnp.maximum(jnp.abs(cosine) - 1, 0)
    # Sines and cosines come from those of parts of an angle, not from the angle: here q4 = arccos(cosine) - a constant.
    cosine = jnp.clip(cosine, -1, 1)
    sine = _sine_of(cosine)
    c4, s4 = materialize((cosine * _COS_AT_ZERO + sine * _SIN_AT_ZERO, sine * _COS_AT_ZERO - cosine * _SIN_AT_ZERO))
    # S - O6 in the plane: alpha along z5 (the forearm), beta along x4. O4 - O6 = a4 x4 - d5 z5; S - O4 = -a4 x3 - d3
    # z3, with x3 = c4 x4 - s4 z5 and z3 = s4 x4 + c4 z5.
    alpha = -_FOREARM + _ELBOW * s4 - _UPPER * c4
    beta = _ELBOW - _ELBOW * c4 - _UPPER * s4

    # z5 = sin q6 x6 + cos q6 y6, and its product with S - O6 is alpha: q6 = arctan(along_x / along_y) +-
    # arccos(alpha / amplitude).
    along_x, along_y = dot(to_shoulder, x6), dot(to_shoulder, y6)
    amplitude = jnp.sqrt(along_x**2 + along_y**2)
    gap += jnp.maximum(jnp.abs(alpha) - amplitude, 0)
    amplitude = jnp.maximum(amplitude, 1e-9)
    cosine = jnp.clip(alpha / amplitude, -1, 1)
    c6, s6, cosine, sine = materialize((along_y / amplitude, along_x / amplitude, cosine, _sine_of(cosine)))

    # From here on axis 1 counts the two values of q6: the forearm folds either way about S - O6.
    side = jnp.asarray([1.0, -1.0], q7.dtype)[:, None]
    c6, s6 = materialize((c6 * cosine - side * s6 * sine, s6 * cosine + side * c6 * sine))
    x6, y6, z6, to_shoulder = x6[:, None], y6[:, None], z6[:, None], to_shoulder[:, None]
    z5, x5 = materialize((s6 * x6 + c6 * y6, c6 * x6 - s6 * y6))
    x4 = materialize((to_shoulder - alpha * z5) / jnp.where(jnp.abs(beta) < 1e-9, 1e-9, beta))
    # Joint 5 turns frame 4 (tilted so that its z is the forearm) into frame 5.
    q5 = arctan2(dot(x5, cross(z5, x4)), dot(x5, x4))
    x3, z3, q5 = materialize((c4 * x4 - s4 * z5, s4 * x4 + c4 * z5, q5))
    q6 = arctan2(s6, c6)
    q6 = jnp.where(q6 < -math.pi / 2, q6 + 2 * math.pi, q6)  # into [-pi/2, 3 pi/2), which holds the joint's range
    q4 = arctan2(s4, c4)
    q4 = jnp.where(q4 > 0, q4 - 2 * math.pi, q4)  # and into (-2 pi, 0]

    # And axis 2 the two signs of q2, which turn joints 1 and 3 by half a turn.
    across, length = jnp.sqrt(z3[0] ** 2 + z3[1] ** 2), jnp.sqrt(dot(z3, z3))
    q2, q1 = arctan2(across, z3[2]), arctan2(z3[1], z3[0])
    some = jnp.where(across > 0, across, 1)
    c1, s1 = jnp.where(across > 0, z3[0] / some, 1), z3[1] / some
    q3 = arctan2((c1 * x3[1] - s1 * x3[0]) * length, z3[2] * (c1 * x3[0] + s1 * x3[1]) - across * x3[2])
    q1, q2, q3 = materialize(
        (jnp.stack([q1, _half_turn(q1)], 1), jnp.stack([q2, -q2], 1), jnp.stack([q3, _half_turn(q3)], 1))
    )
    shape = q1.shape
    joints = (q1, q2, q3, q4, q5[:, None], q6[:, None], q7)
    q = materialize(jnp.stack([jnp.broadcast_to(angle, shape) for angle in joints]).reshape(7, BRANCHES, -1))
    lower, upper = (limit.astype(q.dtype)[:, None, None] for limit in load_arm().joint_limits)
    return q, gap + jnp.maximum(jnp.maximum(lower - q, q - upper).max(0), 0)


@Program
def shift_gripper(q: Array, arm: Array, up: Array, distance: Array) -> Array:
    """Joint angles with the gripper moved by ``distance`` [m] straight up, or back along its approach.

    Args:
        q: (L, 7) angles of one arm each [rad].
        arm: (L,) int, 0 left, 1 right.
        up: (L,) True: up, False: back.

    Returns:
        (L, 7): the solution nearest to ``q`` with the same last joint, or ``q`` itself where there is none within 1
        rad.
    """
    both = jnp.broadcast_to(q.T[:, None], (7, 2, q.shape[0]))
    R, p = (jnp.where(arm == 0, x[..., 0, :], x[..., 1, :]) for x in hand_pose(*link_poses(both)))
    straight = jnp.asarray([0.0, 0.0, 1.0], q.dtype)[:, None]
    solutions, failure = arm_angles(arm, R, p + distance * jnp.where(up, straight, -R[2]), q[:, 6])
    change = jnp.where(failure == 0, jnp.abs(solutions - q.T[:, None]).max(0), jnp.inf)
    best = jnp.argmin(change, axis=0)
    nearest = jnp.take_along_axis(solutions, best[None, None], axis=1)[:, 0]
    return jnp.where(change.min(0) < 1.0, nearest, q.T).T
