"""The keyframe NLP starts from a beam of candidates, which is extended action by action along the tree of sequences.

The NLP has local minima (which way the elbow points, from which side the gripper comes, where on the table an object
is put), and one start near the home posture misses most feasible problems. Every prefix of a sequence therefore has a
*beam* of `BEAM_WIDTH` candidates. A candidate consists of joint angles at each switch and of mode parameters of each
action. It satisfies all switch constraints exactly, by closed-form inverse kinematics, and its *violation* is the sum
of the penetration depths at its switches and of the distances by which placed objects extend beyond their supports.
Sequences with a common prefix share its beam.

The beam of a child is computed from its parent's beam in four stages (`extend_beam`):

1. `PROPOSALS` random mode parameters are drawn for each candidate (`dvr_jax.operators.proposal`).
2. Inverse kinematics gives joint angles for each of these proposals.
3. Distances are computed for the `EVALUATED` proposals that are best by inverse kinematics.
4. The `BEAM_WIDTH` proposals of least violation become the child's candidates. Proposals that extend the same candidate
   are *siblings*, and all but the best of them get a penalty, so that the beam stays diverse.

A candidate without penetration is a feasible point of the NLP by itself (`CERTIFIED_PENETRATION`). In all other cases
the NLP decides whether the prefix is feasible.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    compose,
    materialize,
    rotate_back,
    transpose,
)
from dvr_jax.modes.mode import PARAMETERS, Attachment, ModeKind
from dvr_jax.nlp.problem import Problem
from dvr_jax.nlp.slices import Slices, measure
from dvr_jax.operators.grasp import LARGEST_GRASP
from dvr_jax.operators.proposal import (
    UNIFORM_NUMBERS,
    BeamStep,
    ObjectBefore,
    Proposal,
    ProposedPoses,
    of_arm,
    of_switched_object,
)
from dvr_jax.runtime.compilation import Program
from dvr_jax.workcell.model import WorkcellModel

BEAM_WIDTH = 16
"""Number of candidates of each prefix."""

PROPOSALS = 32
"""Number of proposals drawn for each candidate."""

EVALUATED = 96
"""Number of proposals of each prefix whose distances are computed: the best ones by inverse kinematics."""

FREE_ANGLE_SAMPLES = 3
"""Values of each free joint that are tried for each gripper pose."""

HOME_DISTANCE_WEIGHT = 0.01
"""Weight of the squared joint distance of a posture from home [1/rad^2]; it ranks postures that reach their pose."""

CERTIFIED_PENETRATION = 5e-4
"""Largest violation of a candidate that proves that its prefix has feasible keyframes [m]; a candidate satisfies all
constraints other than penetration and overhang exactly."""

UNREACHABLE = 10.0
"""Violation that is assigned to a proposal for which inverse kinematics has no solution [m]."""


BEAM_CAPACITY = 12
"""Number of actions that beams have room for, so that searches with different `k_max` share compiled programs."""


def beam_capacity(k_max: int) -> int:
    """Return the number of actions that the beams of a search with this largest number of actions have room for."""
    return max(k_max, BEAM_CAPACITY)


class KeyframeBeam(NamedTuple):
    """Beams of M prefixes, B = `BEAM_WIDTH` candidates each; N objects, at most K_max switches.

    A beam of one prefix has no axis M.
    """

    kind: Int[Array, "*prefixes objects"]
    """`ModeKind` of each object after the prefix, the same for all candidates."""

    parent: Int[Array, "*prefixes objects"]
    """Arm that holds each object; 0 where none does."""

    closing_yaw: Float[Array, "*prefixes objects"]
    """Yaw of the closing axis in the frame of a held object [rad]; without meaning for other objects."""

    parameters: Float[Array, "*prefixes candidates objects 4"]
    """Mode parameters of the action that attached each object; zero for objects that have not moved."""

    violation: Float[Array, "*prefixes candidates"]
    """Sum of penetration depths and overhangs at all switches [m]; `UNREACHABLE` or more if there are no postures."""

    q: Float[Array, "*prefixes candidates switches joints"]
    """Joint angles at the switches so far [rad]."""

    m: Float[Array, "*prefixes candidates switches 4"]
    """Mode parameters of the actions so far."""


class _BeamCandidates(NamedTuple):
    """The E most promising proposals of each of M prefixes."""

    q: Float[Array, "prefixes chosen joints"]
    m: Float[Array, "prefixes chosen 4"]
    origin: Int[Array, "prefixes chosen"]
    """The candidate that each extends."""

    cost: Float[Array, "prefixes chosen"]
    """Cost of inverse kinematics, summed over the arms that take part."""

    overhang: Float[Array, "prefixes chosen"]
    """By how much a placed object extends beyond its support [m]."""


class _Reached(NamedTuple):
    """Best postures of one arm for all proposals, by inverse kinematics."""

    q: Float[Array, "prefixes candidates proposals joints"]
    """Joint angles of the arm [rad]."""

    cost: Float[Array, "prefixes candidates proposals"]
    """Weighted squared distance from home; `UNREACHABLE` or more if no posture reaches the pose."""


def empty_beam(number_of_objects: int, k_max: int, number_of_joints: int) -> KeyframeBeam:
    """Return the beam of the empty prefix.

    Args:
        number_of_objects: Number N of objects of the scene.
        k_max: Largest number of actions.
        number_of_joints: Number D of joints of all arms.
    """

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.float32)

    return KeyframeBeam(
        kind=np.full(number_of_objects, ModeKind.FIXED, np.int32),
        parent=np.zeros(number_of_objects, np.int32),
        closing_yaw=zeros(number_of_objects),
        parameters=zeros(BEAM_WIDTH, number_of_objects, PARAMETERS),
        violation=zeros(BEAM_WIDTH),
        q=zeros(BEAM_WIDTH, k_max, number_of_joints),
        m=zeros(BEAM_WIDTH, k_max, PARAMETERS),
    )


def held_beam(problem: Problem, k_max: int, seed: int) -> KeyframeBeam:
    """Return the beam of a prefix of one grasp whose mode parameters are random within their bounds.

    The joint angles at the grasp are those of the home posture, since how the object came to be held is not considered.

    Args:
        problem: The NLP of a switch alone (`dvr_jax.nlp.transcription.transcribe_switch`).
        k_max: Largest number of actions.
        seed: Seed of the sample.
    """
    beam = empty_beam(len(problem.prism), k_max, len(problem.home))
    item = problem.switched_object[0]
    largest = np.array(LARGEST_GRASP)
    low, high = np.clip((problem.parameter_lower[0], problem.parameter_upper[0]), -largest, largest)

    # The range of each parameter is divided evenly among the candidates, in random order (Latin hypercube sampling).
    generator = np.random.default_rng([seed, BEAM_WIDTH])
    rank = generator.permuted(np.tile(np.arange(BEAM_WIDTH), (PARAMETERS, 1)), axis=1)
    fraction = (rank + generator.random(rank.shape)) / BEAM_WIDTH
    grasps = (low + (high - low) * fraction.T).astype(np.float32)

    beam.closing_yaw[item] = problem.closing_yaw[0]
    beam.parameters[:, item] = grasps
    beam.m[:, 0] = grasps
    beam.q[:, 0] = problem.home
    return beam._replace(
        kind=np.asarray(problem.mode_kind[1]).astype(np.int32),
        parent=np.asarray(problem.mode_parent[1]).astype(np.int32),
    )


def random_shape(model: WorkcellModel) -> tuple[int, int, int]:
    """Return the shape (numbers, candidates, proposals) of the uniform random numbers that `extend_beam` takes.

    The first `UNIFORM_NUMBERS` of them are for the mode parameters, the others for the free joints of two arms.
    """
    free = len(model.structure.inverse_kinematics.free_joints)
    return (UNIFORM_NUMBERS + 2 * FREE_ANGLE_SAMPLES * free, BEAM_WIDTH, PROPOSALS)


def extend_beam(
    model: WorkcellModel,
    beam: KeyframeBeam,
    step: BeamStep,
    uniform: Float[np.ndarray, "numbers candidates proposals"],
    proposal: Proposal,
    supports: Float[np.ndarray, "prefixes candidates 5"] | None = None,
) -> KeyframeBeam:
    """Extend the beams of M prefixes by one action.

    Args:
        model: Arms of the workcell.
        beam: Beams of the prefixes without the action.
        step: The action of each prefix.
        uniform: Uniform random numbers in [0, 1), of the shape `random_shape`.
        proposal: How the actions are sampled; it is the same for all of them.
        supports: Rectangles on which objects are placed, where they differ between candidates.

    Returns:
        Beams of the prefixes with the action.
    """
    prefixes = np.arange(len(step.item))
    before = ObjectBefore(
        beam.kind[prefixes, step.item],
        beam.closing_yaw[prefixes, step.item],
        beam.parameters[prefixes, :, step.item],
    )

    # Stage 1: mode parameters, and the gripper poses that belong to them. Up to the choice of the most promising
    # proposals, nothing depends on the other objects.
    own = step if supports is None else step._replace(support=supports)
    proposed = proposal.propose(own, before, uniform[:UNIFORM_NUMBERS])

    alone = of_switched_object(step)

    # Stage 2: joint angles. The acting arm comes first; in a handover the giving arm follows.
    numbers = np.split(uniform[UNIFORM_NUMBERS:], 2)
    arms = (step.acting_arm, step.giving_arm)[: len(proposed.position)]
    reached = [
        _reach(model, alone, arm, R, p, u)
        for arm, R, p, u in zip(arms, proposed.rotation, proposed.position, numbers, strict=False)
    ]

    # Stages 3 and 4: distances of the most promising proposals, and the choice of the new candidates.
    candidates = _choose(model, beam.violation, alone, proposed, tuple(reached))
    penetration = _penetration(model, beam, step, candidates)
    return _select(beam, step, candidates, penetration)


@Program
def _reach(
    model: WorkcellModel, step: BeamStep, arm: Array, R: Rotation, p: Vector, u: Array
) -> _Reached:
    """Compute the best posture of one arm for gripper poses with the batch axes (M, B, J).

    The axes are M prefixes, B candidates and J proposals. The best posture is the one nearest to the home posture,
    because this keeps it away from joint limits and leaves the elbow up.

    Args:
        model: Arms of the workcell.
        step: The action of each prefix.
        arm: Index of the arm of each prefix.
        R: Rotations of the gripper in the world.
        p: Centers of the gripper in the world [m].
        u: Uniform random numbers for the free joints.
    """
    kinematics = model.structure.inverse_kinematics
    shape = p.shape[1:]
    free = _sample_free_angles(model, u, shape)
    number = free.shape[1]

    # Gripper poses in the frame of the arm's base, repeated for every sample of the free angles.
    base_R = of_arm(step.base_rotation, arm).transpose(2, 1, 0)[..., None, None]
    base_p = of_arm(step.base_position, arm).T[..., None, None]
    local_R = compose(transpose(base_R), R)
    local_p = rotate_back(base_R, p - base_p)

    def flat(value: Array) -> Array:
        """Repeat an array (..., M, B, J) for the n samples of the free angles, and flatten it to (..., n M B J)."""
        leading = value.shape[:-3]
        repeated = jnp.broadcast_to(value[..., None, :, :, :], (*leading, number, *shape))
        return repeated.reshape(*leading, -1)

    local_R, local_p = materialize((flat(local_R), flat(local_p)))

    # Inverse kinematics returns every branch (solution) of every lane; `failure` is zero if a branch reaches the pose.
    lanes = number * math.prod(shape)
    q, failure = kinematics.solve(model, local_R, local_p, free.reshape(len(free), lanes))
    q = q.reshape(len(q), kinematics.branches * number, *shape)
    failure = failure.reshape(kinematics.branches * number, *shape)

    # The squares are computed first and added in a fixed order. Otherwise the compiler may fuse both operations, and
    # the rounding of a lane would depend on the number of lanes.
    home = of_arm(step.home.reshape(len(step.home), -1, len(q)), arm).T[:, None, :, None, None]
    squares = materialize(tuple((q - home) ** 2))
    distance = sum(squares)
    cost = materialize(
        jnp.where(failure == 0, HOME_DISTANCE_WEIGHT * distance, UNREACHABLE + failure)
    )
    best = jnp.argmin(cost, axis=0)
    q = jnp.take_along_axis(q, best[None, None], axis=1)[:, 0]
    return _Reached(jnp.moveaxis(q, 0, -1), cost.min(0))


def _sample_free_angles(
    model: WorkcellModel, u: Array, shape: tuple[int, ...]
) -> Float[Array, "free n *shape"]:
    """Draw n angles of each free joint, one in each of n equal parts of the joint's range [rad]."""
    free_joints = model.structure.inverse_kinematics.free_joints
    if not free_joints:
        return jnp.zeros((0, 1, *shape), u.dtype)
    n = FREE_ANGLE_SAMPLES
    low, high = jnp.asarray(model.joint_limits, u.dtype)[:, jnp.asarray(free_joints)]
    numbers = u.reshape(len(free_joints), n, 1, *u.shape[1:])
    fraction = (jnp.arange(n, dtype=u.dtype)[:, None, None, None] + numbers) / n
    angles = low[:, None, None, None, None] + (high - low)[:, None, None, None, None] * fraction
    return jnp.broadcast_to(angles, (len(free_joints), n, *shape))


