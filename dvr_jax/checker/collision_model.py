"""MuJoCo's model and data of a scene as the check uses them: made once for each scene, and written to by the check."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from urllib.parse import unquote

import mujoco
import numpy as np
from jaxtyping import Bool, Int

from dvr_jax.scene.mjcf import build_collision_model
from dvr_jax.scene.types import Scene


@dataclass(frozen=True, slots=True)
class SinglePairs:
    """Pairs of geoms whose distance is computed for the pair alone."""

    first: Int[np.ndarray, " pairs"]
    """First geom of each pair."""

    second: Int[np.ndarray, " pairs"]
    """Second geom, of a higher number."""

    table: Bool[np.ndarray, "geoms geoms"]
    """Whether two geoms are such a pair."""


@dataclass(frozen=True, slots=True)
class CollisionModel:
    """A model that the check may write to, and what follows from it."""

    model: mujoco.MjModel
    """The model; the search for contacts sets the margins of its geoms and bodies."""

    data: mujoco.MjData
    """Data of the model, in any state."""

    singles: SinglePairs
    """Pairs of geoms that the collision detection treats inexactly."""

    labels: tuple[str, ...]
    """Name of the body of each geom for findings, as in "left/hand", "object/yellow" or "fixed/wall"."""


def collision_model(scene: Scene) -> CollisionModel:
    """Return the model of a scene, which is kept; each thread has its own."""
    return _collision_model(scene, threading.get_ident())


@lru_cache(maxsize=16)
def _collision_model(scene: Scene, thread: int) -> CollisionModel:
    """Make the model of a scene for a thread."""
    return make_collision_model(build_collision_model(scene))


def make_collision_model(model: mujoco.MjModel) -> CollisionModel:
    """Prepare a model, which the check will write to."""
    labels = tuple(_geom_label(model, geom) for geom in range(model.ngeom))
    return CollisionModel(model, mujoco.MjData(model), _single_pairs(model), labels)


def solid_geoms(model: mujoco.MjModel) -> Bool[np.ndarray, " geoms"]:
    """Find the geoms that collide with others."""
    return np.asarray((model.geom_contype & model.geom_conaffinity) > 0)


def _single_pairs(model: mujoco.MjModel) -> SinglePairs:
    """Find the pairs of two boxes, or of a cylinder and anything, that are solid and not both fixed."""
    is_box = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    is_cylinder = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
    is_fixed = model.body_weldid[model.geom_bodyid] == 0
    solid = solid_geoms(model)

    by_shape = (is_box[:, None] & is_box) | is_cylinder[:, None] | is_cylinder
    may_meet = solid[:, None] & solid & ~(is_fixed[:, None] & is_fixed)
    table = by_shape & may_meet & ~np.eye(model.ngeom, dtype=bool)
    first, second = np.argwhere(np.triu(table)).T
    return SinglePairs(first, second, table)


def _geom_label(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a geom's body for findings."""
    body = int(model.geom_bodyid[geom])
    # Geoms of the world body, such as the table, are named individually.
    name = str(model.body(body).name if body else model.geom(geom).name)
    # The model encodes the names of a scene's bodies for XML.
    if name.startswith(("object/", "fixed/")):
        return unquote(name, errors="surrogatepass")
    return name
