"""What touches in a motion, by MuJoCo C's collisions: at each sample, and in between where things pass closely."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.check.motion import Motion
from dvr_jax.scene.mjcf import qpos_layout

Floats = NDArray[np.float64]

STEP_LENGTH = 0.01
"""Where two things may meet between two samples, states are looked at between which they move no more than this, m."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """C pairs of geoms that touch or are near."""

    sample: NDArray[np.int64]
    """(C,) of the motion; for a state between two samples, the latter."""
    distance: Floats
    """(C,), negative where they penetrate, m."""
    geoms: NDArray[np.int32]
    """(C, 2)."""


class Carried(NamedTuple):
    """An object's body that moves with a hand's from sample `start` to `end` - 1."""

    body: int
    hand: int
    start: int
    end: int


def find_contacts(
    model: mujoco.MjModel, motion: Motion, positions: Floats, rotations: Floats, carried: Sequence[Carried]
) -> Contacts:
    """Contacts at all samples, and at states between two samples where things are closer than they move.

    Args:
        model: of the scene; its margins are overwritten.
        positions: (T, G, 3) of the geoms at the samples, m.
        rotations: (T, G, 9).
        carried: pairs that touch and stay together, for which no states in between are needed.
    """
    # How far any point of a geom goes in a step, at most.
    reach = np.linalg.norm(np.diff(positions, axis=0), axis=-1)
    reach += np.linalg.norm(np.diff(rotations, axis=0), axis=-1) / np.sqrt(2) * model.geom_rbound
    farthest = np.pad(reach.max(axis=1), 1)
    T = len(motion.qpos)
    at_samples = _contacts_of(model, motion.qpos, np.arange(T), np.maximum(farthest[:-1], farthest[1:]))
    states, steps = _states_between(motion, _pieces(model, at_samples, reach, carried))
    between = _contacts_of(model, states, steps, np.zeros(len(steps)))
    return Contacts(
        np.concatenate([at_samples.sample, between.sample]),
        np.concatenate([at_samples.distance, between.distance]),
        np.concatenate([at_samples.geoms, between.geoms]),
    )


def _contacts_of(model: mujoco.MjModel, states: Floats, samples: NDArray[np.int64], margins: Floats) -> Contacts:
    """Of states (S, nq), told as those of samples (S,); what is nearer than a margin (S,) [m] is a contact."""
    data = mujoco.MjData(model)
    sample, distance, geoms = [np.empty(0, np.int64)], [np.empty(0)], [np.empty((0, 2), np.int32)]
    for number, qpos, margin in zip(samples, states, margins, strict=True):
        data.qpos[:], model.geom_margin[:] = qpos, margin
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            sample.append(np.full(data.ncon, number))
            distance.append(np.array(data.contact.dist))
            geoms.append(np.array(data.contact.geom))
    return Contacts(np.concatenate(sample), np.concatenate(distance), np.concatenate(geoms))


def _pieces(model: mujoco.MjModel, contacts: Contacts, reach: Floats, carried: Sequence[Carried]) -> NDArray[np.int64]:
    """Into how many pieces each step (T - 1,) is divided, so that nothing is missed between two samples; `reach`
    (T - 1, G) is how far a geom goes in a step [m]."""
    steps = len(reach)
    pieces = np.ones(steps, np.int64)
    body = model.geom_bodyid[contacts.geoms]
    together = np.zeros(len(body), bool)
    for pair in carried:
        gripper = ((body == pair.hand) | (model.body_parentid[body] == pair.hand)).any(axis=1)
        within = (contacts.sample >= pair.start) & (contacts.sample < pair.end)
        together |= within & gripper & (body == pair.body).any(axis=1)
    for step in (contacts.sample - 1, contacts.sample):
        valid = (step >= 0) & (step < steps) & ~together
        both = np.zeros(len(step))
        both[valid] = reach[step[valid, None], contacts.geoms[valid]].sum(axis=1)
        # Whatever is between two samples is no farther from one of them than half of the way.
        near = valid & (both > STEP_LENGTH) & (contacts.distance < both / 2)
        np.maximum.at(pieces, step[near], np.ceil(both[near] / STEP_LENGTH).astype(np.int64))
    return pieces


def _states_between(motion: Motion, pieces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """States (S, nq) that divide each step into its pieces, on straight lines, and the samples (S,) behind them."""
    step = np.repeat(np.arange(len(pieces)), pieces - 1)
    number = np.arange(len(step)) - np.repeat(np.cumsum(pieces - 1) - (pieces - 1), pieces - 1)
    share = ((number + 1) / pieces[step])[:, None]
    before, after = motion.qpos[step], motion.qpos[step + 1].copy()
    for columns in qpos_layout((motion.qpos.shape[1] - qpos_layout(0).size) // 7).objects[:, 3:]:
        after[:, columns] *= np.where((before[:, columns] * after[:, columns]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return before + share * (after - before), step + 1  # MuJoCo normalizes quaternions
