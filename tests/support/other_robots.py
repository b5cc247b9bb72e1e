"""Robots that only tests define: a Panda with a longer forearm, and an arm of six joints with a spherical wrist.

The second one is a shoulder that turns about the vertical, an elbow arm in a vertical plane, and three wrist axes that
meet in one point W. With the columns of link frame 6 as R, its rotation is

    R = Rz(q1) Ry(q2 + q3) Rz(q4) Ry(q5) Rz(q6),

and W = p - REACH z6 lies at ``Rz(q1) (UPPER (sin q2, 0, cos q2) + FOREARM (sin(q2 + q3), 0, cos(q2 + q3)))`` above the
shoulder. So W gives q1 to q3 by the law of cosines, and the wrist's angles are those of Euler (z, y, z).
"""

from __future__ import annotations

import math
from itertools import product

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.angles import arctan2
from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Rotation, Vector, materialize
from dvr_jax.workcell.model import WorkcellModel
from dvr_jax.workcell.panda import PANDA
from dvr_jax.workcell.robot import InverseKinematics, Robot

SHOULDER = 0.40
UPPER = 0.42
FOREARM = 0.40
REACH = 0.2104
"""From the wrist's point W to the gripper center [m]."""


def _longer_forearm(mjcf: str) -> str:
    """The Panda with 5 cm more between elbow and wrist: the joint, and the capsule that covers the link."""
    for before, after in (
        ('pos="-0.0825 0.384 0"', 'pos="-0.0825 0.434 0"'),
        (
            'fromto="0 0.0104 -0.2438 0 0.064 0.003"',
            'fromto="0 0.0104 -0.2938 0 0.064 0.003"',
        ),
        ('<mujoco model="panda">', '<mujoco model="long_panda">'),
    ):
        assert mjcf.count(before) == 1
        mjcf = mjcf.replace(before, after)
    return mjcf


LONG_PANDA = Robot("long-panda", _longer_forearm(PANDA.mjcf), PANDA.inverse_kinematics)

SIX_JOINTS_MJCF = """
<mujoco model="six_joints">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <default class="arm">
      <joint axis="0 0 1" damping="5" armature="0.1"/>
      <geom type="capsule" group="3" contype="1" conaffinity="1" density="800" rgba="0.3 0.5 0.9 1"/>
      <default class="visual">
        <geom type="sphere" group="2" contype="2" conaffinity="0" size="0.04" density="800"/>
      </default>
    </default>
  </default>
  <worldbody>
    <body name="base" childclass="arm">
      <geom name="column_collision" fromto="0 0 0.05 0 0 0.40" size="0.07"/>
      <geom class="visual" pos="0 0 0.1"/>
      <body name="link1" pos="0 0 0.40">
        <joint name="joint1" range="-2.9 2.9"/>
        <geom class="visual"/>
        <body name="link2" euler="-1.5707963267948966 0 0">
          <joint name="joint2" range="-2.0 2.0"/>
          <geom name="upper_arm_collision" fromto="0 0 0 0 -0.42 0" size="0.05"/>
          <geom class="visual" pos="0 -0.2 0"/>
          <body name="link3" pos="0 -0.42 0">
            <joint name="joint3" range="-2.6 2.6"/>
            <geom name="forearm_collision" fromto="0 0 0 0 -0.32 0" size="0.045"/>
            <geom class="visual" pos="0 -0.2 0"/>
            <body name="link4" pos="0 -0.40 0" euler="1.5707963267948966 0 0">
              <joint name="joint4" range="-3.1 3.1"/>
              <geom class="visual"/>
              <body name="link5" euler="-1.5707963267948966 0 0">
                <joint name="joint5" range="-2.1 2.1"/>
                <geom class="visual"/>
                <body name="link6" euler="1.5707963267948966 0 0">
                  <joint name="joint6" range="-3.1 3.1"/>
                  <geom name="flange_collision" fromto="0 0 0.07 0 0 0.09" size="0.04"/>
                  <geom class="visual" pos="0 0 0.06"/>
                  <body name="hand" pos="0 0 0.107">
                    <geom name="hand_collision" fromto="0 -0.073 0.033 0 0.073 0.033" size="0.036"/>
                    <site name="gripper" pos="0 0 0.1034" size="0.005" group="4"/>
                    <body name="finger_left" pos="0 0 0.0584">
                      <joint name="finger_joint_left" type="slide" axis="0 1 0" range="0 0.04" damping="20"/>
                      <geom name="finger_left_collision" fromto="0 0.0105 0.0036 0 0.0105 0.045" size="0.0105"/>
                    </body>
                    <body name="finger_right" pos="0 0 0.0584">
                      <joint name="finger_joint_right" type="slide" axis="0 -1 0" range="0 0.04" damping="20"/>
                      <geom name="finger_right_collision" fromto="0 -0.0105 0.0036 0 -0.0105 0.045" size="0.0105"/>
                    </body>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact>
    <exclude body1="base" body2="link2"/>
    <exclude body1="finger_left" body2="finger_right"/>
  </contact>
  <custom>
    <numeric name="joint_velocity" data="2 2 2 3 3 3"/>
    <numeric name="joint_acceleration" data="10 10 10 15 15 15"/>
    <numeric name="finger_speed" data="0.05"/>
    <numeric name="home" data="0 -0.2 1.9 0 1.4415926535897931 0"/>
    <numeric name="tucked" data="0 -0.7 2.2 0 1.6415926535897931 0"/>
    <numeric name="base_foot" data="0.085 0.125 0.11"/>
    <text name="holding" data="hand finger_left finger_right"/>
    <text name="above_table" data="forearm flange hand finger_left finger_right"/>
    <text name="self_collision" data="
      column : forearm flange hand finger_left finger_right ;
      upper_arm forearm : flange hand finger_left finger_right"/>
  </custom>
</mujoco>
"""


