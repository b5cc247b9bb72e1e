"""Starting points of NLPs: keyframes from a beam, and paths through keyframes; also the path NLP of a start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.body_clearances import PhasePart
from dvr_jax.nlp.problem import Problem, Variables, number_of_phases
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.continuous_collision import PATH_SAMPLES, even_fractions, place_samples
from dvr_jax.workcell.gripper_motion import shift_gripper
from dvr_jax.workcell.model import WorkcellModel

NEAR_SWITCH = 0.3
"""Fraction of a phase, before and after a switch, in which the cost pulls the path more strongly to its start."""

NEAR_WEIGHT = 0.3
"""Weight of the squared distance from the start near a switch [1/rad^2]."""

FAR_WEIGHT = 1e-2
"""Weight of the squared distance from the start elsewhere [1/rad^2]."""

CLEAR_DISTANCE = 0.055
"""Distance of a gripper's clear pose (shortly before or after a switch) from its pose at the switch [m]. It is a little
longer than the straight motion that the path NLP asks for by default."""

STEPS_PER_PHASE = 10
"""Number of slices of a path in each phase."""

LEAVING_STEPS = 1
"""Number of intervals after a switch in which hands and objects are still near what they leave."""

COMING_STEPS = 2
"""Number of intervals before a switch in which they are already near: one to come, one in which the fingers move."""

NO_CLEARANCE = -10.0
"""Clearance of bodies that may penetrate as deep as they like [m]."""

SHIFT_LANES = 16
"""The number of postures that are shifted in one call is a multiple of this, so that few sizes are compiled."""


@dataclass(frozen=True, slots=True)
class _ClearPose:
    """A pose that the path passes through shortly before or after a switch, with the gripper away from the object."""

    phase: int
    """Number k of the phase that the switch ends."""

    arm: int
    """Index of the arm."""

    is_before: bool
    """True if the pose is passed before the switch, False if after it."""

    is_up: bool
    """True if the gripper is shifted straight up, False if it is shifted back along its approach axis."""


def keyframe_start(beam: KeyframeBeam, rank: int, phases: int) -> Variables:
    """Return a candidate of a beam as a start of the keyframe NLP.

    Args:
        beam: Beam of a prefix.
        rank: Rank of the candidate; 0 is the one of least violation.
        phases: Number of actions of the prefix.
    """
    index = int(np.argsort(beam.violation, kind="stable")[rank])
    q = np.asarray(beam.q)[index, :phases]
    m = np.asarray(beam.m)[index, :phases]
    return Variables(q.astype(float), m.astype(float))


def initial_path(model: WorkcellModel, problem: Problem, keyframes: Variables) -> Variables:
    """Return a path that interpolates keyframes and is at rest at each of them.

    An arm that takes part in a switch passes through a clear pose shortly before and shortly after it.

    Args:
        model: Arms of the workcell.
        problem: Keyframe NLP of the sequence.
        keyframes: A solution of the keyframe NLP.
    """
    K = keyframes.q.shape[0]
    home = np.asarray(problem.home)
    before = np.concatenate([home[None], keyframes.q[:-1]])
    coming, going = _clear_postures(model, problem, np.asarray(keyframes.q))
    leaving = np.concatenate([before[:1], going[:-1]])

    # An arm that leaves a switch straight is clear of it after the first slice, and one that comes to the next switch
    # straight is at it at the last slice but one, because the arms rest in the last interval. In between, and
    # elsewhere, the time law s = tau^2 (3 - 2 tau) begins and ends at rest.
    S = STEPS_PER_PHASE
    tau = np.linspace(0.0, 1.0, S - 2)
    law = (tau * tau * (3 - 2 * tau))[:, None]
    q = np.empty((K, S, len(home)))
    q[:, : S - 2] = leaving[:, None] + (coming - leaving)[:, None] * law
    q[:, S - 2 :] = keyframes.q[:, None]
    return Variables(q.reshape(K * STEPS_PER_PHASE, -1), keyframes.m)


def path_problem(problem: Problem, start: Variables, samples: int = PATH_SAMPLES) -> Problem:
    """Return the path NLP of a sequence, given its keyframe NLP and an initial path.

    The cost pulls the path to its start, and more strongly close to a switch for the arms that take part in it. All
    arms rest at every switch, and the clearances are those of each part of a phase. Distances are evaluated on the
    interpolated motion through the start.

    Args:
        problem: Keyframe NLP.
        start: An initial path.
        samples: Number of samples in each interval; with 1, distances are evaluated at the slices only.
    """
    T = len(start.q)
    K = number_of_phases(problem)
    S = T // K
    near = round(NEAR_SWITCH * S)

    # Weights of the pull to the start: the slices near switch k, for the joints of the arms that take part in it.
    joints_of_arm = start.q.shape[1] // problem.arm_at_rest.shape[1]
    weight = np.full(start.q.shape, FAR_WEIGHT)
    for k, taking_part in enumerate(problem.arm_at_rest):
        own = np.where(np.repeat(taking_part, joints_of_arm) > 0, NEAR_WEIGHT, FAR_WEIGHT)
        part = slice((k + 1) * S - 1 - near, (k + 1) * S + near)
        weight[part] = np.maximum(weight[part], own)

    # All arms rest at each switch, where the fingers move, so that every phase can be timed for itself.
    at_rest = np.ones_like(problem.arm_at_rest)
    path = problem._replace(
        clearance=_path_clearances(problem, S),
        regularization_target=start.q,
        regularization_weight=weight,
        arm_at_rest=at_rest,
    )
    return place_samples(path, np.asarray(start.q), even_fractions(T, samples))


def optimal_path_problem(problem: Problem, path: Variables) -> Problem:
    """Return the path NLP whose solution is an optimal path: without a pull to the start, with preferred grasps.

    Args:
        problem: Keyframe NLP.
        path: A path on whose interpolated motion the distances are evaluated at first.
    """
    pulled = path_problem(problem, path)
    return pulled._replace(
        regularization_weight=np.zeros_like(pulled.regularization_weight),
        preference_scale=np.ones_like(pulled.preference_scale),
    )


def window_path_problem(
    model: WorkcellModel, problem: Problem, keyframes: Variables
) -> tuple[Problem, Variables]:
    """Return the path NLP of the last action of a window, and a start of it.

    Only the last phase counts, and not what happens right after the switch that it begins with: straight motions and
    clearances are asked for from then on. The NLP is a relaxation of those of all sequences that contain the window, in
    which other actions may come before and between those of the window, but for one thing: before the last phase the
    arms go from home to its beginning within as many slices as there are, without touching each other or the table.

    Args:
        model: Arms of the workcell.
        problem: Keyframe NLP of the window.
        keyframes: A solution of it.
    """
    distance = np.array(problem.straight_distance)
    distance[:-1] = 0
    distance[-1, 0] = 0
    start = initial_path(model, problem, keyframes)
    path = path_problem(problem._replace(straight_distance=distance), start)
    clearance = np.array(path.clearance)
    clearance[: len(start.q) - STEPS_PER_PHASE + LEAVING_STEPS] = NO_CLEARANCE
    return path._replace(clearance=clearance), start


def _path_clearances(problem: Problem, steps: int) -> Float[np.ndarray, "slices body_rows"]:
    """Return the clearances in the interval before each slice [m].

    Args:
        problem: Keyframe NLP.
        steps: Number S of slices in each phase.
    """
    part = np.full(steps, PhasePart.MIDDLE)
    part[:LEAVING_STEPS] = PhasePart.START
    part[-COMING_STEPS:] = PhasePart.END
    of_phases = np.asarray(problem.phase_clearance)[:-1]
    return of_phases[:, part].reshape(-1, of_phases.shape[-1])


def _wanted_poses(problem: Problem) -> list[_ClearPose]:
    """Return the clear poses shortly before and after all switches.

    A gripper that is about to grasp or has just released an object is shifted back along its approach axis. A gripper
    that has just lifted an object from a support, or is about to set it down, is shifted straight up.
    """
    wanted: list[_ClearPose] = []
    for k, item in enumerate(problem.switched_object):
        # Whether a gripper holds the object before the switch, and after it.
        old = int(problem.mode_kind[k, item]) == ModeKind.HELD
        new = int(problem.mode_kind[k + 1, item]) == ModeKind.HELD
        giver = int(problem.mode_parent[k, item])
        taker = int(problem.mode_parent[k + 1, item])
        if new:
            wanted.append(_ClearPose(k, taker, is_before=True, is_up=False))
            wanted.append(_ClearPose(k, taker, is_before=False, is_up=not old))
        if old and not (new and giver == taker):
            wanted.append(_ClearPose(k, giver, is_before=False, is_up=False))
            if not new:
                wanted.append(_ClearPose(k, giver, is_before=True, is_up=True))
    return wanted


def _clear_postures(
    model: WorkcellModel, problem: Problem, q: Float[np.ndarray, "phases joints"]
) -> tuple[Float[np.ndarray, "phases joints"], Float[np.ndarray, "phases joints"]]:
    """Compute the joint angles shortly before and shortly after each switch [rad]; arms without a clear pose stay."""
    K = len(q)
    arms = model.structure.number_of_arms
    coming = np.array(q).reshape(K, arms, -1)
    going = np.array(coming)
    wanted = _wanted_poses(problem)

    lanes = len(wanted) + (-len(wanted)) % SHIFT_LANES
    angles = np.zeros((lanes, model.structure.joints))
    is_up = np.zeros(lanes, bool)
    for lane, pose in enumerate(wanted):
        angles[lane] = coming[pose.phase, pose.arm]
        is_up[lane] = pose.is_up
    shifted = np.asarray(
        shift_gripper(model, angles, is_up, np.full(lanes, CLEAR_DISTANCE), np.zeros(lanes))
    )

    for lane, pose in enumerate(wanted):
        target = coming if pose.is_before else going
        target[pose.phase, pose.arm] = shifted[lane]
    return coming.reshape(K, -1), going.reshape(K, -1)
