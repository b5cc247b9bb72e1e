"""Where NLPs start from: keyframes from particles, paths through keyframes; and the path NLP of such a start."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from dvr_jax.nlp.problem import HELD_LEFT, Problem, Variables
from dvr_jax.seeds.keyframe_beam import KeyframeBeam
from dvr_jax.solver.continuous_collision import PATH_SAMPLES, even_shares, place_samples
from dvr_jax.workcell.panda.inverse_kinematics import shift_gripper

NEAR_SWITCH = 0.3
"""Share of a phase next to a switch in which the path is drawn to its start."""
NEAR_ATTRACTION, FAR_ATTRACTION = 0.3, 1e-2
"""Weights of that pull there and elsewhere [1/rad^2]."""

CLEARANCE = 0.08
"""How far a gripper's clear pose is from its switch [m]."""

STEPS_PER_PHASE = 10
"""Slices of a path per phase."""


def keyframe_start(prefix: KeyframeBeam, rank: int, K: int) -> Variables:
    """The particle of this rank (0: least violation) as a start of the keyframe NLP."""
    index = int(np.argsort(prefix.violation, kind="stable")[rank])
    return Variables(prefix.q[index, :K].astype(float), prefix.m[index, :K].astype(float))


def path_start(problem: Problem, keyframes: Variables) -> Variables:
    """A path through keyframes, at rest at each; an arm that takes part in a switch comes and goes through a clear
    pose beside it."""
    K = keyframes.q.shape[0]
    before = np.concatenate([problem.home[None], keyframes.q[:-1]])
    coming, going = _clear_postures(problem, keyframes.q)
    leaving = np.concatenate([before[:1], going[:-1]])
    # The last interval before a switch is one of rest.
    tau = np.minimum(np.arange(1, STEPS_PER_PHASE + 1) / (STEPS_PER_PHASE - 1), 1)
    # At rest at both ends: time runs as a cubic, and the joints as a monotone curve of it.
    curves = PchipInterpolator([0.0, 0.25, 0.75, 1.0], np.stack([before, leaving, coming, keyframes.q]), axis=0)
    q = curves(tau * tau * (3 - 2 * tau)).swapaxes(0, 1)
    return Variables(q.reshape(K * STEPS_PER_PHASE, -1), keyframes.m)


def path_problem(problem: Problem, start: Variables, samples: int = PATH_SAMPLES) -> Problem:
    """The path NLP of a sequence from its keyframe NLP: drawn to its start, and more so close to a switch, for the
    arms that take part; both rest at the end; distances are taken on the motion through the start, `PATH_SAMPLES` times
    an interval, or once: at the slices alone.

    Without it the shortest motion sweeps sideways into a grasp, and hops over the object's edge between two slices.
    """
    T, K = len(start.q), len(problem.is_grasp)
    S = T // K
    near = round(NEAR_SWITCH * S)
    attraction = np.full(start.q.shape, FAR_ATTRACTION)
    for k, taking_part in enumerate(problem.resting):
        weight = np.where(np.repeat(taking_part, 7) > 0, NEAR_ATTRACTION, FAR_ATTRACTION)
        part = slice((k + 1) * S - 1 - near, (k + 1) * S + near)
        attraction[part] = np.maximum(attraction[part], weight)
    resting = np.array(problem.resting)
    resting[-1] = 1
    drawn = problem._replace(reference=start.q, attraction=attraction, resting=resting)
    return place_samples(drawn, start.q, even_shares(T, samples))


def _clear_postures(problem: Problem, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (K, 14) shortly before and after each switch: a gripper that comes to grasp or has let go is
    `CLEARANCE` back along its approach, one that holds something that stands before or after the switch is as much
    higher."""
    K = len(q)
    coming, going = np.array(q), np.array(q)
    tasks: list[tuple[np.ndarray, int, int, bool]] = []
    for k in range(K):
        item = problem.switched_object[k]
        old, new = int(problem.attachment[k, item]), int(problem.attachment[k + 1, item])
        for arm in range(2):
            gives, takes = old == HELD_LEFT + arm, new == HELD_LEFT + arm
            if takes:
                tasks += [(coming, k, arm, False), (going, k, arm, old < HELD_LEFT)]
            elif gives:
                tasks += [(going, k, arm, False)]
                if new < HELD_LEFT:
                    tasks += [(coming, k, arm, True)]
    lanes = len(tasks) + (-len(tasks)) % 16
    angles, arms, up = np.zeros((lanes, 7)), np.zeros(lanes, np.int32), np.zeros(lanes, bool)
    for lane, (target, k, arm, rises) in enumerate(tasks):
        angles[lane], arms[lane], up[lane] = target[k, 7 * arm : 7 * arm + 7], arm, rises
    shifted = np.asarray(shift_gripper(angles, arms, up, np.asarray(CLEARANCE)))
    for lane, (target, k, arm, _) in enumerate(tasks):
        target[k, 7 * arm : 7 * arm + 7] = shifted[lane]
    return coming, going
