"""Our problems as problems of `robotic` (rai's KOMO, the original's solver), and its solutions as our variables.

The problem in its terms, with S steps a phase and switch k at time k = 1..K:

- A grasp is a mode switch "stable" (a free relative pose, constant while it lasts), with the gripper's center in the
  object's middle plane, its closing axis along the face's normal, and our bounds.
- A place is a mode switch "stableOn" (x, y, yaw on the support: upright and at the right height by construction), with
  the footprint's corners within the support.
- At every slice the sum of all penetrations is zero and joints are within their limits.
- The arms that take part in a switch rest at it in keyframes, and all arms rest at each switch of a path.
- Costs: of keyframes the pull to home and squared differences of consecutive ones, of a path squared accelerations.

Differences from our NLP: objects and fingers are as in `dvr_jax.bench.rai_scene`; a path is free of penetrations at its
slices only, not between them, and it is not drawn to its start; an object has no acceleration just after a switch,
either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from dvr_jax.bench.rai_scene import (
    Floats,
    PeerScene,
    gripper_frame,
    load_robotic,
    object_frame,
    rotation_of,
)
from dvr_jax.logic import Action
from dvr_jax.modes.mode import ModeKind
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.operators import OPERATORS, object_of
from dvr_jax.operators.grasp import GRASP_MARGIN, PITCH_LIMIT
from dvr_jax.scene.types import SceneObject
from dvr_jax.shapes import FACES

UNTIL_THE_END = -1.0
"""Time at which a mode ends that lasts as long as the motion."""


@dataclass(frozen=True, slots=True)
class PeerSolution:
    """Result of one NLP of `robotic`."""

    feasible: bool
    """Its own verdict: sums of equality and of inequality violations, as it scales them, below 0.1 each."""
    seconds: float
    """CPU time of its solver."""
    evaluations: int
    """Evaluations of the NLP."""
    equalities: float
    """Sum of the equalities' violations, scaled."""
    inequalities: float
    """Sum of the inequalities' violations, scaled."""
    q: Floats
    """(T, joints) joint angles [rad]."""
    poses: dict[str, Floats]
    """(T, 7) positions and quaternions (w x y z) of the grippers and objects, by frame."""
    waypoints: Any
    """All degrees of freedom of each slice, as `robotic` takes them to start a path."""


def build_keyframes(peer: PeerScene, actions: Sequence[Action]) -> Any:
    """Build its keyframe problem, with the control costs of its tutorials.

    Args:
        peer: the scene in `robotic`.
        actions: the sequence.

    Returns:
        Its `KOMO`.
    """
    ry = load_robotic()
    komo = ry.KOMO(peer.config, len(actions), 1, 1, True)
    komo.addControlObjective([], 0, 1e-2)
    komo.addControlObjective([], 1, 1e-1)
    _add_constraints(ry, komo, peer, actions)
    return komo


def build_path(
    peer: PeerScene, actions: Sequence[Action], keyframes: PeerSolution, steps: int
) -> Any:
    """Build its path problem, started from its keyframes.

    Args:
        peer: the scene in `robotic`.
        actions: the sequence.
        keyframes: its solution of the keyframe problem.
        steps: slices of each phase.

    Returns:
        Its `KOMO`.
    """
    ry = load_robotic()
    komo = ry.KOMO(peer.config, len(actions), steps, 2, True)
    komo.addControlObjective([], 2, 1e-1)
    _add_constraints(ry, komo, peer, actions)

    for k in range(1, len(actions) + 1):
        for joints in peer.joints:
            komo.addObjective([k], ry.FS.qItself, list(joints), ry.OT.eq, [1e1], [], 1)

    komo.initWithWaypoints(keyframes.waypoints, 1, True)
    return komo


def _add_constraints(ry: Any, komo: Any, peer: PeerScene, actions: Sequence[Action]) -> None:
    """Add collisions, joint limits, and the mode switch of each action with its bounds."""
    komo.addObjective([], ry.FS.accumulatedCollisions, [], ry.OT.eq, [1e1])
    komo.addObjective([], ry.FS.jointLimits, [], ry.OT.ineq, [1e0])

    names = [object_of(action, OPERATORS) for action in actions]
    moved: set[str] = set()
    for k, action in enumerate(actions, start=1):
        # A mode lasts until the next action on the same object.
        name = names[k - 1]
        later = [j for j, other in enumerate(names, start=1) if j > k and other == name]
        times = [float(k), float(later[0]) if later else UNTIL_THE_END]

        n = peer.scene.object_index(name)
        gripper = gripper_frame(peer.scene.workcell.arm_index(action.arguments[0]))
        body = object_frame(n)
        is_first = name not in moved
        if action.operator == "grasp":
            komo.addModeSwitch(times, ry.SY.stable, [gripper, body], is_first)
            _add_grasp(ry, komo, peer.scene.objects[n], action.arguments[1], k, gripper, body)
        else:
            support = f"support_{action.arguments[2]}"
            komo.addModeSwitch(times, ry.SY.stableOn, [support, body], is_first)
            _add_footprint(ry, komo, peer, k, body, support)
        moved.add(name)
    komo.addQuaternionNorms()


