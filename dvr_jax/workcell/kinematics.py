"""Forward kinematics of both arms, their joint screws, and their collision capsules.

Notation: arm 0 is "left", arm 1 "right"; joints are 0..6; link frame i (1..7) moves with joints 0..i-1, link 0 is the
base. Poses (`dvr_jax.geometry.vectors`) have batch axes ``(2, L)``: arm, then slices. All constants are read from the
compiled MuJoCo model of the package's own ``panda.xml``, so model and optimiser cannot drift apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import jax.numpy as jnp
import mujoco
import numpy as np
from jax import Array

from dvr_jax.geometry.vectors import Rotation, Vector, compose, cross, materialize, rotate
from dvr_jax.workcell.constants import BASE_POSITIONS, BASE_YAWS, NUMBER_OF_JOINTS


@dataclass(frozen=True, slots=True)
class Arm:
    """Constants of one Panda arm in its base frame (NumPy, so that they fold into compiled code)."""

    rotations: np.ndarray
    """(7, 3, 3) rotation of link frame i+1 in link frame i at joint angle zero; each joint turns about its own z."""
    offsets: np.ndarray
    """(7, 3) origin of link frame i+1 in link frame i [m]."""
    hand_rotation: np.ndarray
    """(3, 3) rotation of the hand frame in link frame 7."""
    gripper_center: np.ndarray
    """(3,) point between the finger tips, in link frame 7 [m]."""
    joint_limits: np.ndarray
    """(2, 7) lower and upper limit [rad]."""
    capsule_names: tuple[str, ...]
    """Names of the collision capsules, from the column to the finger tips."""
    capsule_links: np.ndarray
    """(C,) link frame that each capsule moves with."""
    capsule_ends: np.ndarray
    """(2, C, 3) ends of the capsules' segments in their link frames, fingers closed [m]."""
    capsule_radii: np.ndarray
    """(C,) radii [m]."""
    capsule_finger_directions: np.ndarray
    """(C, 3) direction in the link frame in which a finger's capsule moves as the gripper opens, zero for all
    others."""

    @property
    def number_of_capsules(self) -> int:
        """Number C of collision capsules of one arm."""
        return len(self.capsule_names)


def _rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    # Right angles come out of the compiler as 1e-17: exact zeros let the tracer drop whole products.
    matrix[np.abs(matrix) < 1e-12] = 0
    return matrix.reshape(3, 3)


