"""The mode of an object that an action has placed: it stands upright on its support where the parameters say.

The mode parameters are ``m = (x, y, yaw, bottom)``: the object's center (x, y) [m] and yaw [rad] in the world, and the
height of its support above the table's top [m]. An action that places an object on a known support pins the fourth
parameter. The center's height is that of the support plus half the object's height.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Vector, vector
from dvr_jax.modes.mode import PARAMETERS, Attachment


def standing_pose(attached: Attachment) -> Float[Array, "4 *#batch"]:
    """Return the poses of placed objects: x, y, z [m] and yaw [rad]."""
    m = attached.parameters
    return jnp.stack(jnp.broadcast_arrays(m[0], m[1], m[3] + attached.half_height, m[2]))


def twists(position: Vector) -> tuple[Float[Array, "3 4 *#batch"], Float[Array, "3 4 *#batch"]]:
    """Compute the world twist of placed objects at unit rate of each mode parameter.

    The first two parameters move the object along x and y, the fourth one moves it up. The third turns it about the
    vertical axis through its center p: its angular velocity is z, and the velocity of the point at the world's origin
    is ``p x z``.

    Args:
        position: Centers of the objects (3, ...) [m].

    Returns:
        Angular velocities, and velocities of the point at the world's origin.
    """
    ones = np.ones(position.ndim - 1, dtype=int)

    def column(values: Array, parameter: int) -> Array:
        """Twist by one parameter: (3, ...) to (3, 4, ...), with zero for all other parameters."""
        # One-hot products in place of stacks keep this one kernel.
        one_hot = np.eye(PARAMETERS, dtype=position.dtype)[parameter].reshape(-1, *ones)
        return jnp.asarray(values)[:, None] * one_hot

    # Unit vectors of the world with broadcast axes.
    x, y, up = (np.eye(3, dtype=position.dtype)[axis].reshape(-1, *ones) for axis in range(3))
    zero = jnp.zeros_like(position[0])
    spin = vector(position[1], -position[0], zero)
    return column(up, 2), column(x, 0) + column(y, 1) + column(spin, 2) + column(up, 3)


def pose_on_host(
    m: Float[np.ndarray, " 4"], half_height: float
) -> tuple[Rotation, Float[np.ndarray, " 3"]]:
    """Compute the pose of one placed object with NumPy.

    Args:
        m: Mode parameters.
        half_height: Half the object's height [m].

    Returns:
        Rotation and position [m].
    """
    return Rotation.from_euler("z", m[2]), np.array([m[0], m[1], m[3] + half_height])