@Program
def _choose(
    model: WorkcellModel,
    violation: Float[Array, "prefixes candidates"],
    step: BeamStep,
    proposed: ProposedPoses,
    reached: tuple[_Reached, ...],
) -> _BeamCandidates:
    """Choose the proposals whose distances are computed: those of least cost, overhang and violation of the parent."""
    overhang = proposed.overhang
    M, B, J = overhang.shape

    # Ranking before the distances are known.
    cost = reached[0].cost
    for other in reached[1:]:
        cost = cost + other.cost
    total = cost + overhang + violation[:, :, None]
    _, chosen = jax.lax.top_k(-total.reshape(M, B * J), EVALUATED)

    def gather(value: Array) -> Array:
        """Return the entries of the chosen proposals: (M, B, J, ...) to (M, E, ...)."""
        return jnp.take_along_axis(value.reshape(M, B * J, -1), chosen[..., None], axis=1)

    # Arms that take no part in the action are at home in half of the proposals, and tucked away in the other half.
    arms = model.structure.number_of_arms
    home = step.home.reshape(M, 1, arms, -1)
    tucked = jnp.asarray(model.tucked, home.dtype)
    is_tucked = (chosen % J % 2 == 1)[..., None, None]
    postures = jnp.where(is_tucked, tucked, home)
    for arm, posture in zip((step.acting_arm, step.giving_arm), reached, strict=False):
        is_own = (jnp.arange(arms) == arm[:, None])[:, None, :, None]
        postures = jnp.where(is_own, gather(posture.q)[:, :, None], postures)

    return _BeamCandidates(
        q=postures.reshape(M, EVALUATED, -1),
        m=gather(jnp.moveaxis(proposed.m, 0, -1)),
        origin=chosen // J,
        cost=gather(cost)[..., 0],
        overhang=gather(overhang)[..., 0],
    )


