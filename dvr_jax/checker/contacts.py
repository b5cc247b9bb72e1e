"""What touches in a motion, by MuJoCo C: in its states, and between them where bodies that pass closely might touch.

MuJoCo's collision detection finds the exact distances of capsules to each other and to boxes. For two boxes, and for
whatever touches a cylinder, it finds points of contact instead: they can lie less deep than the two bodies penetrate, and
it finds none for some bodies that are merely near. For these pairs of geoms the distance of the single pair is computed
(`mj_geomDistance`).

Between two states a geom moves along a known way. Two geoms whose distance at both ends is long enough, compared with the
way that they move relative to each other, cannot meet in between; all others are looked at every `STEP_LENGTH`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.motion.motion import Motion

STEP_LENGTH = 0.002
"""Longest way that two geoms move relative to each other between two looks [m]. They penetrate at most half of it deeper
than is seen."""

LARGEST_TURN = 0.2
"""Largest turn of a joint or an object between two looks [rad]; within it an arc is hardly longer than its chord."""


@dataclass(frozen=True, slots=True)
class GeomPoses:
    """World poses of all geoms of a model in many states."""

    positions: Float[np.ndarray, "states geoms 3"]
    """Centers [m]."""

    rotations: Float[np.ndarray, "states geoms 3 3"]
    """Rotations."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """Pairs of geoms that touch or are near, in any of many states."""

    state: Int[np.ndarray, " contacts"]
    """State in which the pair touches."""

    distance: Float[np.ndarray, " contacts"]
    """Distance of the pair, negative where it penetrates [m]."""

    geoms: Int[np.ndarray, "contacts 2"]
    """The two geoms."""


def dense_states(
    model: mujoco.MjModel, motion: Motion
) -> tuple[Float[np.ndarray, "states nq"], Int[np.ndarray, " states"]]:
    """Insert states between the samples of a motion so that nothing turns by more than `LARGEST_TURN` at once.

    Args:
        model: Model of the scene.
        motion: The motion.

    Returns:
        The states in the order of time, and for each the sample that it is or leads to.
    """
    qpos = motion.qpos
    turn = np.abs(np.diff(qpos[:, _revolute_columns(model)], axis=0)).max(axis=1)
    for columns in _quaternion_columns(model):
        before = qpos[:-1, columns]
        after = qpos[1:, columns]
        # Half the angle between two orientations; a quaternion and its negative are the same orientation.
        cosine = np.clip(np.abs((before * after).sum(axis=1)), 0, 1)
        turn = np.maximum(turn, 2 * np.arccos(cosine))
    pieces = np.maximum(np.ceil(turn / LARGEST_TURN), 1).astype(np.int64)

    # Sort by the sample that a state leads to; a sample comes after the states that lead to it.
    between, step = states_between(model, qpos, pieces)
    sample = np.concatenate([np.arange(len(qpos)), step + 1])
    is_sample = np.repeat([1, 0], [len(qpos), len(step)])
    order = np.lexsort((is_sample, sample))
    return np.concatenate([qpos, between])[order], sample[order]


def states_between(
    model: mujoco.MjModel, states: Float[np.ndarray, "states nq"], pieces: Int[np.ndarray, " steps"]
) -> tuple[Float[np.ndarray, "inner nq"], Int[np.ndarray, " inner"]]:
    """Divide the steps between consecutive states evenly, on straight lines.

    Args:
        model: Model of the scene.
        states: States; there is one step less.
        pieces: Number of pieces of each step; 1 leaves a step as it is.

    Returns:
        The new states, whose quaternions are not normalized (MuJoCo does so), and the step of each.
    """
    step = np.repeat(np.arange(len(pieces)), pieces - 1)
    # Number of each new state within its step, from 1.
    first_of_step = np.cumsum(pieces - 1) - (pieces - 1)
    number = np.arange(len(step)) - np.repeat(first_of_step, pieces - 1) + 1
    fraction = (number / pieces[step])[:, None]

    before = states[step]
    after = states[step + 1].copy()
    for columns in _quaternion_columns(model):
        # Of the two quaternions of one orientation, take the nearer one.
        product = (before[:, columns] * after[:, columns]).sum(axis=1)
        after[:, columns] *= np.where(product < 0, -1.0, 1.0)[:, None]
    return before + fraction * (after - before), step


def _revolute_columns(model: mujoco.MjModel) -> Int[np.ndarray, " joints"]:
    """Places of all revolute joints in a state."""
    return np.asarray(model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE])


def _quaternion_columns(model: mujoco.MjModel) -> Int[np.ndarray, "objects 4"]:
    """Places of all objects' quaternions in a state."""
    first = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    # A free joint has three numbers for the position, then four for the quaternion.
    return np.asarray(first[:, None] + np.arange(3, 7))


