"""Random mode parameters for one action, and the gripper poses that they ask for.

Batch axes are (M, B, J): prefixes, particles of each, proposals for each particle. Random numbers come in as an array
``u`` of uniform numbers in [0, 1), `NUMBERS` for each (B, J), the same for every prefix: what a prefix gets does not
depend on the batch that it is in."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import Rotation, Vector, compose, materialize, rotate, rotation_about_z, vector
from dvr_jax.modes.poses import grasp_frame
from dvr_jax.nlp.problem import FIXED
from dvr_jax.runtime.compilation import Program

NUMBERS = 10
"""Uniform numbers that a proposal takes."""

PITCH_RANGE = 1.75
"""Largest tilt of a proposed approach from straight down [rad]: 10 degrees past the horizontal."""

LARGEST_GRASP = (1e3, 1e3, PITCH_RANGE, math.pi)
"""Largest mode parameters of a proposed grasp, where its own bounds are wider [m, m, rad, rad]."""

MEETING = ((-0.25, 0.25), (-0.4, 0.4), (0.15, 0.6))
"""Box in which objects are handed over [m]: within reach of both arms."""

MEETING_TILT = 0.8
"""Largest tilt of an object that is handed over [rad]."""

PLACING_RADIUS = (0.3, 0.8)
"""Distances from its base at which an arm puts things on the table [m]."""


class BeamStep(NamedTuple):
    """One action for each of M prefixes, as arrays."""

    half: Array
    """(M, N, 4) shapes of the objects."""
    initial_pose: Array
    """(M, N, 4)."""
    home: Array
    """(M, 14)."""
    opening: Array
    """(M, 2) of the switch."""
    depth: Array
    """(M,) int: number of the action."""
    arm: Array
    """(M,) int: the arm that acts."""
    base: Array
    """(M, 2) where it stands [m]."""
    item: Array
    """(M,) int: the object that it switches."""
    new_kind: Array
    """(M,) int: how the object is attached afterwards."""
    face_yaw: Array
    """(M,)."""
    lower: Array
    """(M, 4)."""
    upper: Array
    """(M, 4)."""
    support: Array
    """(M, 5)."""
    share: Array
    """(M,) violation that a further child of the same parent must be better by [m]."""


class Holding(NamedTuple):
    """How the switched object is attached before the action, in every particle."""

    kind: Array
    """(M,) int."""
    face_yaw: Array
    """(M,) where it is held [rad]."""
    parameters: Array
    """(M, B, 4)."""


class Proposed(NamedTuple):
    """Mode parameters and gripper poses."""

    m: Array
    """(4, M, B, J)."""
    R: Rotation
    """(G, 3, 3, M, B, J) of the acting gripper; in a handover (G = 2) the giving one's after it."""
    p: Vector
    """(G, 3, M, B, J)."""
    overhang: Array
    """(M, B, J) by how much a placed object sticks out of its support [m]; it counts as violation."""


def _of_item(value: Array, step: BeamStep) -> Array:
    """(M, N) to (M, 1, 1) for the switched object."""
    return jnp.take_along_axis(value, step.item[:, None], axis=1)[:, :, None]


def _held_frame(holding: Holding) -> tuple[Rotation, Vector]:
    """Gripper that holds the object, in the object's frame, (M, B, 1)."""
    parameters = jnp.moveaxis(holding.parameters, -1, 0)[..., None]
    R, p, _, _ = materialize(grasp_frame(parameters, holding.face_yaw[:, None, None]))
    return R, p


def _sample_grasp(step: BeamStep, u: Array) -> tuple[Array, Rotation, Vector]:
    """Mode parameters (4, M, B, J) within their bounds, and the gripper in the object's frame."""
    wide = jnp.asarray(LARGEST_GRASP, u.dtype)
    low, high = (jnp.clip(bound, -wide, wide).T[..., None, None] for bound in (step.lower, step.upper))
    m = materialize(low + (high - low) * u[:4, None])
    R, p, _, _ = materialize(grasp_frame(m, step.face_yaw[:, None, None]))
    return m, R, p


