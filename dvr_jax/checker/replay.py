"""The independent check of a plan replays every sample of its motion in MuJoCo C and compares it with the actions.

The actions determine which object is attached to what, from which switch to which (`Timeline`). Everything else is
computed by MuJoCo's own kinematics and collision detection; neither the kinematics nor the distances of the optimizer
are used.

Any two bodies may penetrate each other by at most `DEEPEST_CONTACT`, and a hand and an object that it grasps by at most
`DEEPEST_GRIP`. If two bodies might meet between two samples, the check also examines states in between
(`dvr_jax.checker.motion_contacts`).

The check is kinematic: it computes no forces and no friction. A closed gripper is assumed to carry its object.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import unquote

import mujoco
import numpy as np
from jaxtyping import Float

from dvr_jax.checker.dense_states import dense_states
from dvr_jax.checker.goals import check_goal
from dvr_jax.checker.joints import (
    check_fingers,
    check_joints,
    check_rest_at_switches,
)
from dvr_jax.checker.kinds import PENETRATION
from dvr_jax.checker.motion_contacts import GeomPoses, find_contacts
from dvr_jax.checker.objects import (
    check_attachment,
    check_start_and_speed,
    check_switch,
)
from dvr_jax.checker.operators import CHECKS, OperatorCheck
from dvr_jax.checker.operators.operator import Timeline
from dvr_jax.checker.replayed_motion import ReplayedMotion
from dvr_jax.checker.report import CheckReport, FindingLog
from dvr_jax.checker.timeline import attachment_timeline
from dvr_jax.checker.tolerances import DEEPEST_CONTACT, DEEPEST_GRIP, QUATERNION_TOLERANCE
from dvr_jax.errors import MotionError
from dvr_jax.logic import Action
from dvr_jax.motion.motion import Motion, validate_motion
from dvr_jax.scene.mjcf import build_model, object_body_name, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import FINGERS

__all__ = ["DEEPEST_CONTACT", "check_motion"]


def check_motion(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    operators: Sequence[OperatorCheck] = CHECKS,
) -> CheckReport:
    """Check a motion that claims to carry out actions from a scene's initial state to its goal.

    Args:
        scene: The scene.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        operators: The check's operators; every action has to be of one of them.

    Returns:
        The verdict with all findings.

    Raises:
        MotionError: The motion's arrays do not fit the scene, or an action does not apply.
        SceneError: The check does not know a shape or the goal of the scene.
    """
    validate_fit(scene, actions, motion)
    timeline = attachment_timeline(scene, actions, motion, operators)
    log = FindingLog(motion.time)
    replayed, deepest = _replay(scene, motion, timeline, log)

    # What is required of every motion.
    check_joints(replayed, log)
    check_fingers(replayed, log)
    check_rest_at_switches(replayed, timeline, log)
    check_start_and_speed(replayed, log)

    # What the attachments and the actions require.
    for interval in timeline.intervals:
        check_switch(replayed, interval, log)
        check_attachment(replayed, interval, log)
        interval.operator.check(replayed, timeline, interval, log)

    check_goal(scene.goal, replayed, timeline, log)

    findings = log.findings()
    return CheckReport(
        passed=not findings,
        findings=findings,
        deepest_penetration=deepest,
        samples=len(motion.time),
        duration=float(motion.time[-1] - motion.time[0]),
    )


def validate_fit(scene: Scene, actions: Sequence[Action], motion: Motion) -> None:
    """Refuse a motion whose arrays do not fit the scene and the actions.

    Args:
        scene: The scene that the motion starts in.
        actions: The actions, one for each switch of the motion.
        motion: The motion.

    Raises:
        MotionError: The arrays do not fit.
    """
    validate_motion(motion)

    layout = qpos_layout(scene)
    size = motion.qpos.shape[1]
    if size != layout.size:
        raise MotionError(
            f"the motion's states have {size} numbers; valid are {layout.size} for {len(scene.objects)} objects."
        )

    if len(motion.switch) != len(actions):
        raise MotionError(
            f"the motion has {len(motion.switch)} switches; valid are {len(actions)}, one an action."
        )

    lengths = np.linalg.norm(motion.qpos[:, layout.objects[:, 3:]], axis=-1)
    deviations = np.abs(lengths - 1)
    if deviations.max() > QUATERNION_TOLERANCE:
        worst = lengths.flat[deviations.argmax()]
        raise MotionError(f"the motion has a quaternion of length {worst:g}; valid is 1.")


def _replay(
    scene: Scene, motion: Motion, timeline: Timeline, log: FindingLog
) -> tuple[ReplayedMotion, float]:
    """Compute all poses of a motion and log penetrations.

    Args:
        scene: The scene that the motion starts in.
        motion: The motion.
        timeline: Its intervals.
        log: Takes the findings.

    Returns:
        The poses, and the deepest penetration [m].
    """
    # The search for contacts changes the model's margins, so it needs its own copy of the shared model.
    model = copy.copy(build_model(scene))
    states, sample = dense_states(model, motion)
    poses = _all_poses(model, states)

    # Contacts of all states, including those between the samples; a finding names the sample that a state leads to.
    contacts = find_contacts(model, states, GeomPoses(poses.geom_positions, poses.geom_rotations))
    labels = [_geom_label(model, geom) for geom in range(model.ngeom)]
    grips = _grips(scene, timeline)
    for contact in np.flatnonzero(contacts.distance < -DEEPEST_CONTACT):
        first, second = contacts.geoms[contact]
        names = tuple(sorted((labels[first], labels[second])))
        depth = -float(contacts.distance[contact])
        deepest = DEEPEST_GRIP if names in grips else DEEPEST_CONTACT
        if depth <= deepest:
            continue
        log.add(
            PENETRATION,
            int(sample[contacts.state[contact]]),
            names,
            depth,
            deepest,
        )

    # Of the states that lead to a sample, the last one is the sample itself. The other checks examine only samples.
    is_sample = np.append(np.diff(sample) > 0, True)
    bodies = [model.body(object_body_name(item.name)).id for item in scene.objects]
    sites = [model.site(f"{arm}/gripper").id for arm in scene.workcell.arm_names]
    replayed = ReplayedMotion(
        scene=scene,
        motion=motion,
        object_positions=poses.body_positions[is_sample][:, bodies],
        object_rotations=poses.body_rotations[is_sample][:, bodies],
        gripper_positions=poses.site_positions[is_sample][:, sites],
        gripper_rotations=poses.site_rotations[is_sample][:, sites],
    )
    return replayed, max(0.0, -float(contacts.distance.min(initial=0.0)))


def _grips(scene: Scene, timeline: Timeline) -> frozenset[tuple[str, ...]]:
    """Return the labels of the bodies of a hand together with those of each object that it grasps in the plan."""
    grips = set()
    for interval in timeline.intervals:
        if interval.holder is None:
            continue
        arm = scene.workcell.arm_names[interval.holder]
        item = f"object/{scene.objects[interval.object].name}"
        grips |= {tuple(sorted((f"{arm}/{body}", item))) for body in ("hand", *FINGERS)}
    return frozenset(grips)


@dataclass(frozen=True, slots=True)
class _Poses:
    """World poses of all bodies, sites and geoms of a MuJoCo model in many states: positions [m] and rotations."""

    body_positions: Float[np.ndarray, "states bodies 3"]
    body_rotations: Float[np.ndarray, "states bodies 3 3"]
    site_positions: Float[np.ndarray, "states sites 3"]
    site_rotations: Float[np.ndarray, "states sites 3 3"]
    geom_positions: Float[np.ndarray, "states geoms 3"]
    geom_rotations: Float[np.ndarray, "states geoms 3 3"]


def _all_poses(model: mujoco.MjModel, states: Float[np.ndarray, "states nq"]) -> _Poses:
    """Compute the world poses of all bodies, sites and geoms in all states by forward kinematics."""
    data = mujoco.MjData(model)
    number = len(states)
    poses = _Poses(
        body_positions=np.empty((number, model.nbody, 3)),
        body_rotations=np.empty((number, model.nbody, 3, 3)),
        site_positions=np.empty((number, model.nsite, 3)),
        site_rotations=np.empty((number, model.nsite, 3, 3)),
        geom_positions=np.empty((number, model.ngeom, 3)),
        geom_rotations=np.empty((number, model.ngeom, 3, 3)),
    )

    # MuJoCo writes the poses of every state into the same arrays, so the attributes are looked up only once.
    copies = (
        (poses.body_positions, data.xpos),
        (poses.body_rotations, data.xmat.reshape(-1, 3, 3)),
        (poses.site_positions, data.site_xpos),
        (poses.site_rotations, data.site_xmat.reshape(-1, 3, 3)),
        (poses.geom_positions, data.geom_xpos),
        (poses.geom_rotations, data.geom_xmat.reshape(-1, 3, 3)),
    )
    for index, qpos in enumerate(states):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        for kept, source in copies:
            kept[index] = source
    return poses


def _geom_label(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a geom's body for findings, as in "left/hand", "object/yellow" or "fixed/wall"."""
    body = int(model.geom_bodyid[geom])
    # Geoms of the world body, such as the table, are named individually.
    name = str(model.body(body).name if body else model.geom(geom).name)
    # The model encodes the names of a scene's bodies for XML.
    if name.startswith(("object/", "fixed/")):
        return unquote(name, errors="surrogatepass")
    return name
