"""Starts for the keyframe NLP: particles that are extended action by action along the tree of sequences.

The NLP has local minima (which way the elbow points, from which side the gripper comes, where on the table an object
is put), and one start near the home posture misses most feasible problems. So every prefix of a sequence keeps a few
*particles*: joint angles at each switch and mode parameters that meet all switch constraints exactly, by closed-form
inverse kinematics, ranked by how deep things penetrate. A child's particles are sampled from its parent's: proposals
of mode parameters, inverse kinematics, distances, the best kept with a share for every parent. Sequences with a common
prefix share its particles.

KeyframeBeam propose. One that touches nothing is a feasible point by itself (`dvr_jax.search.node_solver.CERTIFIED_PENETRATION`); in all
other cases the NLP decides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from dvr_jax.geometry.vectors import Rotation, Vector, materialize
from dvr_jax.modes.poses import Attachment
from dvr_jax.nlp.problem import FIXED, HELD_LEFT, PARAMETERS, Problem
from dvr_jax.nlp.slices import Slices, measure
from dvr_jax.runtime.compilation import Program
from dvr_jax.seeds.proposals import LARGEST_GRASP, NUMBERS, PROPOSE, BeamStep, Holding
from dvr_jax.workcell.kinematics import load_arm
from dvr_jax.workcell.panda.inverse_kinematics import BRANCHES, arm_angles

BEAM_WIDTH = 16
"""KeyframeBeam kept for each prefix."""
PROPOSALS = 32
"""Proposals for each particle."""
EVALUATED = 96
"""Proposals whose distances are computed: the best by inverse kinematics."""
LAST_JOINT_SAMPLES = 3
"""Values of q7 tried for each gripper pose."""

TUCKED = (0.0, -1.3, 0.0, -2.7, 0.0, 1.6, math.pi / 4)
"""A posture that keeps the resting arm out of the way [rad]; half of the proposals use it, the others the home
posture."""

UNREACHABLE = 10.0
"""Stands for the violation of a proposal without inverse kinematics [m]."""

SIBLING_PENALTY = {"grasp": 0.01, "handover": 0.01, "place": 0.003}
"""By how much a further child of the same parent must be better [m]. A grasp decides what can be reached later, so its
variety is worth more penetration than a placement's."""

RANDOM_SHAPE = (NUMBERS + 2 * LAST_JOINT_SAMPLES, BEAM_WIDTH, PROPOSALS)
"""Uniform numbers that one extension takes."""


class KeyframeBeam(NamedTuple):
    """KeyframeBeam of a batch of M prefixes; N objects, K_max switches at most."""

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


def empty_prefix(number_of_objects: int, k_max: int) -> KeyframeBeam:
    """KeyframeBeam of the empty prefix, without the batch axis."""
    N, B = number_of_objects, BEAM_WIDTH

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.float32)

    return KeyframeBeam(
        kind=np.full(N, FIXED, np.int32), face_yaw=zeros(N), parameters=zeros(B, N, PARAMETERS), violation=zeros(B),
        q=zeros(B, k_max, 14), m=zeros(B, k_max, PARAMETERS),
    )  # fmt: skip


def held_prefix(problem: Problem, k_max: int, seed: int) -> KeyframeBeam:
    """KeyframeBeam of a grasp that may be any within its bounds (`transcribe_switch`), without the batch axis."""
    empty, item = empty_prefix(len(problem.half), k_max), problem.switched_object[0]
    largest = np.array(LARGEST_GRASP)
    limits = np.clip((problem.lower[0], problem.upper[0]), -largest, largest)
    # Each parameter's range is divided evenly among the particles.
    generator = np.random.default_rng([seed, BEAM_WIDTH])
    rank = generator.permuted(np.tile(np.arange(BEAM_WIDTH), (PARAMETERS, 1)), axis=1)
    share = (rank + generator.random(rank.shape)) / BEAM_WIDTH
    grasps = (limits[0] + (limits[1] - limits[0]) * share.T).astype(np.float32)
    empty.face_yaw[item] = problem.face_yaw[0]
    empty.parameters[:, item] = empty.m[:, 0] = grasps
    empty.q[:, 0] = problem.home
    return empty._replace(kind=problem.attachment[1].astype(np.int32))


