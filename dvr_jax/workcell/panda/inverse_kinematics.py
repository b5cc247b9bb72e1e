"""Closed-form inverse kinematics of a Panda arm, with the last joint's angle as the free parameter.

The Panda's wrist is offset (a7 = 8.8 cm), so there is no spherical wrist; but once q7 is chosen, the center O6 of
joint 6 is known, and shoulder S, elbow O4 and O6 form a triangle with two known sides. What is left are two choices of
two: which way the forearm folds about the line S - O6 (two roots of one trigonometric equation in q6) and which way
the shoulder turns (q2 and -q2). Derived here from Franka's Denavit-Hartenberg table; the same decomposition is in He
and Liu, "Analytical inverse kinematics for Franka Emika Panda", 2021.

Notation: x_i, y_i, z_i are the axes of link frame i, O_i its origin; c and s stand for a cosine and a sine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.angles import arctan2
from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Rotation, Vector, cross, dot, materialize
from dvr_jax.workcell.model import WorkcellModel

BRANCHES = 4
"""Solutions for each value of q7."""


class _Lengths(NamedTuple):
    """Constants of the arm, from its link transforms."""

    shoulder_height: Array
    """d1 [m]."""

    upper: Array
    """d3 [m]."""

    elbow: Array
    """a4 [m]; a5 is its negative."""

    forearm: Array
    """d5 [m]."""

    wrist: Array
    """a7 [m]."""

    reach: Array
    """From link frame 7 to the gripper center along z [m]."""

    hand_cosine: Array
    hand_sine: Array
    """Turn of the hand about the axis of link 7."""

    sum_of_squares: Array
    """a^2 + b^2 for the known sides of the triangle: a from the shoulder to the elbow's joint, and b from there to the
    wrist [m^2]."""

    double_product: Array
    """2 a b [m^2]."""

    cosine_at_zero: Array
    sine_at_zero: Array
    """Of the angle in the triangle at the elbow for q4 = 0. In the plane of the triangle, with O4 as origin and (x3,
    z3) as axes, S lies at (-a4, -d3), and O6 at (-a4, d5) turned by q4."""


class _Wrist(NamedTuple):
    """The wrist for a chosen q7."""

    x6: Vector
    y6: Vector
    to_shoulder: Vector
    """S - O6 [m]."""


class _Triangle(NamedTuple):
    """The triangle of shoulder, elbow and wrist."""

    c4: Array
    s4: Array
    alpha: Array
    """S - O6 along z5, the forearm [m]."""

    beta: Array
    """S - O6 along x4 [m]."""

    gap: Array
    """By how much the triangle fails to close, a difference of cosines; 0 where it closes."""


class _Elbow(NamedTuple):
    """Elbow and joints 4 to 6, for both ways in which the forearm may fold."""

    q4: Array
    q5: Array
    q6: Array
    x3: Vector
    z3: Vector
    gap: Array
    """By how much the pose is out of reach; 0 where it is not."""


def arm_angles(
    model: WorkcellModel,
    R: Rotation,
    p: Vector,
    free: Float[Array, "1 lanes"],
) -> tuple[Float[Array, "7 4 lanes"], Float[Array, "4 lanes"]]:
    """Joint angles that bring a gripper to poses in the frame of its arm's base.

    Two values of q4, on either side of -0.467 rad, give the same distance from shoulder to wrist; only the more bent
    one is taken. The others hold the wrist within 1.4 cm of its greatest distance.

    Args:
        model: Arms of the workcell, Pandas.
        R: Axes of the gripper (3, 3, L): y closes, z approaches.
        p: Gripper center (3, L) [m].
        free: Angle q7 of the last joint [rad].

    Returns:
        Angles [rad], and by how much each branch fails: 0 where it reaches the pose within the joint limits; else how
        far the triangle is from closing (a difference of cosines or of lengths [m]) plus the largest excess over a
        limit [rad], and the angles are those of the nearest closed triangle.
    """
    q7 = free[0]
    lengths = _lengths(model, q7.dtype)
    wrist = _place_wrist(lengths, R, p, q7)
    elbow = _fold_forearm(lengths, wrist, _close_triangle(lengths, wrist.to_shoulder))
    q1, q2, q3 = _turn_shoulder(elbow.x3, elbow.z3)

    joints = (q1, q2, q3, elbow.q4, elbow.q5[:, None], elbow.q6[:, None], q7)
    q = jnp.stack([jnp.broadcast_to(angle, q1.shape) for angle in joints])
    q = materialize(q.reshape(7, BRANCHES, -1))
    lower, upper = (limit[:, None, None] for limit in jnp.asarray(model.joint_limits, q.dtype))
    return q, elbow.gap + jnp.maximum(jnp.maximum(lower - q, q - upper).max(0), 0)


def _lengths(model: WorkcellModel, dtype: jnp.dtype) -> _Lengths:
    """Constants of the arm, computed in the precision of the model."""
    offsets = jnp.asarray(model.link_offsets)
    upper = -offsets[2, 1]
    elbow = offsets[3, 0]
    forearm = offsets[4, 1]
    hand = jnp.asarray(model.hand_rotation)
    side_upper = jnp.hypot(upper, elbow)
    side_forearm = jnp.hypot(forearm, elbow)
    angle_at_zero = jnp.arctan2(forearm, -elbow) - jnp.arctan2(-upper, -elbow)
    values = _Lengths(
        shoulder_height=offsets[0, 2],
        upper=upper,
        elbow=elbow,
        forearm=forearm,
        wrist=offsets[6, 0],
        reach=jnp.asarray(model.gripper_center)[2],
        hand_cosine=hand[0, 0],
        hand_sine=hand[0, 1],
        sum_of_squares=side_upper**2 + side_forearm**2,
        double_product=2 * side_upper * side_forearm,
        cosine_at_zero=jnp.cos(angle_at_zero),
        sine_at_zero=jnp.sin(angle_at_zero),
    )
    return materialize(_Lengths(*(value.astype(dtype) for value in values)))


def _place_wrist(lengths: _Lengths, R: Rotation, p: Vector, q7: Array) -> _Wrist:
    """Frame 6 and the way to the shoulder, for a chosen q7."""
    # Columns of link frame 7 from those of the hand: R_7 = R_hand hand_rotation^T, a turn about z.
    x7 = lengths.hand_cosine * R[0] + lengths.hand_sine * R[1]
    x7, z7, center = materialize((x7, R[2], p))
    y7 = cross(z7, x7)
    c7, s7 = materialize((jnp.cos(q7), jnp.sin(q7)))
    x6 = materialize(c7 * x7 - s7 * y7)

    O6 = materialize(center - lengths.reach * z7 - lengths.wrist * x6)
    to_shoulder = materialize(jnp.stack([-O6[0], -O6[1], lengths.shoulder_height - O6[2]]))
    return _Wrist(x6, -z7, to_shoulder)


def _close_triangle(lengths: _Lengths, to_shoulder: Vector) -> _Triangle:
    """Law of cosines at the elbow."""
    distance = jnp.sqrt(dot(to_shoulder, to_shoulder))
    cosine = (lengths.sum_of_squares - distance**2) / lengths.double_product
    gap = jnp.maximum(jnp.abs(cosine) - 1, 0)

    # Sines and cosines come from those of parts of an angle, not from the angle: q4 = arccos(cosine) - a constant.
    cosine = jnp.clip(cosine, -1, 1)
    sine = _sine_of(cosine)
    c4 = cosine * lengths.cosine_at_zero + sine * lengths.sine_at_zero
    s4 = sine * lengths.cosine_at_zero - cosine * lengths.sine_at_zero
    c4, s4 = materialize((c4, s4))

    # O4 - O6 = a4 x4 - d5 z5 and S - O4 = -a4 x3 - d3 z3, with x3 = c4 x4 - s4 z5 and z3 = s4 x4 + c4 z5.
    alpha = -lengths.forearm + lengths.elbow * s4 - lengths.upper * c4
    beta = lengths.elbow - lengths.elbow * c4 - lengths.upper * s4
    return _Triangle(c4, s4, alpha, beta, gap)


def _fold_forearm(lengths: _Lengths, wrist: _Wrist, triangle: _Triangle) -> _Elbow:
    """Joints 4 to 6: the forearm folds either way about the line from wrist to shoulder, on axis 1 of the results.

    The forearm is z5 = sin q6 x6 + cos q6 y6, and its product with S - O6 is alpha:
    q6 = arctan(along_x / along_y) +- arccos(alpha / amplitude).
    """
    along_x = dot(wrist.to_shoulder, wrist.x6)
    along_y = dot(wrist.to_shoulder, wrist.y6)
    amplitude = jnp.sqrt(along_x**2 + along_y**2)
    gap = triangle.gap + jnp.maximum(jnp.abs(triangle.alpha) - amplitude, 0)
    amplitude = jnp.maximum(amplitude, 1e-9)
    cosine = jnp.clip(triangle.alpha / amplitude, -1, 1)
    c6, s6, cosine, sine = materialize(
        (along_y / amplitude, along_x / amplitude, cosine, _sine_of(cosine))
    )

    side = jnp.asarray([1.0, -1.0], c6.dtype)[:, None]
    c6, s6 = materialize((c6 * cosine - side * s6 * sine, s6 * cosine + side * c6 * sine))
    x6, y6, to_shoulder = (vector[:, None] for vector in wrist)
    z5, x5 = materialize((s6 * x6 + c6 * y6, c6 * x6 - s6 * y6))
    beta = jnp.where(jnp.abs(triangle.beta) < 1e-9, 1e-9, triangle.beta)
    x4 = materialize((to_shoulder - triangle.alpha * z5) / beta)

    # Joint 5 turns frame 4 (tilted so that its z is the forearm) into frame 5.
    q5 = arctan2(dot(x5, cross(z5, x4)), dot(x5, x4))
    x3 = triangle.c4 * x4 - triangle.s4 * z5
    z3 = triangle.s4 * x4 + triangle.c4 * z5
    x3, z3, q5 = materialize((x3, z3, q5))

    # q6 into [-pi/2, 3 pi/2), which holds the joint's range, and q4 into (-2 pi, 0].
    q6 = arctan2(s6, c6)
    q6 = jnp.where(q6 < -math.pi / 2, q6 + 2 * math.pi, q6)
    q4 = arctan2(triangle.s4, triangle.c4)
    q4 = jnp.where(q4 > 0, q4 - 2 * math.pi, q4)
    return _Elbow(q4, q5, q6, x3, z3, jnp.repeat(gap[None], BRANCHES, axis=0))


def _turn_shoulder(x3: Vector, z3: Vector) -> tuple[Array, Array, Array]:
    """Joints 1 to 3, with the two signs of q2 on a further axis, which turn joints 1 and 3 by half a turn."""
    across = jnp.sqrt(z3[0] ** 2 + z3[1] ** 2)
    length = jnp.sqrt(dot(z3, z3))
    q2 = arctan2(across, z3[2])
    q1 = arctan2(z3[1], z3[0])
    some = jnp.where(across > 0, across, 1)
    c1 = jnp.where(across > 0, z3[0] / some, 1)
    s1 = z3[1] / some
    along = c1 * x3[0] + s1 * x3[1]
    q3 = arctan2((c1 * x3[1] - s1 * x3[0]) * length, z3[2] * along - across * x3[2])
    return materialize(
        (
            jnp.stack([q1, _opposite(q1)], 1),
            jnp.stack([q2, -q2], 1),
            jnp.stack([q3, _opposite(q3)], 1),
        )
    )


def _sine_of(cosine: Array) -> Array:
    """Sine of the angle in [0, pi] with this cosine, which is within [-1, 1]."""
    return jnp.sqrt((1 - cosine) * (1 + cosine))


def _opposite(angle: Array) -> Array:
    """The opposite direction, in [-pi, pi] as ``angle`` is."""
    return jnp.where(angle > 0, angle - math.pi, angle + math.pi)
