"""Where NLPs start from: keyframes from a beam, paths through keyframes; and the path NLP of such a start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem, Variables, number_of_phases
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.continuous_collision import PATH_SAMPLES, even_fractions, place_samples
from dvr_jax.workcell.gripper_motion import shift_gripper
from dvr_jax.workcell.model import WorkcellModel

NEAR_SWITCH = 0.3
"""Part of a phase next to a switch in which the path is drawn more strongly to its start."""

NEAR_WEIGHT = 0.3
"""Weight of that pull near a switch [1/rad^2]."""

FAR_WEIGHT = 1e-2
"""Weight of that pull elsewhere [1/rad^2]."""

CLEARANCE = 0.08
"""How far a gripper's clear pose is from its switch [m]."""

STEPS_PER_PHASE = 10
"""Slices of a path per phase."""

SHIFT_LANES = 16
"""Postures that are shifted in one call, or a multiple: few sizes are compiled."""


@dataclass(frozen=True, slots=True)
class _ClearPose:
    """One posture beside a switch that is wanted."""

    phase: int
    arm: int
    is_before: bool
    """Whether the posture is taken before the switch, or after it."""

    is_up: bool
    """Whether the gripper is moved straight up, or back along its approach."""


def keyframe_start(beam: KeyframeBeam, rank: int, phases: int) -> Variables:
    """A candidate of a beam as a start of the keyframe NLP.

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
    """A path through keyframes, at rest at each; an arm that takes part in a switch comes and goes through a clear
    pose.

    Args:
        model: Arms of the workcell.
        problem: Keyframe NLP of the sequence.
        keyframes: A solution of it.
    """
    K = keyframes.q.shape[0]
    home = np.asarray(problem.home)
    before = np.concatenate([home[None], keyframes.q[:-1]])
    coming, going = _clear_postures(model, problem, np.asarray(keyframes.q))
    leaving = np.concatenate([before[:1], going[:-1]])

    # At rest at both ends of a phase: time runs as a cubic, and the joints as a monotone curve of it. The last interval
    # before a switch is one of rest.
    tau = np.minimum(np.arange(1, STEPS_PER_PHASE + 1) / (STEPS_PER_PHASE - 1), 1)
    knots = np.stack([before, leaving, coming, keyframes.q])
    curves = PchipInterpolator([0.0, 0.25, 0.75, 1.0], knots, axis=0)
    q = curves(tau * tau * (3 - 2 * tau)).swapaxes(0, 1)
    return Variables(q.reshape(K * STEPS_PER_PHASE, -1), keyframes.m)


def path_problem(problem: Problem, start: Variables, samples: int = PATH_SAMPLES) -> Problem:
    """The path NLP of a sequence from its keyframe NLP.

    The path is drawn to its start, and more so close to a switch, for the arms that take part: without it the shortest
    motion sweeps sideways into a grasp. All arms rest at the end. Distances are taken on the motion through the start.

    Args:
        problem: Keyframe NLP.
        start: An initial path.
        samples: Samples of each interval; with 1 distances are taken at the slices alone.
    """
    T = len(start.q)
    K = number_of_phases(problem)
    S = T // K
    near = round(NEAR_SWITCH * S)
    joints_of_arm = start.q.shape[1] // problem.arm_at_rest.shape[1]
    weight = np.full(start.q.shape, FAR_WEIGHT)
    for k, taking_part in enumerate(problem.arm_at_rest):
        own = np.where(np.repeat(taking_part, joints_of_arm) > 0, NEAR_WEIGHT, FAR_WEIGHT)
        part = slice((k + 1) * S - 1 - near, (k + 1) * S + near)
        weight[part] = np.maximum(weight[part], own)

    at_rest = np.array(problem.arm_at_rest)
    at_rest[-1] = 1
    path = problem._replace(
        regularization_target=start.q,
        regularization_weight=weight,
        arm_at_rest=at_rest,
    )
    return place_samples(path, np.asarray(start.q), even_fractions(T, samples))


def _wanted_poses(problem: Problem) -> list[_ClearPose]:
    """Clear poses beside all switches.

    A gripper that comes to grasp, or has let go, is back along its approach; one that holds something that stands
    before or after the switch is straight above.
    """
    wanted: list[_ClearPose] = []
    for k, item in enumerate(problem.switched_object):
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
    """Joint angles shortly before and shortly after each switch [rad]."""
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
    shifted = np.asarray(shift_gripper(model, angles, is_up, np.asarray(CLEARANCE)))

    for lane, pose in enumerate(wanted):
        target = coming if pose.is_before else going
        target[pose.phase, pose.arm] = shifted[lane]
    return coming.reshape(K, -1), going.reshape(K, -1)
