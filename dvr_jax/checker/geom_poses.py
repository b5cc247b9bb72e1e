"""World poses of all geoms of a model in many states, and bounds of how far the geoms move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, slots=True)
class GeomPoses:
    """World poses of all geoms of a model in many states."""

    positions: Float[np.ndarray, "states geoms 3"]
    """Centers [m]."""

    rotations: Float[np.ndarray, "states geoms 3 3"]
    """Rotations."""

    def at(self, states: Int[np.ndarray, " chosen"]) -> GeomPoses:
        """Return the poses in some of the states."""
        return GeomPoses(self.positions[states], self.rotations[states])


def farthest_move(
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
    shift_length = np.sqrt(np.einsum("...i,...i->...", shift, shift))
    chord = np.sqrt(np.einsum("...ij,...ij->...", turn, turn) / 2) * radius
    return np.asarray(shift_length + chord)


def relative_poses(
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
