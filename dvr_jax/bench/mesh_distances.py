"""The least signed distances of the real meshes in a motion, by kind of pair, computed by the library `coal`.

Nothing here is shared with the planner's distances, whose arms are capsules. A signed distance is positive apart and
minus the depth of a penetration.

Only the least distance of each kind is wanted, so most states need no distance. Let the signed distance of two bodies
be d in one state, and let no point of them move by more than w relative to the world until another state, both bodies
together. Then their signed distance there is at least ``d - w``. The next state that is looked at is the first one for
which this bound is below the least distance found so far.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from dvr_jax.bench.mesh_pairs import GRASPS, Pair, PairKind, pairs_of_motion
from dvr_jax.bench.motion_states import MotionStates


@dataclass(frozen=True, slots=True)
class LeastDistance:
    """The least distance of any pair of one kind."""

    distance: float
    """Signed distance [m]."""

    first: str
    """Name of a body in the scene's MuJoCo model."""

    second: str
    """Name of the other body."""

    time: float
    """When [s]."""


def least_distances(states: MotionStates) -> dict[PairKind, LeastDistance]:
    """Compute the least signed distance of each kind of pair in a motion.

    Args:
        states: The motion with the poses of its bodies; distances are computed at its samples.

    Returns:
        The least distances of the kinds that occur.

    Raises:
        DvrError: The wheels with `coal` and the meshes are missing, or a shape is unknown.
    """
    return least_of_pairs(pairs_of_motion(states), states.motion.time)


def least_of_pairs(
    pairs: Iterable[Pair], time: Float[np.ndarray, " samples"]
) -> dict[PairKind, LeastDistance]:
    """Compute the least signed distance of each kind among some pairs.

    Args:
        pairs: The pairs.
        time: Times of the states [s].
    """
    least: dict[PairKind, LeastDistance] = {}
    for pair in pairs:
        known = least[pair.kind].distance if pair.kind in least else np.inf
        distance, state = _least_of_pair(pair, known)
        if distance < known:
            least[pair.kind] = LeastDistance(
                distance, pair.first.name, pair.second.name, float(time[state])
            )
    return least


def deepest_penetration(least: dict[PairKind, LeastDistance]) -> float:
    """Return the deepest penetration outside of grasps [m]; zero where nothing penetrates."""
    distances = [found.distance for kind, found in least.items() if kind not in GRASPS]
    return max(0.0, -min(distances, default=0.0))


def signed_distance(pair: Pair, state: int) -> float:
    """Return the signed distance of a pair in a state [m].

    Args:
        pair: The pair.
        state: Number of the state.
    """
    import coal

    placed = [
        coal.Transform3s(body.rotations[state], body.positions[state])
        for body in (pair.first, pair.second)
    ]
    result = coal.DistanceResult()
    coal.distance(
        pair.first.shape, placed[0], pair.second.shape, placed[1], coal.DistanceRequest(), result
    )
    return float(result.min_distance)


def _least_of_pair(pair: Pair, known: float) -> tuple[float, int]:
    """Return the least signed distance of a pair and its state, if it is less than a known one.

    Args:
        pair: The pair.
        known: Distance that is of no interest any more [m].
    """
    valid = np.flatnonzero(pair.valid)
    travel = (pair.first.travel + pair.second.travel)[valid]
    best = known
    best_state = -1
    index = 0
    while index < len(valid):
        distance = signed_distance(pair, int(valid[index]))
        if distance < best:
            best = distance
            best_state = int(valid[index])

        # The first state in which the distance can be less than the best one.
        reach = travel[index] + distance - best
        index = max(int(np.searchsorted(travel, reach, side="right")), index + 1)
    return best, best_state