def empty_candidates(beam: KeyframeBeam) -> _BeamCandidates:
    """Return placeholders of the proposals whose distances are computed, to prepare `PENETRATION`.

    Args:
        beam: Beams of M prefixes.
    """
    M = len(beam.kind)
    numbers = np.zeros((M, EVALUATED), np.float32)
    return _BeamCandidates(
        q=np.zeros((M, EVALUATED, beam.q.shape[-1]), np.float32),
        m=np.zeros((M, EVALUATED, PARAMETERS), np.float32),
        origin=np.zeros((M, EVALUATED), np.int32),
        cost=numbers,
        overhang=numbers,
    )


@Program
def _penetration(
    model: WorkcellModel, beam: KeyframeBeam, step: BeamStep, candidates: _BeamCandidates
) -> Float[Array, "prefixes chosen"]:
    """Compute the sum of the penetration depths of each chosen proposal at the action's switch [m]."""
    M, E = candidates.origin.shape
    N = beam.kind.shape[1]
    arms = model.structure.number_of_arms
    parameters = jnp.take_along_axis(beam.parameters, candidates.origin[..., None, None], axis=1)

    def each(value: Array) -> Array:
        """Repeat the values of each prefix for its E proposals, with the batch axis last: (M, ...) to (..., M E)."""
        return jnp.moveaxis(jnp.repeat(value, E, axis=0), 0, -1)

    # The state before the switch is evaluated: the object is still attached as before the action.
    attached = Attachment(
        kind=each(beam.kind),
        parent=each(beam.parent),
        parameters=parameters.reshape(M * E, N, PARAMETERS).transpose(2, 1, 0),
        closing_yaw=each(beam.closing_yaw),
        initial_pose=jnp.swapaxes(each(step.initial_pose), 0, 1),
        half_height=each(step.prism[..., 2]),
    )
    prism = jnp.concatenate([step.prism, step.fixed_prism], axis=1)
    axes = step.base_rotation.transpose(0, 3, 2, 1)
    origins = step.base_position.transpose(0, 2, 1)
    base_poses = jnp.concatenate([axes, origins[:, None]], axis=1)

    slices = Slices(
        q=candidates.q.reshape(M * E, arms, -1).transpose(2, 1, 0),
        finger_opening=each(step.finger_opening),
        base_poses=each(base_poses),
        attached=attached,
        prism=jnp.swapaxes(each(prism), 0, 1),
        clearance=each(step.clearance),
        fixed_pose=jnp.swapaxes(each(step.fixed_pose), 0, 1),
    )
    distance = measure(model, materialize(slices)).distance
    return jnp.maximum(-distance, 0).sum(1).reshape(M, E)


