"""Our problems as problems of `robotic` (rai's KOMO, the original's solver), and its solutions as our variables.

Its own Panda model gives the kinematics; on its links sit our collision capsules, so that both solvers see the same
arms. The problem in its terms, with S steps a phase and switch k at time k = 1..K:

- a grasp is a mode switch "stable" (a free relative pose, constant while it lasts), with the gripper's centre in the
  object's middle plane, its closing axis along the face's normal, and our bounds;
- a place is a mode switch "stableOn" (x, y, yaw on the support: upright and at the right height by construction), with
  the footprint's corners within the support;
- at every slice the sum of all penetrations is zero and joints are within their limits;
- the arms that take part in a switch rest at it, and both at the end of a path;
- costs: of keyframes the pull to home and squared differences of consecutive ones, of a path squared accelerations.

Differences from `dvr_jax.komo`: boxes have edges rounded by `ROUNDING`; fingers stay open while they hold; a path is
free of penetrations at its slices only, not between them, and not drawn to its start; an object has no acceleration
just after a switch, either."""

from __future__ import annotations

import contextlib
import importlib
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.errors import DvrError
from dvr_jax.logic import ARMS, FACES, Action, object_of
from dvr_jax.nlp.problem import HELD_LEFT, Problem, Variables
from dvr_jax.nlp.transcription import GRASP_MARGIN, PITCH_LIMIT
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.workcell.constants import ARM_NAMES, FINGER_OPEN, NUMBER_OF_JOINTS, TABLE_HALF_EXTENTS
from dvr_jax.workcell.kinematics import base_pose, load_arm

Floats = NDArray[np.float64]

ROUNDING = 0.005
"""Radius of the objects' edges [m]. The deepest penetration that `robotic` sees is the sum of both shapes' radii, and a
rounded edge lies 0.4 radii inside the sharp one. Of 73 keyframe problems that we find feasible it finds 60, 61 and 63
with 5, 10 and 15 mm; of these solutions 50, 49 and 48 are within our tolerances."""

TABLE_ROUNDING = 0.015
"""The same of the table [m], whose edges nothing reaches."""

CLEARANCE = 5e-4
"""The table's collision body lies so much below its top [m]: what stands on it must not count as a contact."""

TABLE_BODY = 0.2
"""Thickness of that body [m]."""

_LEVELS = {
    "upper_arm": -2,
    "elbow": -4,
    "forearm": -3,
    "wrist": -2,
    "flange": -1,
    "hand": -1,
    "finger_left": -1,
    "finger_right": -1,
}
"""-n: the capsule does not meet its own link's n ancestors; this leaves the pairs of `dvr_jax.nlp.collision_rows`."""


@cache
def load_robotic() -> Any:
    """The module `robotic`; a DvrError that says how to get it where it is missing."""
    try:
        # It opens a log file in the current folder as it is imported.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            return importlib.import_module("robotic")
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())
        raise DvrError(
            f"this benchmark needs the package `robotic` ({reason}): pip install '.[peers]' in the repository, "
            "and on Debian apt-get install liblapack3."
        ) from None


@dataclass(frozen=True, slots=True)
class PeerScene:
    """A scene in `robotic`."""

    scene: Scene
    config: Any
    """Its `Config`."""
    joints: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the left arm's and the right arm's joints."""


@dataclass(frozen=True, slots=True)
class PeerSolution:
    """Result of one NLP of `robotic`."""

    feasible: bool
    """Its own verdict: sums of equality and of inequality violations, as it scales them, below 0.1 each."""
    seconds: float
    """CPU time of its solver."""
    evaluations: int
    equalities: float
    """Sum of the equalities' violations, scaled."""
    inequalities: float
    q: Floats
    """(T, 14) joint angles [rad]."""
    poses: dict[str, Floats]
    """(T, 7) positions and quaternions (w x y z) of the grippers and objects, by frame."""
    waypoints: Any
    """All degrees of freedom of each slice, as `robotic` takes them to start a path."""


def object_frame(n: int) -> str:
    """Name of the n-th object's frame."""
    return f"object{n}"


def gripper_frame(arm: int) -> str:
    """Name of an arm's gripper frame, axes and origin as in our own model."""
    return f"{ARM_NAMES[arm]}_gripper"


def build_peer_scene(scene: Scene) -> PeerScene:
    """Load the robots and put the scene's table, objects and home posture beside them."""
    if any(item.shape != "box" for item in scene.objects):
        raise DvrError("scenes with cylinders are not translated to `robotic`; valid are boxes.")
    ry = load_robotic()
    config = ry.Config()
    half_x, half_y = TABLE_HALF_EXTENTS
    table = config.addFrame("table")
    table.setPosition([0.0, 0.0, -CLEARANCE - TABLE_BODY / 2])
    table.setShape(ry.ST.ssBox, [2 * half_x, 2 * half_y, TABLE_BODY, TABLE_ROUNDING]).setContact(1)
    joints = (_add_arm(ry, config, 0), _add_arm(ry, config, 1))
    _add_support(ry, config, "support_table", (0.0, 0.0, 0.0), (2 * half_x, 2 * half_y))
    region = scene.goal.region
    _add_support(ry, config, "support_goal", (*region.position, region.yaw), region.size)
    for n, item in enumerate(scene.objects):
        _add_object(ry, config, n, item)
    config.setJointState(np.array(scene.home, dtype=float).reshape(-1))
    return PeerScene(scene, config, joints)


