"""What touches in a motion, by MuJoCo C: at each sample, and in between where things that pass closely might touch.

MuJoCo's collisions tell the distances of capsules, to each other and to boxes, as they are. Of two boxes, and of what
touches a cylinder, they tell points of contact, which can lie less deep than the two are in each other, and nothing of
some that are near: those distances are MuJoCo's of single pairs."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.motion.motion import Motion
from dvr_jax.scene.mjcf import qpos_layout

Floats = NDArray[np.float64]
_Indices = NDArray[np.int64]

STEP_LENGTH = 0.002
"""Two things are looked at so often that between two looks they get deeper into each other by half of this, at most
[m]."""
LARGEST_TURN = 0.2
"""Largest turn of a joint or an object between two looks [rad]: an arc is hardly longer than its chord."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """C pairs of geoms that touch or are near."""

    state: _Indices
    """(C,) in which state."""
    distance: Floats
    """(C,), negative where they penetrate, m."""
    geoms: NDArray[np.int32]
    """(C, 2)."""


def dense_states(motion: Motion) -> tuple[Floats, _Indices]:
    """States (S, nq) of a motion, its samples and those that divide large turns between them, and the samples (S,) that
    they are or come before."""
    joints = qpos_layout(0).arm_joints.reshape(-1)
    turn = np.abs(np.diff(motion.qpos[:, joints], axis=0)).max(axis=1)
    for columns in _quaternions(motion.qpos.shape[1]):
        before, after = motion.qpos[:-1, columns], motion.qpos[1:, columns]
        turn = np.maximum(turn, 2 * np.arccos(np.clip(np.abs((before * after).sum(axis=1)), 0, 1)))
    pieces = np.maximum(np.ceil(turn / LARGEST_TURN), 1).astype(np.int64)
    between, step = states_between(motion.qpos, pieces)
    behind = np.concatenate([np.arange(len(motion.qpos)), step + 1])
    # A sample comes after what leads to it.
    order = np.lexsort((np.repeat([1, 0], [len(motion.qpos), len(step)]), behind))
    return np.concatenate([motion.qpos, between])[order], behind[order]


def find_contacts(model: mujoco.MjModel, states: Floats, positions: Floats, rotations: Floats) -> Contacts:
    """Contacts in all states of a motion and between them, told as in the latter of the two.

    Args:
        model: of the scene; its margins are overwritten.
        states: (S, nq), as of `dense_states`.
        positions: (S, G, 3) of the geoms, m.
        rotations: (S, G, 3, 3).
    """
    # How far any point of a geom goes in a step, at most; what collides with nothing need not be known.
    solid = np.flatnonzero(model.geom_contype & model.geom_conaffinity)
    reach = np.zeros((len(positions) - 1, model.ngeom))
    before, after = (slice(None, -1), solid), (slice(1, None), solid)
    reach[:, solid] = _travel(
        positions[after] - positions[before], rotations[after] - rotations[before], model.geom_rbound[solid]
    )
    padded = np.pad(reach, ((1, 1), (0, 0)))
    at_states = contacts_of(model, states, np.maximum(padded[:-1], padded[1:]) / 2)
    inner, step = states_between(states, _pieces(model, at_states, reach, positions, rotations))
    between = contacts_of(model, inner, np.zeros((len(inner), model.ngeom)))
    return Contacts(
        np.concatenate([at_states.state, step[between.state] + 1]),
        np.concatenate([at_states.distance, between.distance]),
        np.concatenate([at_states.geoms, between.geoms]),
    )


def _travel(shift: Floats, turn: Floats, radius: Floats) -> Floats:
    """How far a point of a body within a radius (...) of its origin goes at most, m, as its origin goes by `shift`
    (..., 3) and its rotation changes by `turn` (..., 3, 3)."""
    return np.asarray(np.linalg.norm(shift, axis=-1) + np.linalg.norm(turn, axis=(-2, -1)) / np.sqrt(2) * radius)


def contacts_of(model: mujoco.MjModel, states: Floats, margins: Floats) -> Contacts:
    """Of states (S, nq): a pair of geoms that is nearer than the sum of its margins (S, G) [m] is a contact."""
    data = mujoco.MjData(model)
    # MuJoCo drops pairs of bodies by margins of their own, which it computes from the geoms' as it compiles a model.
    filled = np.flatnonzero(model.body_geomnum)
    of_bodies = np.zeros((len(states), model.nbody))
    of_bodies[:, filled] = np.maximum.reduceat(margins, model.body_geomadr[filled], axis=1)
    state, geom_margin, body_margin, position = data.qpos, model.geom_margin, model.body_margin, data.geom_xpos
    is_single = _single_pairs(model)
    first, second = np.argwhere(np.triu(is_single)).T
    limits = margins[:, first] + margins[:, second]
    farthest = (model.geom_rbound[first] + model.geom_rbound[second] + limits) ** 2
    number = np.zeros(len(states), np.int64)
    told, geoms = [np.empty(0)], [np.empty((0, 2), np.int32)]
    singles: list[tuple[int, int, float]] = []
    pairs = list(zip(first.tolist(), second.tolist(), strict=True))
    for index, qpos in enumerate(states):
        state[:], geom_margin[:], body_margin[:] = qpos, margins[index], of_bodies[index]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            number[index], contact = data.ncon, data.contact
            told.append(np.array(contact.dist))
            geoms.append(np.array(contact.geom))
        apart = position[first] - position[second]
        for pair in np.flatnonzero(np.einsum("pi,pi->p", apart, apart) < farthest[index]).tolist():
            limit = float(limits[index, pair])
            singles.append((index, pair, mujoco.mj_geomDistance(model, data, *pairs[pair], limit, None)))
    table = np.array(singles, float).reshape(-1, 3)
    of_single, pair_of_single, single = table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2]
    near = single < limits[of_single, pair_of_single]
    geom = np.concatenate(geoms)
    kept = ~is_single[geom[:, 0], geom[:, 1]]
    return Contacts(
        np.concatenate([np.repeat(np.arange(len(states)), number)[kept], of_single[near]]),
        np.concatenate([np.concatenate(told)[kept], single[near]]),
        np.concatenate([geom[kept], np.stack([first, second], axis=1)[pair_of_single[near]]]),
    )


def _single_pairs(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """(G, G): pairs of solid geoms, not both of them fixed, whose distance is taken for the pair alone."""
    solid = (model.geom_contype & model.geom_conaffinity) > 0
    is_box = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    is_cylinder = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
    fixed = model.body_weldid[model.geom_bodyid] == 0
    single = (is_box[:, None] & is_box) | is_cylinder[:, None] | is_cylinder
    return np.asarray(single & solid[:, None] & solid & ~(fixed[:, None] & fixed) & ~np.eye(len(solid), dtype=bool))


def _pieces(model: mujoco.MjModel, contacts: Contacts, reach: Floats, positions: Floats, rotations: Floats) -> _Indices:
    """Into how many pieces each step (S - 1,) between two states is divided; `reach` (S - 1, G) is how far a geom goes
    in a step [m]."""
    steps, number = reach.shape
    # A contact in a state is one at the end of a step, and one at the start of the next.
    first, second = np.sort(contacts.geoms, axis=1).T
    pair = first * number + second
    step = np.concatenate([contacts.state, contacts.state - 1])
    valid = (step >= 0) & (step < steps)
    keys, index = np.unique((step * number**2 + np.tile(pair, 2))[valid], return_inverse=True)
    step, first, second = keys // number**2, keys // number % number, keys % number
    # What is told at one end only is farther apart at the other than half of the way.
    way = reach[step, first] + reach[step, second]
    ends = np.repeat(way[:, None] / 2, 2, axis=1)
    end = np.repeat([0, 1], len(pair))
    np.minimum.at(ends, (index, end[valid]), np.tile(contacts.distance, 2)[valid])
    # In between two things are as deep in each other as half of what the way is longer than they are apart, at most.
    apart = ends.sum(axis=1)
    doubtful = way - apart > STEP_LENGTH
    step, first, second, way, apart = (values[doubtful] for values in (step, first, second, way, apart))
    # Neighbours on an arm, and a gripper and what it holds, move together: seen from one the other goes less far.
    p, R = _relative_pose(positions, rotations, step, first, second)
    p_after, R_after = _relative_pose(positions, rotations, step + 1, first, second)
    way = np.minimum(way, _travel(p_after - p, R_after - R, model.geom_rbound[second]))
    near = way - apart > STEP_LENGTH
    pieces = np.ones(steps, np.int64)
    np.maximum.at(pieces, step[near], np.ceil(way[near] / STEP_LENGTH).astype(np.int64))
    return pieces


def _relative_pose(
    positions: Floats, rotations: Floats, state: _Indices, first: _Indices, second: _Indices
) -> tuple[Floats, Floats]:
    """Position (L, 3) and rotation (L, 3, 3) of the geom `second` as seen from the geom `first` in a state, each (L,),
    of positions (S, G, 3) and rotations (S, G, 3, 3)."""
    seen_from = rotations[state, first].swapaxes(-2, -1)
    shift = positions[state, second] - positions[state, first]
    return (seen_from @ shift[..., None])[..., 0], seen_from @ rotations[state, second]


def states_between(states: Floats, pieces: _Indices) -> tuple[Floats, _Indices]:
    """States (L, nq) that divide each step into its pieces (S - 1,), on straight lines, and their steps (L,)."""
    step = np.repeat(np.arange(len(pieces)), pieces - 1)
    number = np.arange(len(step)) - np.repeat(np.cumsum(pieces - 1) - (pieces - 1), pieces - 1)
    share = ((number + 1) / pieces[step])[:, None]
    before, after = states[step], states[step + 1].copy()
    for columns in _quaternions(states.shape[1]):
        after[:, columns] *= np.where((before[:, columns] * after[:, columns]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return before + share * (after - before), step  # MuJoCo normalizes quaternions


def _quaternions(nq: int) -> _Indices:
    """(N, 4) columns of the objects' quaternions in states of so many numbers."""
    return qpos_layout((nq - qpos_layout(0).size) // 7).objects[:, 3:]
