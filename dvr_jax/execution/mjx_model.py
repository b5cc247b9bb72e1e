"""The execution model in MuJoCo MJX: what MJX cannot simulate is refused, and copies differ in friction alone.

MJX computes with arrays whose shapes are fixed when its program is compiled, which has two consequences:

- Every pair of geoms that may ever touch is examined in every step. For some pairs, such as a cylinder and a box, MJX
  has no function at all.
- Constraint rows are reserved for a fixed number of contacts. The model of a scene of two boxes has 563 pairs of geoms
  with 1080 possible contacts, of which some 20 are active at a time. MJX therefore keeps the deepest ones, as many as
  `contact_limit` says. MJX counts contacts with and without torsional friction (of 4 and 3 dimensions) separately;
  here all have it, so that no rows are reserved for contacts of the arms with each other, which are rare.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from typing import Any, NamedTuple
from urllib.parse import unquote

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from dvr_jax.errors import OptionError
from dvr_jax.execution.conditions import ExecutionConditions
from dvr_jax.execution.physics_model import build_execution_model, build_execution_spec
from dvr_jax.scene.types import Scene

# On import, MJX prints that an implementation of it for another library is absent. It is not used here, and standard
# output belongs to the command's results.
with redirect_stdout(io.StringIO()):
    from mujoco import mjx

SUPPORTED_GEOMS = (
    mujoco.mjtGeom.mjGEOM_PLANE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
"""Types of geoms between any two of which MJX computes contacts. A cylinder or an ellipsoid has none with a box, and
the table and the fingers are boxes."""

CONTACTS_OF_OBJECT = 4
"""Contacts that are reserved for each object: those of a box that stands."""

CONTACTS_OF_GRIPPERS = 32
"""Contacts that are reserved in addition: at a handover, four fingers touch the object with a pad and with the box
behind it, by four contacts each."""

CONTACT_DIMENSION = 4
"""Dimension of all contacts: the normal, two directions of sliding, and the turn about the normal."""


class FrictionBatch(NamedTuple):
    """Coefficients of friction of all copies of a model; everything else is the same in all copies."""

    geom: Float[Array, "copies geoms 3"]
    """Coefficients of the geoms: sliding [1], torsional [m], rolling [m]."""

    pair: Float[Array, "copies pairs 5"]
    """Coefficients of the explicit pairs of geoms: sliding [1] twice, torsional [m], rolling [m] twice."""


def contact_limit(scene: Scene) -> int:
    """Return for how many contacts a scene's model reserves constraint rows."""
    return CONTACTS_OF_OBJECT * len(scene.objects) + CONTACTS_OF_GRIPPERS


def build_mjx_model(scene: Scene, conditions: ExecutionConditions) -> mujoco.MjModel:
    """Compile the model of a scene for MJX: the execution model, with a limit on the number of contacts.

    Args:
        scene: The scene.
        conditions: Factor of the friction.

    Raises:
        OptionError: MJX cannot simulate a body of the scene or of its workcell.
    """
    spec = build_execution_spec(scene, conditions)
    for geom in spec.geoms:
        geom.condim = CONTACT_DIMENSION
    spec.add_numeric(name="max_contact_points", data=[contact_limit(scene)], size=1)
    model = spec.compile()
    _refuse_unsupported_geoms(model)
    return model


def _refuse_unsupported_geoms(model: mujoco.MjModel) -> None:
    """Refuse a model with a geom that collides and for which MJX lacks functions of contact."""
    # Geoms that only show something have bits of `contype` that no geom has in its `conaffinity`.
    types = np.bitwise_or.reduce(model.geom_contype)
    affinities = np.bitwise_or.reduce(model.geom_conaffinity)
    collides = (model.geom_contype & affinities) | (model.geom_conaffinity & types)
    in_pair = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}

    for geom in range(model.ngeom):
        kind = mujoco.mjtGeom(model.geom_type[geom])
        if (collides[geom] or geom in in_pair) and kind not in SUPPORTED_GEOMS:
            body = unquote(model.body(model.geom_bodyid[geom]).name)
            shape = kind.name.removeprefix("mjGEOM_").lower()
            raise OptionError(
                f"the backend mjx cannot simulate the {shape} {body!r}, as it has no contacts between "
                f"{shape}s and boxes; valid are boxes, or the backend mujoco."
            )


def put_on_device(model: mujoco.MjModel) -> Any:
    """Convert a MuJoCo model to one of MJX on the device of JAX.

    Args:
        model: The MuJoCo model.

    Returns:
        The model as a pytree of JAX arrays (`mujoco.mjx.Model`).

    Raises:
        OptionError: MJX lacks something that the model needs.
    """
    try:
        return mjx.put_model(model, impl="jax")
    except NotImplementedError as error:
        raise OptionError(
            f"the backend mjx cannot simulate this workcell ({error}); valid is the backend mujoco."
        ) from error


def stack_friction(scene: Scene, conditions: Sequence[ExecutionConditions]) -> FrictionBatch:
    """Return the coefficients of friction of each copy.

    Args:
        scene: The scene.
        conditions: The conditions of each copy.
    """
    # MuJoCo's own compiler computes the coefficients, so that both backends have the same.
    models = [build_execution_model(scene, each) for each in conditions]
    return FrictionBatch(
        geom=jnp.asarray(np.stack([model.geom_friction for model in models])),
        pair=jnp.asarray(np.stack([model.pair_friction for model in models])),
    )


def first_data(model: Any, states: Float[np.ndarray, "copies nq"]) -> Any:
    """Return MJX's data of all copies at rest.

    Args:
        model: The model of MJX.
        states: First state of each copy.

    Returns:
        The data as a pytree of JAX arrays (`mujoco.mjx.Data`), each with a leading axis of copies.
    """
    data = mjx.make_data(model)
    copies = len(states)
    batch = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (copies, *leaf.shape)), data)
    return batch.replace(qpos=jnp.asarray(states, batch.qpos.dtype))


def step_copies(
    model: Any, friction: FrictionBatch, data: Any, targets: Float[Array, " nu"]
) -> Any:
    """Simulate one time step of all copies.

    Args:
        model: The model of MJX.
        friction: Coefficients of friction of each copy.
        data: The data of all copies.
        targets: Targets of the servos in this step, the same for all copies [rad or m].

    Returns:
        The data after the step. Its contacts are those at the step's beginning.
    """

    def step_one(coefficients: FrictionBatch, copy: Any) -> Any:
        own_model = model.replace(geom_friction=coefficients.geom, pair_friction=coefficients.pair)
        return mjx.step(own_model, copy.replace(ctrl=targets))

    return jax.vmap(step_one)(friction, data)