def _quaternion(R: Floats) -> Floats:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).reshape(-1))
    return quaternion


def _matrix(quaternion: Floats) -> Floats:
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.asarray(quaternion, float) / np.linalg.norm(quaternion))
    return R.reshape(3, 3)


def _yaw_quaternion(yaw: float) -> list[float]:
    return [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]


def _add_arm(ry: Any, config: Any, a: int) -> tuple[str, ...]:
    """A Panda with our capsules; names of its joints."""
    prefix = f"{ARM_NAMES[a]}_"
    config.addFile(ry.raiPath("panda/panda_arm_hand_conv.yml"), prefix)
    for frame in [f for f in config.getFrames() if f.name.startswith(prefix)][::-1]:
        if "finger" in frame.name:  # our capsules stand for them
            config.delFrame(frame)
        elif frame.getShapeType() == ry.ST.mesh:  # a look only, but one that every slice would copy
            frame.setShape(ry.ST.marker, [0.01])
    base = config.getFrame(f"{prefix}panda_link0")
    R, p = base_pose(a)
    # With the table as its parent the column does not meet it.
    base.setParent(config.getFrame("table"))
    base.setPose([*p, *_quaternion(R)])
    links = [f"{prefix}panda_link0", *(f"{prefix}panda_joint{i + 1}" for i in range(NUMBER_OF_JOINTS))]
    arm = load_arm()
    for name, link, start, end, radius, slide in zip(
        arm.capsule_names, arm.capsule_links, *arm.capsule_ends, arm.capsule_radii, arm.capsule_finger_directions,
        strict=True,
    ):  # fmt: skip
        offset = slide * FINGER_OPEN
        capsule = config.addFrame(prefix + name, links[link])
        capsule.setRelativePose([*((start + end) / 2 + offset), *_along(end - start)])
        capsule.setShape(ry.ST.capsule, [float(np.linalg.norm(end - start)), float(radius)])
        capsule.setContact(_LEVELS.get(name, 1))
    gripper = config.addFrame(gripper_frame(a), links[-1])
    gripper.setRelativePose([*arm.gripper_center, *_quaternion(arm.hand_rotation)])
    return tuple(links[1:])


def _along(direction: Floats) -> Floats:
    """A quaternion that turns z along a direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return _quaternion(np.stack([x, np.cross(z, x), z], axis=1))


def _add_support(ry: Any, config: Any, name: str, pose: tuple[float, float, float], size: tuple[float, float]) -> None:
    """A rectangle on the table's top that objects are placed on and nothing collides with."""
    support = config.addFrame(name)
    thickness = 0.02
    support.setPose([pose[0], pose[1], -thickness / 2, *_yaw_quaternion(pose[2])])
    support.setShape(ry.ST.ssBox, [*size, thickness, 0.001]).setContact(0)


def _add_object(ry: Any, config: Any, n: int, item: SceneObject) -> None:
    body = config.addFrame(object_frame(n))
    body.setPose([*item.center, *_yaw_quaternion(item.yaw)])
    body.setShape(ry.ST.ssBox, [*item.size, min(ROUNDING, 0.45 * min(item.size))]).setContact(1)
    hx, hy, _ = item.half_extents
    for i, (x, y) in enumerate(((hx, hy), (hx, -hy), (-hx, -hy), (-hx, hy))):
        corner = config.addFrame(f"{object_frame(n)}_corner{i}", object_frame(n))
        corner.setRelativePosition([x, y, 0.0])


def build_keyframes(peer: PeerScene, actions: Sequence[Action]) -> Any:
    """Its keyframe problem, with the control costs of its tutorials."""
    ry = load_robotic()
    komo = ry.KOMO(peer.config, len(actions), 1, 1, True)
    komo.addControlObjective([], 0, 1e-2)
    komo.addControlObjective([], 1, 1e-1)
    _add_constraints(ry, komo, peer, actions)
    return komo


def build_path(peer: PeerScene, actions: Sequence[Action], keyframes: PeerSolution, steps: int) -> Any:
    """Its path problem, started from its keyframes."""
    ry = load_robotic()
    komo = ry.KOMO(peer.config, len(actions), steps, 2, True)
    komo.addControlObjective([], 2, 1e-1)
    _add_constraints(ry, komo, peer, actions)
    for k, (action, giver) in enumerate(zip(actions, _givers(actions), strict=True), start=1):
        taking_part = {ARMS.index(action.arguments[0]), *([] if giver is None else [giver])}
        for arm in taking_part if k < len(actions) else range(len(ARMS)):
            komo.addObjective([k], ry.FS.qItself, list(peer.joints[arm]), ry.OT.eq, [1e1], [], 1)
    komo.initWithWaypoints(keyframes.waypoints, 1, True)
    return komo


