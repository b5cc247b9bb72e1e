"""Starts for the keyframe NLP: particles that are extended action by action along the tree of sequences.

The NLP has local minima (which way the elbow points, from which side the gripper comes, where on the table an object
is put), and one start near the home posture misses most feasible problems. So every prefix of a sequence keeps a few
dozen
*particles*: joint
angles at each switch and mode parameters that meet all switch constraints exactly, by closed-form inverse kinematics,
ranked by how deep things penetrate. A child's particles are sampled from its parent's: proposals of mode parameters,
inverse kinematics, distances, the best kept with a share for every parent. Sequences with a common prefix share its
particles.

Particles propose, the NLP decides: no verdict is taken here.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.compilation import COMPILER_OPTIONS
from dvr_jax.geometry.distances import Prism
from dvr_jax.geometry.vectors import Rotation, Vector, compose, materialize, rotate, rotation_about_z, vector
from dvr_jax.komo.contacts import measure_distances
from dvr_jax.komo.modes import Attachment, grasp_frame, object_poses
from dvr_jax.komo.problem import FIXED, HELD_LEFT, PARAMETERS
from dvr_jax.robot.inverse_kinematics import BRANCHES, arm_angles
from dvr_jax.robot.kinematics import capsule_segments, hand_pose, link_poses

PARTICLES = 16
"""Particles kept for each prefix."""
PROPOSALS = 32
"""Proposals for each particle."""
EVALUATED = 96
"""Proposals whose distances are computed: the best by inverse kinematics."""
LAST_JOINT_SAMPLES = 3
"""Values of q7 tried for each gripper pose."""

TUCKED = (0.0, -1.3, 0.0, -2.7, 0.0, 1.6, math.pi / 4)
"""A posture that keeps the resting arm out of the way [rad]; half of the proposals use it, the others the home
posture."""

_PITCH_RANGE = 1.75
UNREACHABLE = 10.0
"""Stands for the violation of a proposal without inverse kinematics [m]."""


class Particles(NamedTuple):
    """Particles of a batch of M prefixes; N objects, K_max switches at most."""

    kind: Array
    """(M, N) int: how each object is attached after the prefix (the same for all particles)."""
    face_yaw: Array
    """(M, N) yaw of the closing axis where an object is held [rad]."""
    parameters: Array
    """(M, B, N, 4) mode parameters that each object is attached by."""
    violation: Array
    """(M, B) sum of penetrations over the prefix's switches [m]."""
    q: Array
    """(M, B, K_max, 14) joint angles at the switches so far [rad]."""
    m: Array
    """(M, B, K_max, 4) mode parameters of the actions so far."""


class Extension(NamedTuple):
    """One action for each of M prefixes, as arrays."""

    half: Array
    """(M, N, 4) shapes of the objects."""
    initial_pose: Array
    """(M, N, 4)."""
    home: Array
    """(M, 14)."""
    opening: Array
    """(M, 2) of the phase that ends with this action."""
    depth: Array
    """(M,) int: number of the action."""
    arm: Array
    """(M,) int: the arm that acts."""
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


def no_particles(number_of_prefixes: int, number_of_objects: int, k_max: int, dtype: np.dtype) -> Particles:
    """Particles of the empty prefix."""
    M, N, B = number_of_prefixes, number_of_objects, PARTICLES
    return Particles(
        kind=jnp.full((M, N), FIXED),
        face_yaw=jnp.zeros((M, N), dtype),
        parameters=jnp.zeros((M, B, N, PARAMETERS), dtype),
        violation=jnp.zeros((M, B), dtype),
        q=jnp.zeros((M, B, k_max, 14), dtype),
        m=jnp.zeros((M, B, k_max, PARAMETERS), dtype),
    )


class _Proposed(NamedTuple):
    """Proposals (M, B, J): mode parameters, and the gripper poses that they ask of the acting and of the giving arm."""

    m: Array
    acting: tuple[Rotation, Vector]
    giving: tuple[Rotation, Vector] | None
    overhang: Array | float = 0.0
    """(M, B, J) by how much a placed object sticks out of its support [m]; it counts as violation."""