def six_joint_angles(
    model: WorkcellModel, R: Rotation, p: Vector, free: Float[Array, "0 lanes"]
) -> tuple[Float[Array, "6 8 lanes"], Float[Array, "8 lanes"]]:
    """The closed-form inverse kinematics: shoulder in front or behind, elbow up or down, wrist flipped or not."""
    x6, y6, z6 = R
    wrist = materialize(p - REACH * z6)
    height = wrist[2] - SHOULDER
    horizontal = jnp.sqrt(wrist[0] ** 2 + wrist[1] ** 2)
    squares = horizontal**2 + height**2
    cosine = (squares - UPPER**2 - FOREARM**2) / (2 * UPPER * FOREARM)
    gap = jnp.maximum(jnp.abs(cosine) - 1, 0)
    cosine = jnp.clip(cosine, -1, 1)
    sine = jnp.sqrt((1 - cosine) * (1 + cosine))

    solutions = []
    for front, elbow, flip in product((1.0, -1.0), repeat=3):
        q1 = arctan2(front * wrist[1], front * wrist[0])
        q3 = arctan2(elbow * sine, cosine)
        tilt = arctan2(elbow * FOREARM * sine, UPPER + FOREARM * cosine)
        q2 = _wrapped(arctan2(front * horizontal, height) - tilt)
        wrist_angles = _euler_angles(x6, y6, z6, q1, q2 + q3, flip)
        solutions.append(jnp.stack([q1, q2, q3, *wrist_angles]))
    q = materialize(jnp.stack(solutions, axis=1))

    lower, upper = (limit[:, None, None] for limit in jnp.asarray(model.joint_limits, q.dtype))
    return q, gap + jnp.maximum(jnp.maximum(lower - q, q - upper).max(0), 0)


def _euler_angles(
    x6: Vector, y6: Vector, z6: Vector, q1: Array, forearm: Array, flip: float
) -> tuple[Array, ...]:
    """The angles of ``Rz Ry Rz`` of frame 6 in the frame of the forearm."""
    c1, s1, cf, sf = materialize((jnp.cos(q1), jnp.sin(q1), jnp.cos(forearm), jnp.sin(forearm)))

    def in_forearm(v: Vector) -> Vector:
        along = c1 * v[0] + s1 * v[1]
        return jnp.stack([cf * along - sf * v[2], c1 * v[1] - s1 * v[0], sf * along + cf * v[2]])

    x, y, z = (in_forearm(v) for v in (x6, y6, z6))
    across = jnp.sqrt(z[0] ** 2 + z[1] ** 2)
    return (
        arctan2(flip * z[1], flip * z[0]),
        arctan2(flip * across, z[2]),
        arctan2(flip * y[2], -flip * x[2]),
    )


def _wrapped(angle: Array) -> Array:
    """The same angle in [-pi, pi]."""
    return angle - 2 * math.pi * jnp.round(angle / (2 * math.pi))


SIX_JOINTS = Robot("six-joints", SIX_JOINTS_MJCF, InverseKinematics(six_joint_angles, branches=8))
