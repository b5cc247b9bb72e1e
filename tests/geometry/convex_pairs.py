"""Random pairs of convex bodies, and their distances by MuJoCo and by direct minimization."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

MAXIMUM_DISTANCE = 10.0


@dataclass(frozen=True)
class Bodies:
    """n bodies of one kind: "capsule", "box" or "cylinder"; axes along the body's z."""

    kind: str
    rotation: Floats
    """(n, 3, 3)."""
    center: Floats
    """(n, 3)."""
    size: Floats
    """(n, 3) MuJoCo's sizes: radius and half length, half extents, or radius and half height."""

    def __getitem__(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> "Bodies":
        return Bodies(self.kind, self.rotation[index], self.center[index], self.size[index])

    @property
    def ends(self) -> tuple[Floats, Floats]:
        """Ends (n, 3) of the capsules' segments."""
        axis = self.rotation[:, :, 2] * self.size[:, 1:2]
        return self.center - axis, self.center + axis

    def as_arguments(self) -> tuple[object, ...]:
        """Arguments for the distance functions of `dvr_jax.geometry`."""
        if self.kind == "capsule":
            start, end = self.ends
            return components(start), components(end), self.size[:, 0]
        zero = np.zeros(len(self.size))
        of_box = (*self.size.T, zero)
        of_cylinder = (zero, zero, self.size[:, 1], self.size[:, 0])
        prism = np.stack(of_box if self.kind == "box" else of_cylinder)
        return columns(self.rotation), components(self.center), prism

    def moved(self, twist: Floats, amount: float) -> "Bodies":
        """All bodies after a motion by ``amount`` along a twist (angular velocity, velocity at the world's origin)."""
        turn = Rotation.from_rotvec(amount * twist[:3]).as_matrix()
        return replace(
            self, rotation=turn @ self.rotation, center=self.center @ turn.T + amount * twist[3:]
        )


def components(v: Floats) -> Floats:
    """Move the component axis to the front: (..., 3) to (3, ...)."""
    return np.moveaxis(v, -1, 0)


def columns(R: Floats) -> Floats:
    """Move the matrix axes to the front, columns first: (..., 3, 3) to (3, 3, ...)."""
    return np.moveaxis(R, (-1, -2), (0, 1))


def sample_bodies(
    kind: str, n: int, seed: int, spread: float = 0.12, upright: bool = False
) -> Bodies:
    """Bodies of the sizes that scenes have, around the origin: some apart, some deep in each other."""
    generator = np.random.default_rng([seed, len(kind)])
    size = generator.uniform(0.02, 0.15, (n, 3))
    if kind == "capsule":
        size = np.stack(
            [generator.uniform(0.01, 0.06, n), generator.uniform(0.01, 0.2, n), np.zeros(n)], axis=1
        )
    elif kind == "cylinder":
        size[:, 2] = 0
    rotation = Rotation.random(n, random_state=generator).as_matrix()
    if upright:
        rotation = Rotation.from_euler("z", generator.uniform(-3, 3, (n, 1))).as_matrix()
    return Bodies(kind, rotation, generator.normal(size=(n, 3)) * spread, size)


GEOM = {
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
}


def mujoco_distances(first: Bodies, second: Bodies | None) -> tuple[Floats, Floats]:
    """``mj_geomDistance`` (n,) of each pair, and the unit normals (n, 3) from the second body to the first.

    Where there is no second, it is the plane z = 0.
    """
    spec = mujoco.MjSpec()
    # The defaults (1e-6 m, 35 iterations) are looser than what is tested here.
    spec.option.ccd_tolerance = 1e-12
    spec.option.ccd_iterations = 500
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    sides = [first] if second is None else [first, second]
    for bodies in sides:
        for R, p, size in zip(bodies.rotation, bodies.center, bodies.size, strict=True):
            quaternion = Rotation.from_matrix(R).as_quat(scalar_first=True)
            spec.worldbody.add_body(pos=p, quat=quaternion).add_geom(
                type=GEOM[bodies.kind], size=size
            )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    n = len(first.size)
    witness = np.zeros((n, 6))
    distance = np.array(
        [
            mujoco.mj_geomDistance(
                model, data, 1 + i, 0 if second is None else 1 + n + i, MAXIMUM_DISTANCE, witness[i]
            )
            for i in range(n)
        ]
    )
    assert (np.abs(distance) < 1).all()
    normal = (witness[:, :3] - witness[:, 3:]) * np.sign(distance)[:, None]
    return distance, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def point_distance(x: Floats, kind: str, size: Floats) -> Floats:
    """Signed distance of points (m, 3) in a body's own frame, by cases."""
    if kind == "box":
        excess = np.abs(x) - size
    else:
        excess = np.stack([np.hypot(x[:, 0], x[:, 1]) - size[0], np.abs(x[:, 2]) - size[1]], axis=1)
    return np.where(
        (excess > 0).any(1), np.linalg.norm(np.maximum(excess, 0), axis=1), excess.max(1)
    )


def deepest_of_axis(capsules: Bodies, prisms: Bodies, samples: int = 801) -> Floats:
    """Least signed distance (n,) of each capsule's segment to its prism: sampled, then minimized between neighbors."""
    start, end = capsules.ends
    best = np.zeros(len(start))
    for i, (a, b, R, p, size) in enumerate(
        zip(start, end, prisms.rotation, prisms.center, prisms.size, strict=True)
    ):
        a = (a - p) @ R
        b = (b - p) @ R

        def at(t: Floats | float, a: Floats = a, b: Floats = b, size: Floats = size) -> Floats:
            return point_distance(a + np.multiply.outer(np.atleast_1d(t), b - a), prisms.kind, size)

        t = np.linspace(0, 1, samples)
        values = at(t)
        k = int(values.argmin())
        bounds = (t[max(k - 1, 0)], t[min(k + 1, samples - 1)])
        found = minimize_scalar(
            lambda t: at(t)[0], bounds=bounds, method="bounded", options={"xatol": 1e-12}
        )
        best[i] = min(values[k], found.fun)
    return best