def _uniform(key: Array, shape: tuple[int, ...], low: Array | float, high: Array | float, dtype: np.dtype) -> Array:
    return low + (high - low) * jax.random.uniform(key, shape, dtype)


def _stack(m: tuple[Array, ...]) -> Array:
    return jnp.stack(jnp.broadcast_arrays(*m), axis=-1)


def _object_frame(particles: Particles, step: Extension) -> tuple[Array, Array]:
    """Mode parameters (4, M, B, 1) and attachment kind (M, 1, 1) of the object that the action switches."""
    index = step.item[:, None, None, None]
    parameters = jnp.take_along_axis(particles.parameters, index, axis=2)[:, :, 0]
    kind = jnp.take_along_axis(particles.kind, step.item[:, None], axis=1)
    return jnp.moveaxis(parameters, -1, 0)[..., None], kind[:, :, None]


def _of_item(value: Array, step: Extension) -> Array:
    """(M, N) to (M, 1, 1) for the switched object."""
    return jnp.take_along_axis(value, step.item[:, None], axis=1)[:, :, None]


def _sample_grasp(key: Array, step: Extension, shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Mode parameters of a grasp, (4, M, 1, J or more)."""
    keys = jax.random.split(key, 4)
    low, high = (bound[:, None, None] for bound in (step.lower, step.upper))
    yaw_range = jnp.minimum(high[..., 3], math.pi)
    return jnp.stack(jnp.broadcast_arrays(
        _uniform(keys[0], shape, low[..., 0], high[..., 0], dtype),
        _uniform(keys[1], shape, low[..., 1], high[..., 1], dtype),
        _uniform(keys[2], shape, -_PITCH_RANGE, _PITCH_RANGE, dtype),
        _uniform(keys[3], shape, -yaw_range, yaw_range, dtype),
    ))  # fmt: skip


def _propose_grasp(key: Array, particles: Particles, step: Extension, shape: tuple[int, ...]) -> _Proposed:
    """Grasps of a standing object."""
    dtype = particles.q.dtype
    m = _sample_grasp(key, step, shape, dtype)
    at, kind = _object_frame(particles, step)
    fixed = kind == FIXED
    x, y, z, yaw = (_of_item(step.initial_pose[..., i], step) for i in range(4))
    yaw = jnp.where(fixed, yaw, at[2])
    R = rotation_about_z(jnp.cos(yaw), jnp.sin(yaw))
    p = vector(jnp.where(fixed, x, at[0]), jnp.where(fixed, y, at[1]), z)
    R_hand, p_hand, _, _ = grasp_frame(m, step.face_yaw[:, None, None])
    return _Proposed(jnp.moveaxis(m, 0, -1), (compose(R, R_hand), p + rotate(R, p_hand)), None)


def _propose_handover(key: Array, particles: Particles, step: Extension, shape: tuple[int, ...]) -> _Proposed:
    """Grasps of an object that the other arm holds: where they meet is free, within reach of both."""
    dtype = particles.q.dtype
    keys = jax.random.split(key, 7)
    m = _sample_grasp(keys[0], step, shape, dtype)
    p = vector(
        _uniform(keys[1], shape, -0.25, 0.25, dtype),
        _uniform(keys[2], shape, -0.4, 0.4, dtype),
        _uniform(keys[3], shape, 0.15, 0.6, dtype),
    )
    yaw = _uniform(keys[4], shape, -math.pi, math.pi, dtype)
    tilt = 0.5 * jax.random.normal(keys[5], shape, dtype)
    axis = _uniform(keys[6], shape, -math.pi, math.pi, dtype)
    about, c, s = rotation_about_z(jnp.cos(axis), jnp.sin(axis)), jnp.cos(tilt), jnp.sin(tilt)
    zero = jnp.zeros_like(c)
    tip = jnp.stack([vector(zero + 1, zero, zero), vector(zero, c, s), vector(zero, -s, c)])
    spin = yaw - axis
    R = materialize(compose(compose(about, tip), rotation_about_z(jnp.cos(spin), jnp.sin(spin))))
    held_by, _ = _object_frame(particles, step)
    R_giver, p_giver, _, _ = grasp_frame(held_by, _of_item(particles.face_yaw, step))
    R_taker, p_taker, _, _ = grasp_frame(m, step.face_yaw[:, None, None])
    return _Proposed(
        jnp.moveaxis(m, 0, -1),
        (compose(R, R_taker), p + rotate(R, p_taker)),
        (compose(R, R_giver), p + rotate(R, p_giver)),
    )


def _propose_place(key: Array, particles: Particles, step: Extension, shape: tuple[int, ...]) -> _Proposed:
    """Placements of a held object: inside the support's rectangle, and on a large one within the arm's reach."""
    dtype = particles.q.dtype
    keys = jax.random.split(key, 5)
    support = [step.support[:, None, None, i] for i in range(5)]
    half = [_of_item(step.half[..., i], step) for i in range(4)]
    turn = _uniform(keys[0], shape, -math.pi, math.pi, dtype)
    # On a region that the object barely fits, only yaws along its sides are possible.
    quarter = jnp.floor(4 * jax.random.uniform(keys[1], shape, dtype)) * (math.pi / 2)
    turn = jnp.where(jax.random.uniform(keys[2], shape, dtype) < 0.5, quarter, turn)
    c, s = jnp.abs(jnp.cos(turn)), jnp.abs(jnp.sin(turn))
    spare_x = support[3] - (c * half[0] + s * half[1] + half[3])
    spare_y = support[4] - (s * half[0] + c * half[1] + half[3])
    room_x, room_y = jnp.maximum(spare_x, 0), jnp.maximum(spare_y, 0)
    # An object that does not fit at this yaw sticks out on both sides: no witness of feasibility.
    overhang = jnp.maximum(-spare_x, 0) + jnp.maximum(-spare_y, 0)
    u = _uniform(keys[3], (*shape, 2), -1.0, 1.0, dtype)
    along_x, along_y = u[..., 0] * room_x, u[..., 1] * room_y
    c, s = jnp.cos(support[2]), jnp.sin(support[2])
    x, y = support[0] + c * along_x - s * along_y, support[1] + s * along_x + c * along_y
    # A table is larger than the reach: in front of the arm instead, 0.3 to 0.8 m from its base.
    v = jax.random.uniform(keys[4], (*shape, 2), dtype)
    radius, angle = jnp.sqrt(0.3**2 + v[..., 0] * (0.8**2 - 0.3**2)), (2 * v[..., 1] - 1) * 1.6
    side = jnp.where(step.arm == 0, -1.0, 1.0).astype(dtype)[:, None, None]
    large = support[3] > 0.5
    x = jnp.where(large, jnp.clip(side * (0.6 - radius * jnp.cos(angle)), -room_x, room_x), x)
    y = jnp.where(large, jnp.clip(radius * jnp.sin(angle), -room_y, room_y), y)
    yaw = turn + support[2]
    R = rotation_about_z(jnp.cos(yaw), jnp.sin(yaw))
    held_by, _ = _object_frame(particles, step)
    R_hand, p_hand, _, _ = grasp_frame(held_by, _of_item(particles.face_yaw, step))
    p = vector(x, y, half[2]) + rotate(R, p_hand)
    return _Proposed(_stack((x, y, yaw, jnp.zeros_like(x))), (compose(R, R_hand), p), None, overhang)


def _reach(key: Array, arm: Array, pose: tuple[Rotation, Vector], home: Array) -> tuple[Array, Array]:
    """Best inverse kinematics for gripper poses (M, B, J): angles (M, B, J, 7) and a cost, `UNREACHABLE` where there
    is none.

    The best lies nearest to the home posture, which keeps clear of joint limits and leaves the elbow up."""
    shape, dtype = pose[1].shape[1:], pose[1].dtype
    n = LAST_JOINT_SAMPLES
    slots = (jnp.arange(n) + jax.random.uniform(key, (*shape, n), dtype)) / n
    q7 = (2 * slots - 1) * 2.8

    def flat(x: Array) -> Array:
        """(..., M, B, J) to (..., L)."""
        leading = x.shape[:-3]
        return jnp.broadcast_to(jnp.broadcast_to(x, (*leading, *shape))[..., None], (*leading, *shape, n)).reshape(
            *leading, -1
        )

    q, valid = arm_angles(flat(arm[:, None, None]), flat(pose[0]), flat(pose[1]), q7.reshape(-1))
    q = q.reshape(7, BRANCHES, *shape, n)
    near = jnp.take_along_axis(home.reshape(-1, 2, 7), arm[:, None, None], axis=1)[:, 0].T.reshape(7, 1, -1, 1, 1, 1)
    cost = 0.01 * ((q - near) ** 2).sum(0)
    cost = jnp.where(valid.reshape(BRANCHES, *shape, n), cost, UNREACHABLE)
    cost = jnp.moveaxis(cost, 0, -1).reshape(*shape, -1)
    best = jnp.argmin(cost, axis=-1)
    q = jnp.moveaxis(q, (0, 1), (-2, -1)).reshape(*shape, n, 7, BRANCHES)
    q = jnp.swapaxes(q, -1, -2).reshape(*shape, n * BRANCHES, 7)
    return jnp.take_along_axis(q, best[..., None, None], axis=-2)[..., 0, :], cost.min(-1)


@partial(jax.jit, static_argnames="case", compiler_options=COMPILER_OPTIONS)
def extend(particles: Particles, step: Extension, key: Array, case: str) -> Particles:
    """Particles of M prefixes, each one action longer. ``case`` ("grasp", "handover" or "place") holds for all of
    them."""
    M, N = particles.kind.shape
    B, J, dtype = PARTICLES, PROPOSALS, particles.q.dtype
    # The same numbers for each prefix: what a prefix gets does not depend on the batch that it is in.
    keys = jax.random.split(key, 4)
    shape = (1, B, J)
    propose = {"grasp": _propose_grasp, "handover": _propose_handover, "place": _propose_place}[case]
    proposed = propose(keys[0], particles, step, shape)
    acting: tuple[Rotation, Vector] = jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-3], M, B, J)), proposed.acting)
    q_acting, cost = _reach(keys[1], step.arm, materialize(acting), step.home)
    home = step.home.reshape(M, 2, 7)
    rest = jnp.take_along_axis(home, 1 - step.arm[:, None, None], axis=1)
    tucked = jnp.arange(J)[None, None, :, None] % 2 == 1
    q_other = jnp.where(tucked, jnp.asarray(TUCKED, dtype), rest[:, :, None])
    q_other = jnp.broadcast_to(q_other, q_acting.shape)
    if proposed.giving is not None:
        giving = jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-3], M, B, J)), proposed.giving)
        q_other, cost_giver = _reach(keys[2], 1 - step.arm, materialize(giving), step.home)
        cost = cost + cost_giver
    left = (step.arm == 0)[:, None, None, None]
    q = jnp.concatenate([jnp.where(left, q_acting, q_other), jnp.where(left, q_other, q_acting)], axis=-1)

    # Distances only for the best by inverse kinematics.
    overhang = jnp.broadcast_to(proposed.overhang, cost.shape)
    total = cost + overhang + particles.violation[:, :, None]
    E = EVALUATED
    _, chosen = jax.lax.top_k(-total.reshape(M, B * J), E)
    parent = chosen // J

    def gather(x: Array) -> Array:
        return jnp.take_along_axis(x.reshape(M, B * J, -1), chosen[..., None], axis=1)

    q, m = gather(q), gather(jnp.broadcast_to(proposed.m, (M, B, J, PARAMETERS)))
    cost = gather(cost)[..., 0]
    attached = jnp.take_along_axis(particles.parameters, parent[..., None, None], axis=1)
    penetration = _penetration(particles, step, q, attached)
    violation = jnp.where(cost >= UNREACHABLE, cost, penetration + gather(overhang)[..., 0])
    violation = violation + jnp.take_along_axis(particles.violation, parent, axis=1)

    # Keep the best, but give every parent its share: the k-th best child of one parent waits behind others.
    order = jnp.argsort(violation, axis=1)
    by_violation = jnp.take_along_axis(parent, order, axis=1)
    same = by_violation[:, :, None] == by_violation[:, None, :]
    rank = (same & (jnp.arange(E)[None, :, None] > jnp.arange(E)[None, None, :])).sum(2)
    # A grasp decides what can be reached later, so its variety is worth more penetration than a placement's [m].
    share = 0.01 if case != "place" else 0.003
    kept = jnp.take_along_axis(violation, order, axis=1) + share * rank.astype(dtype)
    _, best = jax.lax.top_k(-kept, B)
    index = jnp.take_along_axis(order, best, axis=1)
    parent = jnp.take_along_axis(parent, index, axis=1)

    def from_parent(x: Array) -> Array:
        return jnp.take_along_axis(x, parent.reshape(M, B, *(1,) * (x.ndim - 2)), axis=1)

    q_new = jnp.take_along_axis(q, index[..., None], axis=1)
    m_new = jnp.take_along_axis(m, index[..., None], axis=1)
    depth = jnp.arange(particles.q.shape[2])[None, None, :, None] == step.depth[:, None, None, None]
    item = jnp.arange(N)[None] == step.item[:, None]
    return Particles(
        kind=jnp.where(item, step.new_kind[:, None], particles.kind),
        face_yaw=jnp.where(item, step.face_yaw[:, None], particles.face_yaw),
        parameters=jnp.where(item[:, None, :, None], m_new[:, :, None], from_parent(particles.parameters)),
        violation=jnp.take_along_axis(violation, index, axis=1),
        q=jnp.where(depth, q_new[:, :, None], from_parent(particles.q)),
        m=jnp.where(depth, m_new[:, :, None], from_parent(particles.m)),
    )


def _penetration(particles: Particles, step: Extension, q: Array, parameters: Array) -> Array:
    """Sum of penetrations (M, E) [m] at the switch slice, for joint angles (M, E, 14) and object parameters (M, E, N,
    4)."""
    M, E = q.shape[:2]
    N, L = particles.kind.shape[1], M * E
    angles = jnp.moveaxis(q.reshape(L, 2, 7), (0, 1, 2), (2, 1, 0))
    rotations, positions = link_poses(angles)

    def each(value: Array) -> Array:
        """(M, N) to (N, L)."""
        return jnp.repeat(value, E, axis=0).T

    a, b = materialize(capsule_segments(rotations, positions, each(step.opening)))
    hands = materialize(hand_pose(rotations, positions))
    attached = Attachment(
        kind=each(particles.kind),
        parameters=parameters.reshape(L, N, PARAMETERS).transpose(2, 1, 0),
        face_yaw=each(particles.face_yaw),
        initial=jnp.stack([each(step.initial_pose[..., i]) for i in range(4)]),
        half_height=each(step.half[..., 2]),
    )
    objects = materialize(object_poses(attached, *hands))
    half: Prism = jnp.stack([each(step.half[..., i]) for i in range(4)])
    distances = measure_distances(a, b, objects, half, attached.kind)
    rows = jnp.concatenate([distances.arm, distances.object])
    return jnp.maximum(-rows, 0).sum(0).reshape(M, E)


def case_of(kind_before: int, is_grasp: bool) -> str:
    """Which proposals an action takes: "grasp", "handover" or "place"."""
    if not is_grasp:
        return "place"
    return "handover" if kind_before >= HELD_LEFT else "grasp"