@Program
def _reach(arm: Array, R: Rotation, p: Vector, u: Array, home: Array) -> tuple[Array, Array]:
    """Best inverse kinematics for gripper poses (M, B, J): angles (M, B, J, 7) and a cost, `UNREACHABLE` or more where
    there is none.

    The best lies nearest to the home posture, which keeps clear of joint limits and leaves the elbow up."""
    shape, n = p.shape[1:], LAST_JOINT_SAMPLES
    low, high = (float(limit) for limit in load_arm().joint_limits[:, 6])
    q7 = low + (high - low) * (jnp.arange(n, dtype=u.dtype)[:, None, None, None] + u[:, None]) / n

    def flat(x: Array) -> Array:
        """(..., M, B, J) to (..., n M B J)."""
        leading = x.shape[:-3]
        x = jnp.broadcast_to(x[..., None, :, :, :], (*leading, n, *shape))
        return x.reshape(*leading, -1)

    arms = jnp.broadcast_to(arm[:, None, None], shape)
    q, failure = arm_angles(flat(arms), flat(R), flat(p), jnp.broadcast_to(q7, (n, *shape)).reshape(-1))
    q, failure = q.reshape(7, BRANCHES * n, *shape), failure.reshape(BRANCHES * n, *shape)
    near = jnp.take_along_axis(home.reshape(-1, 2, 7), arm[:, None, None], axis=1)[:, 0].T[:, None, :, None, None]
    # Multiplied before and added in order, lest the compiler round otherwise with another number of lanes.
    far = sum(materialize(tuple((q - near) ** 2)))
    cost = materialize(jnp.where(failure == 0, 0.01 * far, UNREACHABLE + failure))
    best = jnp.argmin(cost, axis=0)
    q = jnp.take_along_axis(q, best[None, None], axis=1)[:, 0]
    return jnp.moveaxis(q, 0, -1), cost.min(0)


class _BeamCandidates(NamedTuple):
    """The E most promising proposals of each of M prefixes."""

    q: Array
    """(M, E, 14)."""
    m: Array
    """(M, E, 4)."""
    parent: Array
    """(M, E) int: the particle that each extends."""
    cost: Array
    """(M, E) of inverse kinematics."""
    overhang: Array
    """(M, E) [m]."""


@Program
def _choose(
    particles: KeyframeBeam, step: BeamStep, m: Array, overhang: Array, q: Array, cost: Array, q_other: Array | None
) -> _BeamCandidates:
    """Proposals whose distances are worth computing: the best by inverse kinematics."""
    M, B, J = overhang.shape
    total = cost + overhang + particles.violation[:, :, None]
    _, chosen = jax.lax.top_k(-total.reshape(M, B * J), EVALUATED)

    def gather(x: Array) -> Array:
        return jnp.take_along_axis(x.reshape(M, B * J, -1), chosen[..., None], axis=1)

    acting = gather(q)
    if q_other is None:
        rest = jnp.take_along_axis(step.home.reshape(M, 2, 7), 1 - step.arm[:, None, None], axis=1)
        tucked = (chosen % J % 2 == 1)[..., None]
        other = jnp.where(tucked, jnp.asarray(TUCKED, q.dtype), rest)
    else:
        other = gather(q_other)
    left = (step.arm == 0)[:, None, None]
    return _BeamCandidates(
        jnp.concatenate([jnp.where(left, acting, other), jnp.where(left, other, acting)], axis=-1),
        gather(jnp.moveaxis(m, 0, -1)),
        chosen // J,
        gather(cost)[..., 0],
        gather(overhang)[..., 0],
    )