def _givers(actions: Sequence[Action]) -> list[int | None]:
    """The arm that each action takes its object from, or None where it stands on a support."""
    holders: dict[str, int | None] = {}
    givers = []
    for action in actions:
        arm, name = ARMS.index(action.arguments[0]), object_of(action)
        givers.append(holders.get(name))
        holders[name] = arm if action.operator == "grasp" else None
    return givers


def _add_constraints(ry: Any, komo: Any, peer: PeerScene, actions: Sequence[Action]) -> None:
    komo.addObjective([], ry.FS.accumulatedCollisions, [], ry.OT.eq, [1e1])
    komo.addObjective([], ry.FS.jointLimits, [], ry.OT.ineq, [1e0])
    moved: set[str] = set()
    for k, action in enumerate(actions, start=1):
        name = object_of(action)
        n = peer.scene.object_index(name)
        ends = [j for j, other in enumerate(actions, start=1) if j > k and object_of(other) == name]
        times = [float(k), float(ends[0]) if ends else -1.0]
        gripper, body = gripper_frame(ARMS.index(action.arguments[0])), object_frame(n)
        if action.operator == "grasp":
            komo.addModeSwitch(times, ry.SY.stable, [gripper, body], name not in moved)
            _add_grasp(ry, komo, peer.scene.objects[n], action.arguments[1], k, gripper, body)
        else:
            support = f"support_{action.arguments[2]}"
            komo.addModeSwitch(times, ry.SY.stableOn, [support, body], name not in moved)
            _add_footprint(ry, komo, peer, k, body, support)
        moved.add(name)
    komo.addQuaternionNorms()


def _add_grasp(ry: Any, komo: Any, item: SceneObject, face: str, k: int, gripper: str, body: str) -> None:
    index = FACES.index(face)
    normal_axis, tangent_axis = index % 2, 1 - index % 2
    normal = np.zeros(3)
    normal[normal_axis] = 1.0 if index < 2 else -1.0
    rows = np.eye(3)
    room = np.array(item.half_extents) - GRASP_MARGIN
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.eq, 1e1 * rows[[normal_axis]])
    within = 1e1 * rows[[tangent_axis, 2]]
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.ineq, within, room)
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.ineq, -within, -room)
    komo.addObjective([k], ry.FS.vectorYRel, [gripper, body], ry.OT.eq, [1e0], normal)
    komo.addObjective([k], ry.FS.scalarProductZZ, [gripper, body], ry.OT.ineq, [1e0], [-math.cos(PITCH_LIMIT)])


def _add_footprint(ry: Any, komo: Any, peer: PeerScene, k: int, body: str, support: str) -> None:
    half = np.array(peer.config.getFrame(support).getSize())[:3] / 2
    within = 1e1 * np.eye(3)[:2]
    for i in range(4):
        corner = [f"{body}_corner{i}", support]
        komo.addObjective([k], ry.FS.positionRel, corner, ry.OT.ineq, within, half)
        komo.addObjective([k], ry.FS.positionRel, corner, ry.OT.ineq, -within, -half)


def solve_peer(peer: PeerScene, komo: Any, seed: int) -> PeerSolution:
    """Solve one of its problems with its default options; the start has its own small noise, of this seed."""
    ry = load_robotic()
    ry.rnd_seed(seed)
    ret = ry.NLP_Solver(komo.nlp(), verbose=0).solve()
    frames = np.asarray(komo.getPathFrames())
    names = [*map(gripper_frame, range(2)), *map(object_frame, range(len(peer.scene.objects)))]
    return PeerSolution(
        feasible=bool(ret.feasible),
        seconds=float(ret.time),
        evaluations=int(ret.evals),
        equalities=float(ret.eq),
        inequalities=float(ret.ineq),
        q=np.array(komo.getPath()),
        poses={name: frames[:, peer.config.getFrame(name).ID].copy() for name in names},
        waypoints=komo.getPath_qAll(),
    )


def to_variables(problem: Problem, actions: Sequence[Action], solved: PeerSolution) -> Variables:
    """Its solution as our variables: joint angles as they are, mode parameters from the poses that the new mode gives
    the object and the gripper at each switch."""
    K = len(actions)
    S = len(solved.q) // K
    m = np.zeros((K, 4))
    for k in range(K):
        t, n = (k + 1) * S - 1, int(problem.switched_object[k])
        pose = solved.poses[object_frame(n)][t]
        R, p = _matrix(pose[3:]), pose[:3]
        if problem.is_grasp[k] <= 0:
            m[k, :3] = p[0], p[1], math.atan2(R[1, 0], R[0, 0])
            continue
        hand = solved.poses[gripper_frame(int(problem.attachment[k + 1, n]) - HELD_LEFT)][t]
        centre, approach = R.T @ (hand[:3] - p), R.T @ _matrix(hand[3:])[:, 2]
        c, s = math.cos(problem.face_yaw[k]), math.sin(problem.face_yaw[k])
        tangent = np.array([-s, c, 0.0])
        m[k, :3] = tangent @ centre, centre[2], math.atan2(tangent @ approach, -approach[2])
    return Variables(jnp.asarray(solved.q), jnp.asarray(m))
