"""The mode of an object that stands where the scene has it: a constant pose without parameters."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import Attachment


def standing_pose(attached: Attachment) -> Float[Array, "4 *#batch"]:
    """Poses of fixed objects, which are their initial ones: x, y, z [m] and yaw [rad]."""
    return attached.initial_pose


def pose_on_host(initial_pose: Float[np.ndarray, " 4"]) -> tuple[Rotation, Float[np.ndarray, " 3"]]:
    """Rotation and position [m] of one fixed object with NumPy, from its x, y, z [m] and yaw [rad]."""
    return Rotation.from_euler("z", initial_pose[3]), initial_pose[:3]
