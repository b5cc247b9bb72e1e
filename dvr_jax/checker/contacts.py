"""Which bodies touch in a state, by MuJoCo C.

MuJoCo's collision detection finds the exact distances of capsules to each other and to boxes. For two boxes, and for
whatever touches a cylinder, it finds points of contact instead. They can lie less deep than the two bodies penetrate,
and there are none for some bodies that are merely near. For these pairs of geoms the check computes the distance of the
single pair (`mj_geomDistance`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.checker.collision_model import CollisionModel, SinglePairs
from dvr_jax.checker.geom_poses import GeomPoses
from dvr_jax.checker.pair_distances import PairsInStates, least_distances, pair_distances


@dataclass(frozen=True, slots=True)
class Contacts:
    """Pairs of geoms that touch or are near, in any of many states."""

    state: Int[np.ndarray, " contacts"]
    """State in which the pair touches."""

    distance: Float[np.ndarray, " contacts"]
    """Distance of the pair, negative where it penetrates [m]."""

    geoms: Int[np.ndarray, "contacts 2"]
    """The two geoms."""


def contacts_of(
    scene_model: CollisionModel,
    states: Float[np.ndarray, "states nq"],
    poses: GeomPoses,
    margins: Float[np.ndarray, "states geoms"],
) -> Contacts:
    """Find the pairs of geoms in each state that are nearer to each other than the sum of their margins.

    Args:
        scene_model: Model of the scene; its margins and its data are overwritten.
        states: States.
        poses: Poses of the geoms in these states.
        margins: Margin of each geom in each state [m].

    Returns:
        The contacts.
    """
    model = scene_model.model
    data = scene_model.data
    body_margins = _body_margins(model, margins)

    # The arrays of a model and its data stay where they are, and looking them up takes as long as filling them.
    state = data.qpos
    geom_margin = model.geom_margin
    body_margin = model.body_margin
    found = _ContactLists()
    for index, qpos in enumerate(states):
        state[:] = qpos
        geom_margin[:] = margins[index]
        body_margin[:] = body_margins[index]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found.add_state(index, data)

    return joined_contacts(
        found.merged(scene_model.singles), _contacts_of_singles(scene_model, poses, margins)
    )


def _contacts_of_singles(
    scene_model: CollisionModel, poses: GeomPoses, margins: Float[np.ndarray, "states geoms"]
) -> Contacts:
    """Find the single pairs that are nearer to each other than the sum of their margins.

    Args:
        scene_model: Model of the scene; its data is overwritten.
        poses: Poses of the geoms in all states.
        margins: Margin of each geom in each state [m].

    Returns:
        The contacts.
    """
    # Pairs whose bounds are too far apart need no exact distance.
    first = scene_model.singles.first
    second = scene_model.singles.second
    limits = margins[:, first] + margins[:, second]
    near = least_distances(scene_model.model, poses, first, second) < limits
    state, number = np.nonzero(near)
    pairs = PairsInStates(state, first[number], second[number], limits[near])
    return near_contacts(pairs, pair_distances(scene_model, poses, pairs))


def near_contacts(pairs: PairsInStates, distances: Float[np.ndarray, " pairs"]) -> Contacts:
    """Return the pairs that are nearer than their limits.

    Args:
        pairs: Pairs of geoms in states.
        distances: Their distances [m].

    Returns:
        The contacts.
    """
    near = distances < pairs.limit
    geoms = np.stack([pairs.first[near], pairs.second[near]], axis=1)
    return Contacts(pairs.state[near], distances[near], geoms)


def joined_contacts(first: Contacts, second: Contacts) -> Contacts:
    """Return the contacts of two searches.

    Args:
        first: Contacts of the first one.
        second: Contacts of the second one.

    Returns:
        All of them.
    """
    return Contacts(
        state=np.concatenate([first.state, second.state]),
        distance=np.concatenate([first.distance, second.distance]),
        geoms=np.concatenate([first.geoms, second.geoms]),
    )


def _body_margins(
    model: mujoco.MjModel, margins: Float[np.ndarray, "states geoms"]
) -> Float[np.ndarray, "states bodies"]:
    """Largest margin of each body's geoms [m].

    MuJoCo discards pairs of bodies by these margins, which it computes only when it compiles a model.
    """
    with_geoms = np.flatnonzero(model.body_geomnum)
    of_bodies = np.zeros((len(margins), model.nbody))
    of_bodies[:, with_geoms] = np.maximum.reduceat(margins, model.body_geomadr[with_geoms], axis=1)
    return of_bodies


@dataclass(slots=True)
class _ContactLists:
    """Contacts that the collision detection finds in states that are looked at one after the other."""

    states: list[int] = field(default_factory=list)
    """State of each contact."""

    distances: list[Float[np.ndarray, " found"]] = field(default_factory=lambda: [np.empty(0)])
    """Distances in each of these states [m]."""

    geoms: list[Int[np.ndarray, "found 2"]] = field(
        default_factory=lambda: [np.empty((0, 2), np.int32)]
    )
    """Geoms of each contact."""

    def add_state(self, state: int, data: mujoco.MjData) -> None:
        """Keep what the collision detection found in a state."""
        number = data.ncon
        if number:
            contact = data.contact
            self.states += [state] * number
            self.distances.append(np.array(contact.dist))
            self.geoms.append(np.array(contact.geom))

    def merged(self, singles: SinglePairs) -> Contacts:
        """Join the contacts of all states, except those of single pairs."""
        states = np.array(self.states, np.int64)
        distances = np.concatenate(self.distances)
        geoms = np.concatenate(self.geoms)
        kept = ~singles.table[geoms[:, 0], geoms[:, 1]]
        return Contacts(states[kept], distances[kept], geoms[kept])
