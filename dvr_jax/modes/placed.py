"""The mode of an object that an action has placed: upright on the table, wherever the parameters say.

Parameters: ``m = (x, y, yaw, -)``, the object's center [m] and yaw [rad] in the world; the fourth is pinned to zero. The
center's height is half the object's height.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Vector, vector
from dvr_jax.modes.mode import PARAMETERS, Attachment


def standing_pose(attached: Attachment) -> Float[Array, "4 *batch"]:
    """The pose: x, y, z [m] and yaw [rad]."""
    m = attached.parameters
    return jnp.stack(jnp.broadcast_arrays(m[0], m[1], attached.half_height, m[2]))


def twists(position: Vector) -> tuple[Float[Array, "3 4 *#batch"], Float[Array, "3 4 *#batch"]]:
    """Twists by the parameters: unit velocities along x and y, and a turn about the vertical axis through the center.

    Args:
        position: Centers of the objects (3, ...) [m].

    Returns:
        Angular velocities, and velocities of the point at the world's origin.
    """
    ones = np.ones(position.ndim - 1, dtype=int)

    def column(values: Array | np.ndarray, parameter: int) -> Array:
        """(3, ...) as the column of one parameter, (3, 4, ...), zero in all others."""
        # One-hot products in place of stacks keep this one kernel.
        one_hot = np.eye(PARAMETERS, dtype=position.dtype)[parameter].reshape(-1, *ones)
        return jnp.asarray(values)[:, None] * one_hot

    x, y, up = (np.eye(3, dtype=position.dtype)[axis].reshape(-1, *ones) for axis in range(3))
    zero = jnp.zeros_like(position[0])
    spin = vector(position[1], -position[0], zero)
    return column(up, 2), column(x, 0) + column(y, 1) + column(spin, 2)


def pose_on_host(m: Float[np.ndarray, " 4"], half_height: float) -> tuple[Rotation, Float[np.ndarray, " 3"]]:
    """The pose of one object with NumPy.

    Args:
        m: Mode parameters.
        half_height: Half the object's height [m].

    Returns:
        Rotation and position [m].
    """
    return Rotation.from_euler("z", m[2]), np.array([m[0], m[1], half_height])