def find_contacts(model: mujoco.MjModel, states: Float[np.ndarray, "states nq"], poses: GeomPoses) -> Contacts:
    """Find the contacts in all states of a motion and between them.

    Args:
        model: Model of the scene; its margins are overwritten.
        states: States, as `dense_states` returns them.
        poses: Poses of the geoms in these states.

    Returns:
        The contacts; one between two states counts as one of the later state.
    """
    # Geoms that collide with nothing need no reach.
    solid = np.flatnonzero(_is_solid(model))
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


def _is_solid(model: mujoco.MjModel) -> Bool[np.ndarray, " geoms"]:
    """Geoms that collide with others."""
    return np.asarray((model.geom_contype & model.geom_conaffinity) > 0)


def _farthest_move(
    shift: Float[np.ndarray, "*batch 3"],
    turn: Float[np.ndarray, "*batch 3 3"],
    radius: Float[np.ndarray, "*#batch"],
) -> Float[np.ndarray, "*batch"]:
    """Bound how far any point of a body moves.

    A point at a distance r of the body's origin moves by at most ``|shift| + |turn| r / sqrt(2)``: the Frobenius norm of
    the difference of two rotations is sqrt(2) times the chord of their angle.

    Args:
        shift: How far the body's origin moves [m].
        turn: Difference of the body's rotations.
        radius: Largest distance of the body's points from its origin [m].

    Returns:
        The bound [m].
    """
    return np.asarray(np.linalg.norm(shift, axis=-1) + np.linalg.norm(turn, axis=(-2, -1)) / np.sqrt(2) * radius)


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
    solid = _is_solid(model)

    by_shape = (is_box[:, None] & is_box) | is_cylinder[:, None] | is_cylinder
    may_meet = solid[:, None] & solid & ~(is_fixed[:, None] & is_fixed)
    table = by_shape & may_meet & ~np.eye(model.ngeom, dtype=bool)
    first, second = np.argwhere(np.triu(table)).T
    return _SinglePairs(first, second, table)


@dataclass(slots=True)
class _ContactLists:
    """Contacts of states that are looked at one after the other."""

    states: list[int] = field(default_factory=list)
    """State of each entry of the two lists below."""

    distances: list[Float[np.ndarray, " found"]] = field(default_factory=lambda: [np.empty(0)])
    """Distances that the collision detection found in each of these states [m]."""

    geoms: list[Int[np.ndarray, "found 2"]] = field(default_factory=lambda: [np.empty((0, 2), np.int32)])
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
            distance=np.concatenate([np.concatenate(self.distances)[kept], distance_of_single[near]]),
            geoms=np.concatenate([geoms[kept], pair_geoms[pair_of_single[near]]]),
        )


def contacts_of(
    model: mujoco.MjModel, states: Float[np.ndarray, "states nq"], margins: Float[np.ndarray, "states geoms"]
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
    model: mujoco.MjModel, contacts: Contacts, reach: Float[np.ndarray, "steps geoms"], poses: GeomPoses
) -> Int[np.ndarray, " steps"]:
    """Number of pieces into which each step is divided, so that no two geoms can meet unseen within a piece.

    In a step two geoms get as deep into each other as half of what their way is longer than the sum of their distances
    at both ends, at most.

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
    keys, index = np.unique((step_of_contact * geoms**2 + np.tile(pair, 2))[valid], return_inverse=True)
    step = keys // geoms**2
    first = keys // geoms % geoms
    second = keys % geoms

    # At an end where a pair was not found near, it is farther apart than half of its way.
    way = reach[step, first] + reach[step, second]
    distances = np.repeat(way[:, None] / 2, 2, axis=1)
    np.minimum.at(distances, (index, end_of_contact[valid]), np.tile(contacts.distance, 2)[valid])
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
