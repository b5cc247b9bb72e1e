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

from dvr_jax.checker.contacts import Contacts, contacts_of, solid_geoms
from dvr_jax.checker.dense_states import states_between

STEP_LENGTH = 0.002
"""Longest way that two geoms move relative to each other between two states that are looked at [m]. Half of it is the
largest depth by which a penetration in between exceeds what is seen."""


@dataclass(frozen=True, slots=True)
class GeomPoses:
    """World poses of all geoms of a model in many states."""

    positions: Float[np.ndarray, "states geoms 3"]
    """Centers [m]."""

    rotations: Float[np.ndarray, "states geoms 3 3"]
    """Rotations."""


def find_contacts(
    model: mujoco.MjModel, states: Float[np.ndarray, "states nq"], poses: GeomPoses
) -> Contacts:
    """Find the contacts in all states of a motion and between them.

    Args:
        model: Model of the scene; its margins are overwritten.
        states: States, as `dense_states` returns them.
        poses: Poses of the geoms in these states.

    Returns:
        The contacts; one between two states counts as one of the later state.
    """
    # Geoms that collide with nothing need no reach.
    solid = np.flatnonzero(solid_geoms(model))
    reach = np.zeros((len(states) - 1, model.ngeom))
    shift = np.diff(poses.positions[:, solid], axis=0)
    turn = np.diff(poses.rotations[:, solid], axis=0)
    reach[:, solid] = _farthest_move(shift, turn, model.geom_rbound[solid])

    # A pair is near if its geoms could meet within half of the longer of the two adjacent steps.
    padded = np.pad(reach, ((1, 1), (0, 0)))
    margins = np.maximum(padded[:-1], padded[1:]) / 2
    at_states = contacts_of(model, states, margins)

    pieces = _pieces(model, at_states, reach, poses)
    inner, step = states_between(model, states, pieces)
    between = contacts_of(model, inner, np.zeros((len(inner), model.ngeom)))

    return Contacts(
        state=np.concatenate([at_states.state, step[between.state] + 1]),
        distance=np.concatenate([at_states.distance, between.distance]),
        geoms=np.concatenate([at_states.geoms, between.geoms]),
    )


def _farthest_move(
    shift: Float[np.ndarray, "*batch 3"],
    turn: Float[np.ndarray, "*batch 3 3"],
    radius: Float[np.ndarray, "*#batch"],
) -> Float[np.ndarray, "*batch"]:
    """Bound how far any point of a body moves.

    A point at a distance r from the body's origin moves by at most ``|shift| + |turn| r / sqrt(2)``: by an angle a it
    turns along an arc of the chord ``2 r sin(a / 2)``, and the Frobenius norm is ``|turn| = sqrt(8) sin(a / 2)``.

    Args:
        shift: How far the body's origin moves [m].
        turn: Difference of the body's rotations.
        radius: Largest distance of the body's points from its origin [m].

    Returns:
        The bound [m].
    """
    chord = np.linalg.norm(turn, axis=(-2, -1)) / np.sqrt(2) * radius
    return np.asarray(np.linalg.norm(shift, axis=-1) + chord)


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
    model: mujoco.MjModel,
    contacts: Contacts,
    reach: Float[np.ndarray, "steps geoms"],
    poses: GeomPoses,
) -> Int[np.ndarray, " steps"]:
    """Find the number of pieces into which each step is divided, so that no geoms meet unseen within a piece.

    Let two geoms move by a way w relative to each other in a step, and be d and e apart at its two ends. Then they
    penetrate by at most ``(w - d - e) / 2`` within the step. Where ``w - d - e > STEP_LENGTH``, the step is divided
    into ``w / STEP_LENGTH`` pieces.

    Args:
        model: Model of the scene.
        contacts: What touches or is near at the ends of the steps.
        reach: How far any point of a geom moves in a step, at most [m].
        poses: Poses of the geoms at the ends of the steps.

    Returns:
        The numbers of pieces.
    """
    seen = _encounters(contacts, reach)
    doubtful = seen.way - seen.apart > STEP_LENGTH
    step = seen.step[doubtful]
    first = seen.first[doubtful]
    second = seen.second[doubtful]

    # Neighbors on an arm, and a gripper and what it holds, move together: seen from one, the other moves less.
    p, R = _relative_poses(poses, step, first, second)
    p_after, R_after = _relative_poses(poses, step + 1, first, second)
    relative = _farthest_move(p_after - p, R_after - R, model.geom_rbound[second])
    way = np.minimum(seen.way[doubtful], relative)
    near = way - seen.apart[doubtful] > STEP_LENGTH

    pieces = np.ones(len(reach), np.int64)
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


def _relative_poses(
    poses: GeomPoses,
    state: Int[np.ndarray, " n"],
    first: Int[np.ndarray, " n"],
    second: Int[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Compute the pose of one geom in the frame of another.

    Args:
        poses: World poses of all geoms.
        state: State of each pair.
        first: Geom whose frame is used.
        second: Geom whose pose is computed.

    Returns:
        Positions [m] and rotations.
    """
    to_first = poses.rotations[state, first].swapaxes(-2, -1)
    shift = poses.positions[state, second] - poses.positions[state, first]
    return (to_first @ shift[..., None])[..., 0], to_first @ poses.rotations[state, second]
