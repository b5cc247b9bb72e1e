"""World poses of everything in a scene, in many states, by MuJoCo's forward kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.collision_model import CollisionModel
from dvr_jax.checker.geom_poses import GeomPoses


@dataclass(frozen=True, slots=True)
class AllPoses:
    """World poses of all bodies, sites and geoms of a MuJoCo model in many states."""

    body_positions: Float[np.ndarray, "states bodies 3"]
    """Origins of the bodies [m]."""

    body_rotations: Float[np.ndarray, "states bodies 3 3"]
    """Rotations of the bodies."""

    site_positions: Float[np.ndarray, "states sites 3"]
    """Positions of the sites [m]."""

    site_rotations: Float[np.ndarray, "states sites 3 3"]
    """Rotations of the sites."""

    geoms: GeomPoses
    """Poses of the geoms."""


def all_poses(scene_model: CollisionModel, states: Float[np.ndarray, "states nq"]) -> AllPoses:
    """Compute the world poses of all bodies, sites and geoms in all states.

    Args:
        scene_model: Model of the scene; its data is overwritten.
        states: The states.

    Returns:
        The poses.
    """
    model = scene_model.model
    data = scene_model.data
    number = len(states)
    poses = AllPoses(
        body_positions=np.empty((number, model.nbody, 3)),
        body_rotations=np.empty((number, model.nbody, 3, 3)),
        site_positions=np.empty((number, model.nsite, 3)),
        site_rotations=np.empty((number, model.nsite, 3, 3)),
        geoms=GeomPoses(np.empty((number, model.ngeom, 3)), np.empty((number, model.ngeom, 3, 3))),
    )

    # MuJoCo writes the poses of every state into the same arrays, so the attributes are looked up only once.
    copies = (
        (poses.body_positions, data.xpos),
        (poses.body_rotations, data.xmat.reshape(-1, 3, 3)),
        (poses.site_positions, data.site_xpos),
        (poses.site_rotations, data.site_xmat.reshape(-1, 3, 3)),
        (poses.geoms.positions, data.geom_xpos),
        (poses.geoms.rotations, data.geom_xmat.reshape(-1, 3, 3)),
    )
    state = data.qpos
    for index, qpos in enumerate(states):
        state[:] = qpos
        mujoco.mj_kinematics(model, data)
        for kept, source in copies:
            kept[index] = source
    return poses