def _add_grasp(
    ry: Any, komo: Any, item: SceneObject, face: str, k: int, gripper: str, body: str
) -> None:
    """Keep the gripper's center in the object's middle plane and its closing axis along the face's normal."""
    index = FACES.index(face)
    normal_axis = index % 2
    tangent_axis = 1 - normal_axis
    normal = np.zeros(3)
    normal[normal_axis] = 1.0 if index < 2 else -1.0

    rows = np.eye(3)
    room = np.array(item.half_extents) - GRASP_MARGIN
    within = 1e1 * rows[[tangent_axis, 2]]
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.eq, 1e1 * rows[[normal_axis]])
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.ineq, within, room)
    komo.addObjective([k], ry.FS.positionRel, [gripper, body], ry.OT.ineq, -within, -room)
    komo.addObjective([k], ry.FS.vectorYRel, [gripper, body], ry.OT.eq, [1e0], normal)
    komo.addObjective(
        [k],
        ry.FS.scalarProductZZ,
        [gripper, body],
        ry.OT.ineq,
        [1e0],
        [-math.cos(PITCH_LIMIT)],
    )


def _add_footprint(ry: Any, komo: Any, peer: PeerScene, k: int, body: str, support: str) -> None:
    """Keep the corners of an object's footprint within its support."""
    half = np.array(peer.config.getFrame(support).getSize())[:3] / 2
    within = 1e1 * np.eye(3)[:2]
    for i in range(4):
        corner = [f"{body}_corner{i}", support]
        komo.addObjective([k], ry.FS.positionRel, corner, ry.OT.ineq, within, half)
        komo.addObjective([k], ry.FS.positionRel, corner, ry.OT.ineq, -within, -half)


def solve_peer(peer: PeerScene, komo: Any, seed: int) -> PeerSolution:
    """Solve one of its problems with its default options.

    Args:
        peer: the scene in `robotic`.
        komo: the problem.
        seed: of the small noise that it adds to the start.

    Returns:
        Verdict, time and solution.
    """
    ry = load_robotic()
    ry.rnd_seed(seed)
    result = ry.NLP_Solver(komo.nlp(), verbose=0).solve()

    frames = np.asarray(komo.getPathFrames())
    names = [
        *map(gripper_frame, range(len(peer.joints))),
        *map(object_frame, range(len(peer.scene.objects))),
    ]
    return PeerSolution(
        feasible=bool(result.feasible),
        seconds=float(result.time),
        evaluations=int(result.evals),
        equalities=float(result.eq),
        inequalities=float(result.ineq),
        q=np.array(komo.getPath()),
        poses={name: frames[:, peer.config.getFrame(name).ID].copy() for name in names},
        waypoints=komo.getPath_qAll(),
    )


def to_variables(problem: Problem, actions: Sequence[Action], solved: PeerSolution) -> Variables:
    """Express its solution in our variables.

    Joint angles stay as they are. Mode parameters follow from the poses that the new mode gives the object and the
    gripper at each switch.

    Args:
        problem: our keyframe problem of the sequence.
        actions: the sequence.
        solved: its solution, of keyframes or of a path.

    Returns:
        Joint angles (T, joints) [rad] and mode parameters (K, 4).
    """
    K = len(actions)
    steps = len(solved.q) // K
    m = np.zeros((K, 4))
    for k in range(K):
        t = (k + 1) * steps - 1
        n = int(problem.switched_object[k])
        object_pose = solved.poses[object_frame(n)][t]
        if problem.mode_kind[k + 1, n] == ModeKind.HELD:
            hand_pose = solved.poses[gripper_frame(int(problem.acting_arm[k]))][t]
            m[k, :3] = _grasp_parameters(object_pose, hand_pose, float(problem.closing_yaw[k]))
        else:
            m[k, :3] = _placement_parameters(object_pose)
    return Variables(jnp.asarray(solved.q), jnp.asarray(m))


def _placement_parameters(object_pose: Floats) -> Floats:
    """Position x, y [m] and yaw [rad] of an object on its support."""
    R = rotation_of(object_pose[3:])
    yaw = math.atan2(R[1, 0], R[0, 0])
    return np.array([object_pose[0], object_pose[1], yaw])


def _grasp_parameters(object_pose: Floats, hand_pose: Floats, face_yaw: float) -> Floats:
    """Gripper center along the face's tangent and along z [m] in the object's frame, and the hand's pitch [rad]."""
    R = rotation_of(object_pose[3:])
    center = R.T @ (hand_pose[:3] - object_pose[:3])
    approach = R.T @ rotation_of(hand_pose[3:])[:, 2]
    tangent = np.array([-math.sin(face_yaw), math.cos(face_yaw), 0.0])
    pitch = math.atan2(tangent @ approach, -approach[2])
    return np.array([tangent @ center, center[2], pitch])