PENETRATION = _penetration
"""The program that computes distances of proposals; it takes longest to compile of all programs of an extension."""


@Program
def _select(
    beam: KeyframeBeam,
    step: BeamStep,
    candidates: _BeamCandidates,
    penetration: Float[Array, "prefixes chosen"],
) -> KeyframeBeam:
    """Choose the new candidates: the proposals of least violation plus penalty.

    The penalty of a proposal is `sibling_penalty` times its rank among its siblings, the proposals that extend the same
    candidate.
    """
    M, N = beam.kind.shape
    origin = candidates.origin
    is_unreachable = candidates.cost >= UNREACHABLE
    violation = jnp.where(is_unreachable, candidates.cost, penetration + candidates.overhang)
    violation += jnp.take_along_axis(beam.violation, origin, axis=1)

    # The rank among siblings is the number of siblings that are better.
    is_worse = violation[:, :, None] > violation[:, None, :]
    is_sibling = origin[:, :, None] == origin[:, None, :]
    rank = (is_worse & is_sibling).sum(2)
    _, best = jax.lax.top_k(-(violation + step.sibling_penalty[:, None] * rank), BEAM_WIDTH)
    origin = jnp.take_along_axis(origin, best, axis=1)

    def from_parent(value: Array) -> Array:
        """Return what each new candidate takes over from the candidate that it extends."""
        index = origin.reshape(M, BEAM_WIDTH, *(1,) * (value.ndim - 2))
        return jnp.take_along_axis(value, index, axis=1)

    # The new action's joint angles and mode parameters are added to those of the extended candidates.
    q = jnp.take_along_axis(candidates.q, best[..., None], axis=1)
    m = jnp.take_along_axis(candidates.m, best[..., None], axis=1)
    is_new = jnp.arange(beam.q.shape[2])[None, None, :, None] == step.depth[:, None, None, None]
    is_item = jnp.arange(N)[None] == step.item[:, None]
    return KeyframeBeam(
        kind=jnp.where(is_item, step.kind_after[:, None], beam.kind),
        parent=jnp.where(is_item, step.parent_after[:, None], beam.parent),
        closing_yaw=jnp.where(is_item, step.closing_yaw[:, None], beam.closing_yaw),
        parameters=jnp.where(
            is_item[:, None, :, None], m[:, :, None], from_parent(beam.parameters)
        ),
        violation=jnp.take_along_axis(violation, best, axis=1),
        q=jnp.where(is_new, q[:, :, None], from_parent(beam.q)),
        m=jnp.where(is_new, m[:, :, None], from_parent(beam.m)),
    )
