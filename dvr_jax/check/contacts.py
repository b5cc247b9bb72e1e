"""What touches in a motion, by MuJoCo C's collisions: at each sample, and in between where things pass closely."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.check.motion import Motion
from dvr_jax.scene.mjcf import qpos_layout

Floats = NDArray[np.float64]
_Indices = NDArray[np.int64]

STEP_LENGTH = 0.006
"""Two things that might meet deeper than half of this between two samples are looked at in states between which they
move no more than this, m."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """C pairs of geoms that touch or are near."""

    sample: _Indices
    """(C,) of the motion; for a state between two samples, the latter."""
    distance: Floats
    """(C,), negative where they penetrate, m."""
    geoms: NDArray[np.int32]
    """(C, 2)."""


def find_contacts(model: mujoco.MjModel, motion: Motion, positions: Floats, rotations: Floats) -> Contacts:
    """Contacts at all samples, and at states between two samples where things are closer than they move.

    Args:
        model: of the scene; its margins are overwritten.
        positions: (T, G, 3) of the geoms at the samples, m.
        rotations: (T, G, 3, 3).
    """
    # How far any point of a geom goes in a step, at most; what collides with nothing need not be known.
    solid = np.flatnonzero(model.geom_contype & model.geom_conaffinity)
    reach = np.zeros((len(positions) - 1, model.ngeom))
    before, after = (slice(None, -1), solid), (slice(1, None), solid)
    reach[:, solid] = _travel(
        positions[after] - positions[before], rotations[after] - rotations[before], model.geom_rbound[solid]
    )
    padded = np.pad(reach, ((1, 1), (0, 0)))
    # Two geoms are told as a contact where they are closer than the sum of their margins.
    at_samples = contacts_of(model, motion.qpos, np.arange(len(motion.qpos)), np.maximum(padded[:-1], padded[1:]) / 2)
    states, steps = _states_between(motion, _pieces(model, at_samples, reach, positions, rotations))
    between = contacts_of(model, states, steps, np.zeros((len(steps), model.ngeom)))
    return Contacts(
        np.concatenate([at_samples.sample, between.sample]),
        np.concatenate([at_samples.distance, between.distance]),
        np.concatenate([at_samples.geoms, between.geoms]),
    )


def _travel(shift: Floats, turn: Floats, radius: Floats) -> Floats:
    """How far a point of a body within a radius (...) of its origin goes at most, m, as its origin goes by `shift`
    (..., 3) and its rotation changes by `turn` (..., 3, 3)."""
    return np.asarray(np.linalg.norm(shift, axis=-1) + np.linalg.norm(turn, axis=(-2, -1)) / np.sqrt(2) * radius)


def contacts_of(model: mujoco.MjModel, states: Floats, samples: _Indices, margins: Floats) -> Contacts:
    """Of states (S, nq), told as those of samples (S,); what is nearer than its margins (S, G) [m] is a contact."""
    data = mujoco.MjData(model)
    # MuJoCo drops pairs of bodies by margins of their own, which it computes from the geoms' as it compiles a model.
    filled = np.flatnonzero(model.body_geomnum)
    of_bodies = np.zeros((len(states), model.nbody))
    of_bodies[:, filled] = np.maximum.reduceat(margins, model.body_geomadr[filled], axis=1)
    state, geom_margin, body_margin = data.qpos, model.geom_margin, model.body_margin
    number = np.zeros(len(states), np.int64)
    distance, geoms = [np.empty(0)], [np.empty((0, 2), np.int32)]
    for index, qpos in enumerate(states):
        state[:], geom_margin[:], body_margin[:] = qpos, margins[index], of_bodies[index]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            number[index] = data.ncon
            contact = data.contact
            distance.append(np.array(contact.dist))
            geoms.append(np.array(contact.geom))
    return Contacts(np.repeat(samples, number), np.concatenate(distance), np.concatenate(geoms))


def _pieces(model: mujoco.MjModel, contacts: Contacts, reach: Floats, positions: Floats, rotations: Floats) -> _Indices:
    """Into how many pieces each step (T - 1,) is divided, so that nothing is missed between two samples; `reach`
    (T - 1, G) is how far a geom goes in a step [m]."""
    steps, number = reach.shape
    # A contact at a sample is one at the end of a step, and one at the start of the next.
    first, second = np.sort(contacts.geoms, axis=1).T
    pair = first * number + second
    step = np.concatenate([contacts.sample, contacts.sample - 1])
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
    positions: Floats, rotations: Floats, sample: _Indices, first: _Indices, second: _Indices
) -> tuple[Floats, Floats]:
    """Position (L, 3) and rotation (L, 3, 3) of the geom `second` as seen from the geom `first` at a sample, each (L,),
    of positions (T, G, 3) and rotations (T, G, 3, 3)."""
    seen_from = rotations[sample, first].swapaxes(-2, -1)
    shift = positions[sample, second] - positions[sample, first]
    return (seen_from @ shift[..., None])[..., 0], seen_from @ rotations[sample, second]


def _states_between(motion: Motion, pieces: _Indices) -> tuple[Floats, _Indices]:
    """States (S, nq) that divide each step into its pieces, on straight lines, and the samples (S,) behind them."""
    step = np.repeat(np.arange(len(pieces)), pieces - 1)
    number = np.arange(len(step)) - np.repeat(np.cumsum(pieces - 1) - (pieces - 1), pieces - 1)
    share = ((number + 1) / pieces[step])[:, None]
    before, after = motion.qpos[step], motion.qpos[step + 1].copy()
    for columns in qpos_layout((motion.qpos.shape[1] - qpos_layout(0).size) // 7).objects[:, 3:]:
        after[:, columns] *= np.where((before[:, columns] * after[:, columns]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return before + share * (after - before), step + 1  # MuJoCo normalizes quaternions
