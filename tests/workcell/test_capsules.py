"""The collision capsules against what is drawn, in MuJoCo C."""

import mujoco
import numpy as np
from arm_states import Floats, Simulated, sample_postures

LOOKS_GROUP = 2
COLLISION_GROUP = 3
"""Geom groups of the robots' models: what is seen, and what collides."""

COVERED = 0.008
"""As `panda.xml` says [m] ..."""
LESS_COVERED = dict.fromkeys(("link1", "link2", "link3", "link4"), 0.018)
"""... with what it excepts; the base, which does not move, is left out here."""
FLANGE_BOX = 0.012


def surface(kind: int, size: Floats, generator: np.random.Generator) -> Floats:
    """Random points (n, 3) on a geom's surface, its edges included."""
    n = 4000
    direction = generator.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] * direction + np.array([0, 0, 1]) * size[1] * generator.uniform(
            -1, 1, (n, 1)
        )
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return size * direction / np.abs(direction).max(axis=1, keepdims=True)
    assert kind == mujoco.mjtGeom.mjGEOM_CYLINDER
    round_side = direction[:, :2] / np.linalg.norm(direction[:, :2], axis=1, keepdims=True)
    return np.column_stack([size[0] * round_side, size[1] * generator.choice([-1, 1, 0.5, 0], n)])


def in_world(data: mujoco.MjData, geom: int, points: Floats) -> Floats:
    return points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def beyond_capsules(model: mujoco.MjModel, data: mujoco.MjData, arm: str, points: Floats) -> Floats:
    """How far points (n, 3) are outside all capsules of an arm [m]."""
    nearest = np.full(len(points), np.inf)
    for geom in np.flatnonzero(model.geom_group == COLLISION_GROUP):
        name = model.body(model.geom_bodyid[geom]).name
        if not name.startswith(arm):
            continue
        radius, half = model.geom_size[geom, :2]
        low, high = in_world(data, geom, np.array([[0, 0, -half], [0, 0, half]]))
        along = np.clip((points - low) @ (high - low) / (2 * half) ** 2, 0, 1)
        nearest = np.minimum(
            nearest, np.linalg.norm(points - low - along[:, None] * (high - low), axis=1) - radius
        )
    return nearest


def test_capsules_cover_what_is_drawn() -> None:
    simulated, generator = Simulated(), np.random.default_rng(0)
    model = simulated.model
    worst: dict[str, float] = {}
    for data in simulated.states(*sample_postures(4)):
        for geom in np.flatnonzero(model.geom_group == LOOKS_GROUP):
            body = model.body(model.geom_bodyid[geom]).name
            arm, _, link = body.partition("/")
            if link in ("", "base"):
                continue
            if link == "link7" and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
                link = "flange's box"
            points = in_world(
                data, geom, surface(int(model.geom_type[geom]), model.geom_size[geom], generator)
            )
            depth = float(beyond_capsules(model, data, arm, points).max())
            worst[link] = max(worst.get(link, 0.0), depth)
    limits = dict.fromkeys(worst, COVERED) | LESS_COVERED | {"flange's box": FLANGE_BOX}
    assert len(worst) == 11
    assert {link: depth for link, depth in worst.items() if depth > limits[link]} == {}, worst
