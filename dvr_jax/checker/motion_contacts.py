"""Which bodies touch in a motion: in its states, and between two states where bodies that pass closely might touch.

Between two states a geom moves along a known way. Two geoms whose distances at both ends are long enough, compared with
the way that they move relative to each other, cannot meet in between. For all others the check divides the step into
pieces of `STEP_LENGTH`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.checker.all_poses import all_poses
from dvr_jax.checker.collision_model import CollisionModel, solid_geoms
from dvr_jax.checker.contacts import Contacts, joined_contacts, near_contacts
from dvr_jax.checker.contacts_at_states import contacts_at_states
from dvr_jax.checker.dense_states import states_between
from dvr_jax.checker.geom_poses import GeomPoses, farthest_move, relative_poses
from dvr_jax.checker.pair_distances import PairsInStates, pair_distances

STEP_LENGTH = 0.002
"""Longest way that two geoms move relative to each other between two states that are looked at [m]. Half of it is the
largest depth by which a penetration in between exceeds what is seen."""


def find_contacts(
    scene_model: CollisionModel,
    states: Float[np.ndarray, "states nq"],
    poses: GeomPoses,
    accepted: Float[np.ndarray, "geoms geoms"],
) -> Contacts:
    """Find the contacts in all states of a motion and between them.

    Args:
        scene_model: Model of the scene; its margins and its data are overwritten.
        states: States, as `dense_states` returns them.
        poses: Poses of the geoms in these states.
        accepted: Depth up to which two geoms may penetrate each other [m].

    Returns:
        The contacts; one between two states counts as one of the later state.
    """
    # Geoms that collide with nothing need no reach.
    model = scene_model.model
    solid = np.flatnonzero(solid_geoms(model))
    reach = np.zeros((len(states) - 1, model.ngeom))
    shift = np.diff(poses.positions[:, solid], axis=0)
    turn = np.diff(poses.rotations[:, solid], axis=0)
    reach[:, solid] = farthest_move(shift, turn, model.geom_rbound[solid])

    at_states = contacts_at_states(scene_model, states, poses, reach, accepted)
    seen = _encounters(at_states, reach)
    pieces = _pieces(model, seen, len(reach), poses)
    between = _contacts_between(scene_model, states, seen, pieces)
    return joined_contacts(at_states, between)


def _contacts_between(
    scene_model: CollisionModel,
    states: Float[np.ndarray, "states nq"],
    seen: _Encounters,
    pieces: Int[np.ndarray, " steps"],
) -> Contacts:
    """Find the contacts between states, in the steps that are divided.

    Args:
        scene_model: Model of the scene; its data is overwritten.
        states: States of the motion.
        seen: Pairs that might meet in a step.
        pieces: Number of pieces of each step.

    Returns:
        The contacts; they count as ones of the later state.
    """
    inner, step = states_between(scene_model.model, states, pieces)
    poses = all_poses(scene_model, inner).geoms

    # Every pair that might meet in a step, in each of the states within this step.
    number = (pieces - 1)[seen.step]
    first_inner = np.searchsorted(step, seen.step)
    entry = np.repeat(np.arange(len(number)), number)
    offset = np.arange(len(entry)) - np.repeat(np.cumsum(number) - number, number)
    state = first_inner[entry] + offset
    pairs = PairsInStates(state, seen.first[entry], seen.second[entry], np.zeros(len(entry)))

    found = near_contacts(pairs, pair_distances(scene_model, poses, pairs))
    return Contacts(step[found.state] + 1, found.distance, found.geoms)


@dataclass(frozen=True, slots=True)
class _Encounters:
    """Pairs of geoms that might meet in a step between two states."""

    step: Int[np.ndarray, " encounters"]
    """The step."""

    first: Int[np.ndarray, " encounters"]
    """The geom of the lower number."""

    second: Int[np.ndarray, " encounters"]
    """The other geom."""

    way: Float[np.ndarray, " encounters"]
    """Bound of how far the two move relative to each other [m]."""

    apart: Float[np.ndarray, " encounters"]
    """Sum of the distances at both ends of the step [m]."""


def _pieces(
    model: mujoco.MjModel, seen: _Encounters, steps: int, poses: GeomPoses
) -> Int[np.ndarray, " steps"]:
    """Find the number of pieces into which each step is divided, so that no geoms meet unseen within a piece.

    Let two geoms move by a way w relative to each other in a step, and be d and e apart at its two ends. Then they
    penetrate by at most ``(w - d - e) / 2`` within the step. Where ``w - d - e > STEP_LENGTH``, the step is divided
    into ``w / STEP_LENGTH`` pieces.

    Args:
        model: Model of the scene.
        seen: Pairs that might meet in a step.
        steps: Number of the steps.
        poses: Poses of the geoms at the ends of the steps.

    Returns:
        The numbers of pieces.
    """
    # A step in which no geoms move by more than the length of a piece is a single piece.
    doubtful = (seen.way - seen.apart > STEP_LENGTH) & (seen.way > STEP_LENGTH)
    step = seen.step[doubtful]
    first = seen.first[doubtful]
    second = seen.second[doubtful]

    # Neighbors on an arm, and a gripper and what it holds, move together: seen from one, the other moves less.
    p, R = relative_poses(poses, step, first, second)
    p_after, R_after = relative_poses(poses, step + 1, first, second)
    relative = farthest_move(p_after - p, R_after - R, model.geom_rbound[second])
    way = np.minimum(seen.way[doubtful], relative)
    near = way - seen.apart[doubtful] > STEP_LENGTH

    pieces = np.ones(steps, np.int64)
    np.maximum.at(pieces, step[near], np.ceil(way[near] / STEP_LENGTH).astype(np.int64))
    return pieces


def _encounters(contacts: Contacts, reach: Float[np.ndarray, "steps geoms"]) -> _Encounters:
    """Collect the pairs that are near at either end of a step.

    Args:
        contacts: What touches or is near at the ends of the steps.
        reach: How far any point of a geom moves in a step, at most [m].

    Returns:
        Each pair once for each step, with its distances at both ends.
    """
    steps, geoms = reach.shape
    lower, higher = np.sort(contacts.geoms, axis=1).T
    pair = lower * geoms + higher

    # A contact in a state is one at the end of the step before it, and one at the start of the step after it.
    step_of_contact = np.concatenate([contacts.state, contacts.state - 1])
    end_of_contact = np.repeat([0, 1], len(pair))
    valid = (step_of_contact >= 0) & (step_of_contact < steps)
    keys, index = np.unique(
        (step_of_contact * geoms**2 + np.tile(pair, 2))[valid], return_inverse=True
    )
    step = keys // geoms**2
    first = keys // geoms % geoms
    second = keys % geoms

    # At an end where a pair was not found near, it is farther apart than half of its way.
    way = reach[step, first] + reach[step, second]
    distances = np.repeat(way[:, None] / 2, 2, axis=1)
    np.minimum.at(
        distances,
        (index, end_of_contact[valid]),
        np.tile(contacts.distance, 2)[valid],
    )
    return _Encounters(step, first, second, way, distances.sum(axis=1))