def _compose(R: Rotation, p: Vector, R_hand: Rotation, p_hand: Vector, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """World pose of a gripper, from that of the object."""
    R_world, p_world = materialize((compose(R, R_hand), p + rotate(R, p_hand)))
    return jnp.broadcast_to(R_world, (3, 3, *shape)), jnp.broadcast_to(p_world, (3, *shape))


@Program
def propose_grasp(step: BeamStep, holding: Holding, u: Array) -> Proposed:
    """Grasps of a standing object."""
    m, R_hand, p_hand = _sample_grasp(step, u)
    fixed = (holding.kind == FIXED)[:, None, None]
    at = jnp.moveaxis(holding.parameters, -1, 0)[..., None]
    x, y, z, yaw = (_of_item(step.initial_pose[..., i], step) for i in range(4))
    yaw = jnp.where(fixed, yaw, at[2])
    R = rotation_about_z(*materialize((jnp.cos(yaw), jnp.sin(yaw))))
    p = vector(jnp.where(fixed, x, at[0]), jnp.where(fixed, y, at[1]), z)
    R, p = _compose(R, p, R_hand, p_hand, m.shape[1:])
    return Proposed(m, R[None], p[None], jnp.zeros_like(m[0]))


@Program
def propose_handover(step: BeamStep, holding: Holding, u: Array) -> Proposed:
    """Grasps of an object that the other arm holds: where they meet is free, within reach of both."""
    m, R_taker, p_taker = _sample_grasp(step, u)
    p = vector(*(low + (high - low) * u[4 + i] for i, (low, high) in enumerate(MEETING)))[:, None]
    # Turned by `yaw` and tilted about a horizontal axis.
    yaw, axis = 2 * math.pi * u[7], 2 * math.pi * u[8]
    angles = jnp.stack([axis, MEETING_TILT * u[9], yaw - axis])
    (ca, ct, cy), (sa, st, sy) = materialize((jnp.cos(angles), jnp.sin(angles)))
    zero = jnp.zeros_like(ca)
    tip = jnp.stack([vector(zero + 1, zero, zero), vector(zero, ct, st), vector(zero, -st, ct)])
    R = materialize(compose(materialize(compose(rotation_about_z(ca, sa), tip)), rotation_about_z(cy, sy)))[:, :, None]
    shape = m.shape[1:]
    poses = [_compose(R, p, *hand, shape) for hand in ((R_taker, p_taker), _held_frame(holding))]
    rotations, positions = zip(*poses, strict=True)
    return Proposed(m, jnp.stack(rotations), jnp.stack(positions), jnp.zeros_like(m[0]))


@Program
def propose_place(step: BeamStep, holding: Holding, u: Array) -> Proposed:
    """Placements of a held object: inside the support's rectangle, and on a large one within the arm's reach."""
    support = [step.support[:, None, None, i] for i in range(5)]
    half = [_of_item(step.half[..., i], step) for i in range(4)]
    # On a region that the object barely fits, only yaws along its sides are possible.
    turn = jnp.where(u[1] < 0.5, jnp.floor(4 * u[0]) * (math.pi / 2), 2 * math.pi * u[0])
    c, s = jnp.abs(jnp.cos(turn)), jnp.abs(jnp.sin(turn))
    spare_x = support[3] - (c * half[0] + s * half[1] + half[3])
    spare_y = support[4] - (s * half[0] + c * half[1] + half[3])
    room_x, room_y = jnp.maximum(spare_x, 0), jnp.maximum(spare_y, 0)
    # An object that does not fit at this yaw sticks out on both sides: no witness of feasibility.
    overhang = jnp.maximum(-spare_x, 0) + jnp.maximum(-spare_y, 0)
    along_x, along_y = (2 * u[2] - 1) * room_x, (2 * u[3] - 1) * room_y
    c, s = jnp.cos(support[2]), jnp.sin(support[2])
    # A table is larger than the reach: in front of the arm instead, as far as the support goes.
    near, far = PLACING_RADIUS
    radius, angle = jnp.sqrt(near**2 + u[2] * (far**2 - near**2)), (2 * u[3] - 1) * 1.6
    base_x, base_y = (step.base[:, None, None, i] for i in range(2))
    large = support[3] > 0.5
    ahead_x = base_x - jnp.sign(base_x) * radius * jnp.cos(angle) - support[0]
    ahead_y = base_y + radius * jnp.sin(angle) - support[1]
    along_x = jnp.where(large, jnp.clip(c * ahead_x + s * ahead_y, -room_x, room_x), along_x)
    along_y = jnp.where(large, jnp.clip(c * ahead_y - s * ahead_x, -room_y, room_y), along_y)
    x, y = support[0] + c * along_x - s * along_y, support[1] + s * along_x + c * along_y
    yaw = turn + support[2]
    x, y, yaw = materialize((x, y, jnp.broadcast_to(yaw, x.shape)))
    R = rotation_about_z(*materialize((jnp.cos(yaw), jnp.sin(yaw))))
    shape = (*x.shape[:1], holding.parameters.shape[1], *x.shape[2:])
    R, p = _compose(R, vector(x, y, half[2]), *_held_frame(holding), shape)
    m = jnp.stack(jnp.broadcast_arrays(x, y, yaw, jnp.zeros_like(x)))
    return Proposed(jnp.broadcast_to(m, (4, *shape)), R[None], p[None], jnp.broadcast_to(overhang, shape))


PROPOSE = {"grasp": propose_grasp, "handover": propose_handover, "place": propose_place}
"""Proposals by the case of an action."""
