"""Distances of single pairs of geoms, by MuJoCo C, and which pairs need none because their bounds are far apart."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.checker.collision_model import CollisionModel
from dvr_jax.checker.geom_poses import GeomPoses


@dataclass(frozen=True, slots=True)
class PairsInStates:
    """Pairs of geoms, each in one state."""

    state: Int[np.ndarray, " pairs"]
    """The state."""

    first: Int[np.ndarray, " pairs"]
    """First geom."""

    second: Int[np.ndarray, " pairs"]
    """Second geom, of a higher number."""

    limit: Float[np.ndarray, " pairs"]
    """Distance from which on the exact one does not matter [m]."""

    def only(self, chosen: Bool[np.ndarray, " pairs"]) -> PairsInStates:
        """Return some of the pairs."""
        return PairsInStates(
            self.state[chosen], self.first[chosen], self.second[chosen], self.limit[chosen]
        )


def pair_distances(
    scene_model: CollisionModel, poses: GeomPoses, pairs: PairsInStates
) -> Float[np.ndarray, " pairs"]:
    """Compute the distance of each pair by `mj_geomDistance`.

    Args:
        scene_model: Model of the scene; its data is overwritten.
        poses: Poses of the geoms in all states.
        pairs: The pairs.

    Returns:
        The distances, negative where a pair penetrates, and at most the limit of the pair [m].
    """
    model = scene_model.model
    data = scene_model.data

    # State after state, so that the poses of each are set only once.
    order = np.argsort(pairs.state, kind="stable")
    geom_positions = data.geom_xpos
    geom_rotations = data.geom_xmat.reshape(-1, 3, 3)
    distances = np.empty(len(order))
    columns = (order, pairs.state[order], pairs.first[order], pairs.second[order])
    rows = zip(*(column.tolist() for column in columns), pairs.limit[order].tolist(), strict=True)
    current = -1
    for pair, state, first, second, limit in rows:
        if state != current:
            geom_positions[:] = poses.positions[state]
            geom_rotations[:] = poses.rotations[state]
            current = state
        distances[pair] = mujoco.mj_geomDistance(model, data, first, second, limit, None)
    return distances


def least_distances(
    model: mujoco.MjModel,
    poses: GeomPoses,
    first: Int[np.ndarray, " pairs"],
    second: Int[np.ndarray, " pairs"],
) -> Float[np.ndarray, "states pairs"]:
    """Bound the distances of pairs of geoms from below, in all states.

    A geom lies in its bounding box and in its bounding sphere. The distance of two geoms is at least that of the box of
    either one from the sphere of the other.

    Args:
        model: Model of the scene.
        poses: Poses of the geoms in all states.
        first: First geom of each pair.
        second: Second geom.

    Returns:
        The bounds [m]; negative where the box and the sphere overlap.
    """
    boxes_of_first = _box_to_sphere(model, poses, first, second)
    boxes_of_second = _box_to_sphere(model, poses, second, first)
    return np.maximum(boxes_of_first, boxes_of_second)


def _box_to_sphere(
    model: mujoco.MjModel,
    poses: GeomPoses,
    boxed: Int[np.ndarray, " pairs"],
    other: Int[np.ndarray, " pairs"],
) -> Float[np.ndarray, "states pairs"]:
    """Bound distances by the bounding box of one geom and the bounding sphere of the other.

    Args:
        model: Model of the scene.
        poses: Poses of the geoms in all states.
        boxed: Geom of each pair whose box is used.
        other: Geom whose sphere is used.

    Returns:
        The bounds [m].
    """
    shift = poses.positions[:, other] - poses.positions[:, boxed]
    local = np.einsum("...ji,...j->...i", poses.rotations[:, boxed], shift)
    center = model.geom_aabb[boxed, :3]
    half_extents = model.geom_aabb[boxed, 3:]
    outside = np.maximum(np.abs(local - center) - half_extents, 0.0)
    return np.asarray(np.linalg.norm(outside, axis=-1) - model.geom_rbound[other])