@lru_cache(maxsize=1)
def load_arm() -> Arm:
    """Read the arm's constants from the compiled model of ``panda.xml``."""
    model = mujoco.MjModel.from_xml_string((files("dvr_jax.workcell.panda") / "panda.xml").read_text(encoding="utf-8"))

    def body(name: str) -> int:
        return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name))

    links = [body("base"), *(body(f"link{i}") for i in range(1, 8))]
    rotations = np.stack([_rotation_matrix(model.body_quat[b]) for b in links[1:]])
    offsets = np.stack([model.body_pos[b] for b in links[1:]])
    limits = np.stack([model.jnt_range[model.body_jntadr[b]] for b in links[1:]], axis=1)

    def pose_in_link(body_id: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Link index, rotation and position of a body that is welded (or slides) to that link."""
        R, p = np.eye(3), np.zeros(3)
        while body_id not in links:
            Q = _rotation_matrix(model.body_quat[body_id])
            R, p = Q @ R, Q @ p + model.body_pos[body_id]
            body_id = int(model.body_parentid[body_id])
        return links.index(body_id), R, p

    _, hand_rotation, hand_position = pose_in_link(body("hand"))
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "gripper")
    gripper_center = hand_position + hand_rotation @ model.site_pos[site]

    names, capsule_links, ends, radii, directions = [], [], [], [], []
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if not name.endswith("_collision"):
            continue
        assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE, name
        geom_body = int(model.geom_bodyid[geom])
        link, R, p = pose_in_link(geom_body)
        center = R @ model.geom_pos[geom] + p
        axis = R @ _rotation_matrix(model.geom_quat[geom])[:, 2] * model.geom_size[geom, 1]
        names.append(name.removesuffix("_collision"))
        capsule_links.append(link)
        ends.append([center - axis, center + axis])
        radii.append(model.geom_size[geom, 0])
        joint = int(model.body_jntadr[geom_body])
        slides = joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        directions.append(R @ model.jnt_axis[joint] if slides else np.zeros(3))
    return Arm(
        rotations=rotations,
        offsets=offsets,
        hand_rotation=hand_rotation,
        gripper_center=gripper_center,
        joint_limits=limits,
        capsule_names=tuple(names),
        capsule_links=np.array(capsule_links),
        capsule_ends=np.array(ends).transpose(1, 0, 2),
        capsule_radii=np.array(radii),
        capsule_finger_directions=np.array(directions),
    )


def base_pose(arm: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and position (3,) of an arm's base in the world."""
    c, s = np.cos(BASE_YAWS[arm]), np.sin(BASE_YAWS[arm])
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    R[np.abs(R) < 1e-12] = 0
    return R, np.array([*BASE_POSITIONS[arm], 0.0])


def link_poses(q: Array) -> tuple[list[Rotation], list[Vector]]:
    """World poses of all link frames 0..7 of both arms: rotations ``(3, 3, 2, L)``, positions ``(3, 2, L)``.

    Args:
        q: (7, 2, L) angles of joint i of arm a [rad].
    """
    arm = load_arm()
    bases = [base_pose(a) for a in range(2)]
    R = jnp.asarray(np.stack([b[0].T for b in bases], axis=-1), q.dtype)[..., None]
    R = jnp.broadcast_to(R, (3, 3, *q.shape[1:]))
    p = jnp.broadcast_to(jnp.asarray(np.stack([b[1] for b in bases], axis=-1), q.dtype)[..., None], (3, *q.shape[1:]))
    rotations, positions = [R], [p]
    turns = materialize(_joint_rotations(q))
    for i in range(NUMBER_OF_JOINTS):
        R, p = materialize((compose(R, turns[i]), p + _rotate_constant(R, arm.offsets[i])))
        rotations.append(R)
        positions.append(p)
    return rotations, positions


def _joint_rotations(q: Array) -> Array:
    """Rotation of link frame i+1 in link frame i, ``(7, 3, 3, 2, L)``: the constant one, then a turn about z."""
    x, y, z = (load_arm().rotations[:, :, j] for j in range(3))
    zero = np.zeros_like(x)

    def constant(columns: list[np.ndarray]) -> Array:
        return jnp.asarray(np.stack(columns, axis=1)[..., None, None], q.dtype)

    cosine, sine = (materialize(f(q))[:, None, None] for f in (jnp.cos, jnp.sin))
    return constant([x, y, zero]) * cosine + constant([y, -x, zero]) * sine + constant([zero, zero, z])


def _rotate_constant(R: Rotation, v: np.ndarray) -> Vector:
    """``R v`` for a constant vector, leaving out its zeros while tracing."""
    terms = [float(v[j]) * R[j] for j in range(3) if v[j] != 0]
    return sum(terms[1:], terms[0]) if terms else jnp.zeros_like(R[0])


def joint_screws(rotations: list[Rotation], positions: list[Vector]) -> Array:
    """World twist of each joint at unit speed, ``(6, 2, 7, L)``: axis, then velocity of the point at the world's
    origin."""
    axis = materialize(jnp.stack([R[2] for R in rotations[1:]], axis=2))
    origin = materialize(jnp.stack(positions[1:], axis=2))
    return jnp.concatenate([axis, cross(origin, axis)])


def hand_pose(rotations: list[Rotation], positions: list[Vector]) -> tuple[Rotation, Vector]:
    """World poses of the gripper frames ``(3, 3, 2, L), (3, 2, L)``: hand axes (y closes, z approaches), origin
    between the finger tips."""
    arm = load_arm()
    R, p = rotations[7], positions[7]
    axes = [_rotate_constant(R, arm.hand_rotation[:, j]) for j in range(3)]
    return jnp.stack(axes), p + _rotate_constant(R, arm.gripper_center)


def capsule_segments(rotations: list[Rotation], positions: list[Vector], openings: Array) -> tuple[Vector, Vector]:
    """World ends of all collision capsules of both arms: start and end of each segment, ``(3, 2, C, L)``.

    Args:
        openings: (2, L) distance of each finger from the hand's middle plane [m].
    """
    arm = load_arm()
    links = arm.capsule_links
    dtype = openings.dtype
    R = materialize(jnp.stack([rotations[link] for link in links], axis=3))
    p = materialize(jnp.stack([positions[link] for link in links], axis=2))

    def constant(v: np.ndarray) -> Array:
        """(C, 3) to (3, 1, C, 1)."""
        return jnp.asarray(v.T[:, None, :, None], dtype)

    slide = constant(arm.capsule_finger_directions) * openings[:, None]
    return tuple(p + rotate(R, constant(end) + slide) for end in arm.capsule_ends)  # type: ignore[return-value]
