"""The retreat of the hand that has released the last object: straight back along its approach axis."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.blocks.collision import PENETRATION_TOLERANCE
from dvr_jax.nlp.body_clearances import PhasePart
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.runtime.batch_sizes import batch_sizes
from dvr_jax.seeds.initial_paths import SHIFT_LANES, STEPS_PER_PHASE
from dvr_jax.solver.continuous_collision import PATH_SAMPLES
from dvr_jax.solver.iteration import lay_out_chunks, measure_chunk
from dvr_jax.solver.lane_pool import stack
from dvr_jax.workcell.gripper_motion import shift_gripper
from dvr_jax.workcell.model import WorkcellModel

RETREAT_STEPS = 10
"""Number of equal parts of the longest retreat; the longest of these retreats that is free is taken."""

FREE_TURNS = (0.0, -0.15, 0.15, -0.3, 0.3)
"""Changes of the free joints of the inverse kinematics during a retreat that are tried one after the other [rad]. Where
the free joints are at the end of their range for a pose of the hand, there is no retreat without a change."""


def retreat(
    model: WorkcellModel,
    problem: Problem,
    q: Float[np.ndarray, "slices joints"],
    m: Float[np.ndarray, "phases 4"],
    distance: float,
) -> Float[np.ndarray, "steps joints"]:
    """Return the postures of a retreat after the last action, as long as there is room.

    Args:
        model: Arms of the workcell.
        problem: Keyframe NLP of the sequence.
        q: Joint angles of the path [rad].
        m: Mode parameters.
        distance: Longest retreat [m].

    Returns:
        Joint angles of all arms in steps of equal distance [rad]; none where the last action releases nothing, or where
        there is no room.
    """
    item = int(problem.switched_object[-1])
    arm = int(problem.mode_parent[-2, item])
    released = (
        int(problem.mode_kind[-2, item]) == ModeKind.HELD
        and int(problem.mode_kind[-1, item]) != ModeKind.HELD
    )
    if not released or distance == 0:
        return np.zeros((0, q.shape[1]))

    # Where the arm cannot retreat with its free joints, these turn on the way.
    longest = np.zeros((0, q.shape[1]))
    for turn in FREE_TURNS:
        found = _retreat(model, problem, np.asarray(q[-1]), m, arm, distance, turn)
        if len(found) > len(longest):
            longest = found
        if len(longest) == RETREAT_STEPS:
            break
    return longest


def _retreat(
    model: WorkcellModel,
    problem: Problem,
    q: Float[np.ndarray, " joints"],
    m: Float[np.ndarray, "phases 4"],
    arm: int,
    distance: float,
    turn: float,
) -> Float[np.ndarray, "steps joints"]:
    """Return the postures of a retreat in which the free joints of the arm turn by an angle, as long as there is room.

    Args:
        model: Arms of the workcell.
        problem: Keyframe NLP of the sequence.
        q: Joint angles of all arms before the retreat [rad].
        m: Mode parameters.
        arm: Index of the arm.
        distance: Longest retreat [m].
        turn: Change of the free joints over the longest retreat [rad].
    """
    # Postures of the arm that moves, from the nearest to the farthest.
    arms = model.structure.number_of_arms
    posture = q.reshape(arms, -1)
    angles = np.tile(posture[arm], (SHIFT_LANES, 1))
    is_up = np.zeros(SHIFT_LANES, bool)
    part = np.zeros(SHIFT_LANES)
    part[:RETREAT_STEPS] = np.arange(1, RETREAT_STEPS + 1) / RETREAT_STEPS
    # The free joints have turned after the first half.
    turns = turn * np.minimum(2 * part, 1)
    shifted = np.asarray(shift_gripper(model, angles, is_up, distance * part, turns))
    postures = np.tile(posture, (RETREAT_STEPS, 1, 1))
    postures[:, arm] = shifted[:RETREAT_STEPS]

    # An arm without a solution stays where it is.
    moves = np.abs(shifted[:RETREAT_STEPS] - posture[arm]).max(axis=1) > 0
    free = (
        _distances(model, problem, postures.reshape(RETREAT_STEPS, -1), m) >= -PENETRATION_TOLERANCE
    )
    blocked = np.flatnonzero(~(free & moves))
    return postures.reshape(RETREAT_STEPS, -1)[: blocked[0] if len(blocked) else RETREAT_STEPS]


def _distances(
    model: WorkcellModel,
    problem: Problem,
    q: Float[np.ndarray, "steps joints"],
    m: Float[np.ndarray, "phases 4"],
) -> Float[np.ndarray, " steps"]:
    """Return the least distance less clearance of any two bodies after the last action, for some postures [m].

    They take the place of the slices of a path, so that the compiled programs of the solver can be used.
    """
    K = len(m)
    T = K * STEPS_PER_PHASE
    D = q.shape[1]
    slices = np.concatenate([q, np.tile(q[-1:], (T - len(q), 1))])

    def of_phases(rows: Array) -> np.ndarray:
        """Give all phases the state after the last action."""
        return np.repeat(np.asarray(rows)[-1:], K + 1, axis=0)

    clearance = problem.phase_clearance[-1:, PhasePart.START]
    after = problem._replace(
        mode_kind=of_phases(problem.mode_kind),
        mode_parent=of_phases(problem.mode_parent),
        mode_action=of_phases(problem.mode_action),
        finger_opening=of_phases(problem.finger_opening),
        regularization_target=slices,
        regularization_weight=np.zeros_like(slices),
        clearance=np.repeat(clearance, T, axis=0),
        sample_fraction=np.ones((T, PATH_SAMPLES)),
        sample_offset=np.zeros((T, PATH_SAMPLES, D)),
    )
    batch, x = stack([(after, Variables(slices, m))] * batch_sizes().path_lanes)
    chunks = lay_out_chunks(batch, x)
    found = [np.asarray(measure_chunk(model, chunk).distance).min(axis=1) for chunk in chunks]
    return np.concatenate(found)[: T * PATH_SAMPLES : PATH_SAMPLES][: len(q)]
