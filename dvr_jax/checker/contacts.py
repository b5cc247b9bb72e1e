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
from jaxtyping import Bool, Float, Int


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
    model: mujoco.MjModel,
    states: Float[np.ndarray, "states nq"],
    margins: Float[np.ndarray, "states geoms"],
) -> Contacts:
    """Find the pairs of geoms in each state that are nearer to each other than the sum of their margins.

    Args:
        model: Model of the scene; its margins are overwritten.
        states: States.
        margins: Margin of each geom in each state [m].

    Returns:
        The contacts.
    """
    pairs = _single_pairs(model)
    limits = margins[:, pairs.first] + margins[:, pairs.second]
    radii = model.geom_rbound[pairs.first] + model.geom_rbound[pairs.second]
    squared_reach = (radii + limits) ** 2
    geoms_of_pair = list(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True))
    body_margins = _body_margins(model, margins)

    # The arrays of a model and its data stay where they are, and looking them up takes as long as filling them.
    data = mujoco.MjData(model)
    state = data.qpos
    geom_margin = model.geom_margin
    body_margin = model.body_margin
    position = data.geom_xpos
    found = _ContactLists()
    for index, qpos in enumerate(states):
        state[:] = qpos
        geom_margin[:] = margins[index]
        body_margin[:] = body_margins[index]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found.add_state(index, data)

        # Pairs whose bounding spheres are too far apart need no exact distance.
        apart = position[pairs.first] - position[pairs.second]
        candidates = np.flatnonzero(np.einsum("pi,pi->p", apart, apart) < squared_reach[index])
        for pair in candidates.tolist():
            limit = float(limits[index, pair])
            distance = mujoco.mj_geomDistance(model, data, *geoms_of_pair[pair], limit, None)
            found.singles.append((index, pair, distance))

    return found.merged(pairs, limits)


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


@dataclass(frozen=True, slots=True)
class _SinglePairs:
    """Pairs of geoms whose distance is computed for the pair alone."""

    first: Int[np.ndarray, " pairs"]
    """First geom of each pair."""

    second: Int[np.ndarray, " pairs"]
    """Second geom, of a higher number."""

    table: Bool[np.ndarray, "geoms geoms"]
    """Whether two geoms are such a pair."""


def _single_pairs(model: mujoco.MjModel) -> _SinglePairs:
    """Find the pairs of two boxes, or of a cylinder and anything, that are solid and not both fixed."""
    is_box = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    is_cylinder = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
    is_fixed = model.body_weldid[model.geom_bodyid] == 0
    solid = solid_geoms(model)

    by_shape = (is_box[:, None] & is_box) | is_cylinder[:, None] | is_cylinder
    may_meet = solid[:, None] & solid & ~(is_fixed[:, None] & is_fixed)
    table = by_shape & may_meet & ~np.eye(model.ngeom, dtype=bool)
    first, second = np.argwhere(np.triu(table)).T
    return _SinglePairs(first, second, table)


def solid_geoms(model: mujoco.MjModel) -> Bool[np.ndarray, " geoms"]:
    """Find the geoms that collide with others."""
    return np.asarray((model.geom_contype & model.geom_conaffinity) > 0)


@dataclass(slots=True)
class _ContactLists:
    """Contacts of states that are looked at one after the other."""

    states: list[int] = field(default_factory=list)
    """State of each entry of the two lists below."""

    distances: list[Float[np.ndarray, " found"]] = field(default_factory=lambda: [np.empty(0)])
    """Distances that the collision detection found in each of these states [m]."""

    geoms: list[Int[np.ndarray, "found 2"]] = field(
        default_factory=lambda: [np.empty((0, 2), np.int32)]
    )
    """Geoms that it found."""

    singles: list[tuple[int, int, float]] = field(default_factory=list)
    """State, number of the pair, and distance [m] of single pairs."""

    def add_state(self, state: int, data: mujoco.MjData) -> None:
        """Keep what the collision detection found in a state."""
        if data.ncon:
            contact = data.contact
            self.states += [state] * data.ncon
            self.distances.append(np.array(contact.dist))
            self.geoms.append(np.array(contact.geom))

    def merged(self, pairs: _SinglePairs, limits: Float[np.ndarray, "states pairs"]) -> Contacts:
        """Join both kinds: single pairs within their limits, and what the collision detection found of all others."""
        singles = np.array(self.singles, float).reshape(-1, 3)
        state_of_single = singles[:, 0].astype(int)
        pair_of_single = singles[:, 1].astype(int)
        distance_of_single = singles[:, 2]
        near = distance_of_single < limits[state_of_single, pair_of_single]
        pair_geoms = np.stack([pairs.first, pairs.second], axis=1)

        geoms = np.concatenate(self.geoms)
        kept = ~pairs.table[geoms[:, 0], geoms[:, 1]]
        states = np.array(self.states, np.int64)
        return Contacts(
            state=np.concatenate([states[kept], state_of_single[near]]),
            distance=np.concatenate(
                [np.concatenate(self.distances)[kept], distance_of_single[near]]
            ),
            geoms=np.concatenate([geoms[kept], pair_geoms[pair_of_single[near]]]),
        )