@Program
def _penetration(particles: KeyframeBeam, step: BeamStep, candidates: _BeamCandidates) -> Array:
    """Sum of penetrations (M, E) [m] at the switch slice."""
    M, E = candidates.parent.shape
    N, L = particles.kind.shape[1], M * E
    angles = jnp.moveaxis(candidates.q.reshape(L, 2, 7), (0, 1, 2), (2, 1, 0))
    parameters = jnp.take_along_axis(particles.parameters, candidates.parent[..., None, None], axis=1)

    def each(value: Array) -> Array:
        """(M, N) to (N, L)."""
        return jnp.repeat(value, E, axis=0).T

    attached = Attachment(
        kind=each(particles.kind),
        parameters=parameters.reshape(L, N, PARAMETERS).transpose(2, 1, 0),
        face_yaw=each(particles.face_yaw),
        initial=jnp.stack([each(step.initial_pose[..., i]) for i in range(4)]),
        half_height=each(step.half[..., 2]),
    )
    half = jnp.stack([each(step.half[..., i]) for i in range(4)])
    distance = measure(materialize(Slices(angles, each(step.opening), attached, half))).distance
    return jnp.maximum(-distance, 0).sum(1).reshape(M, E)


@Program
def _select(particles: KeyframeBeam, step: BeamStep, candidates: _BeamCandidates, penetration: Array) -> KeyframeBeam:
    """The best candidates, with a share for every parent: the k-th best child of one parent waits behind others."""
    M, N = particles.kind.shape
    B = BEAM_WIDTH
    cost, parent = candidates.cost, candidates.parent
    violation = jnp.where(cost >= UNREACHABLE, cost, penetration + candidates.overhang)
    violation += jnp.take_along_axis(particles.violation, parent, axis=1)
    # Rank among the children of the same parent.
    before = (violation[:, :, None] > violation[:, None, :]) & (parent[:, :, None] == parent[:, None, :])
    _, best = jax.lax.top_k(-(violation + step.share[:, None] * before.sum(2)), B)
    parent = jnp.take_along_axis(parent, best, axis=1)

    def from_parent(x: Array) -> Array:
        return jnp.take_along_axis(x, parent.reshape(M, B, *(1,) * (x.ndim - 2)), axis=1)

    q_new = jnp.take_along_axis(candidates.q, best[..., None], axis=1)
    m_new = jnp.take_along_axis(candidates.m, best[..., None], axis=1)
    depth = jnp.arange(particles.q.shape[2])[None, None, :, None] == step.depth[:, None, None, None]
    item = jnp.arange(N)[None] == step.item[:, None]
    return KeyframeBeam(
        kind=jnp.where(item, step.new_kind[:, None], particles.kind),
        face_yaw=jnp.where(item, step.face_yaw[:, None], particles.face_yaw),
        parameters=jnp.where(item[:, None, :, None], m_new[:, :, None], from_parent(particles.parameters)),
        violation=jnp.take_along_axis(violation, best, axis=1),
        q=jnp.where(depth, q_new[:, :, None], from_parent(particles.q)),
        m=jnp.where(depth, m_new[:, :, None], from_parent(particles.m)),
    )


def extend(particles: KeyframeBeam, step: BeamStep, u: np.ndarray, case: str) -> KeyframeBeam:
    """KeyframeBeam of M prefixes, each one action longer.

    Args:
        u: uniform numbers (`RANDOM_SHAPE`).
        case: "grasp", "handover" or "place", for all of them.
    """
    lanes = np.arange(len(step.item))
    holding = Holding(
        particles.kind[lanes, step.item],
        particles.face_yaw[lanes, step.item],
        particles.parameters[lanes, :, step.item],
    )
    proposed = PROPOSE[case](step, holding, u[:NUMBERS])
    ranges = np.split(u[NUMBERS:], 2)
    reached = [
        _reach(arm, R, p, u_arm, step.home)
        for arm, R, p, u_arm in zip((step.arm, 1 - step.arm), proposed.R, proposed.p, ranges, strict=False)
    ]
    q, cost = reached[0]
    q_other = None
    if len(reached) > 1:
        q_other, cost_other = reached[1]
        cost = cost + cost_other
    candidates = _choose(particles, step, proposed.m, proposed.overhang, q, cost, q_other)
    return _select(particles, step, candidates, _penetration(particles, step, candidates))


def case_of(kind_before: int, is_grasp: bool) -> str:
    """Which proposals an action takes: "grasp", "handover" or "place"."""
    if not is_grasp:
        return "place"
    return "handover" if kind_before >= HELD_LEFT else "grasp"
