"""The independent check of a plan replays every sample of its motion in MuJoCo C and compares it with the actions.

The actions determine which object is attached to what, from which switch to which (`Timeline`). Everything else is
computed by MuJoCo's own kinematics and collision detection; neither the kinematics nor the distances of the optimizer
are used.

Any two bodies may penetrate each other by at most `DEEPEST_CONTACT`, and a hand and an object that it grasps by at most
`DEEPEST_GRIP`. If two bodies might meet between two samples, the check also examines states in between
(`dvr_jax.checker.motion_contacts`).

The check is kinematic unless it is asked for the jerks and torques of the joints (`dvr_jax.checker.dynamics`). It
computes no contact forces and no friction: a closed gripper is assumed to carry its object.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from dvr_jax.checker.all_poses import all_poses
from dvr_jax.checker.collision_model import collision_model
from dvr_jax.checker.contacts import Contacts
from dvr_jax.checker.dense_states import dense_states
from dvr_jax.checker.dynamics import check_jerks, check_torques
from dvr_jax.checker.goals import check_goal
from dvr_jax.checker.joints import (
    check_fingers,
    check_joints,
    check_rest_at_switches,
)
from dvr_jax.checker.kinds import PENETRATION
from dvr_jax.checker.motion_contacts import find_contacts
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
from dvr_jax.scene.mjcf import object_body_name, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.workcell.robot import FINGERS

__all__ = ["DEEPEST_CONTACT", "check_motion"]


def check_motion(
    scene: Scene,
    actions: Sequence[Action],
    motion: Motion,
    operators: Sequence[OperatorCheck] = CHECKS,
    dynamics: bool = False,
) -> CheckReport:
    """Check a motion that claims to carry out actions from a scene's initial state to its goal.

    Args:
        scene: The scene.
        actions: The actions, one for each switch of the motion.
        motion: The motion.
        operators: The check's operators; every action has to be of one of them.
        dynamics: Whether jerks and torques of the joints are checked as well, which about doubles the time.

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

    _check_kinematics(replayed, timeline, log)
    if dynamics:
        check_jerks(replayed, log)
        check_torques(replayed, timeline, log)

    findings = log.findings()
    return CheckReport(
        passed=not findings,
        findings=findings,
        deepest_penetration=deepest,
        samples=len(motion.time),
        duration=float(motion.time[-1] - motion.time[0]),
    )


def _check_kinematics(replayed: ReplayedMotion, timeline: Timeline, log: FindingLog) -> None:
    """Log everything that is wrong with a replayed motion, apart from penetrations.

    Args:
        replayed: The motion.
        timeline: Its intervals.
        log: Takes the findings.
    """
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

    check_goal(replayed.scene.goal, replayed, timeline, log)


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
    scene_model = collision_model(scene)
    states, sample = dense_states(scene_model.model, motion)
    poses = all_poses(scene_model, states)

    # Contacts of all states, including those between the samples; a finding names the sample that a state leads to.
    accepted = _accepted_depths(scene_model.labels, _grips(scene, timeline))
    contacts = find_contacts(scene_model, states, poses.geoms, accepted)
    _log_penetrations(scene_model.labels, contacts, sample, accepted, log)

    # Of the states that lead to a sample, the last one is the sample itself. The other checks examine only samples.
    is_sample = np.append(np.diff(sample) > 0, True)
    model = scene_model.model
    bodies = [model.body(object_body_name(item.name)).id for item in scene.objects]
    sites = [model.site(f"{arm}/gripper").id for arm in scene.workcell.arm_names]
    replayed = ReplayedMotion(
        scene=scene,
        motion=motion,
        object_positions=poses.body_positions[:, bodies][is_sample],
        object_rotations=poses.body_rotations[:, bodies][is_sample],
        gripper_positions=poses.site_positions[:, sites][is_sample],
        gripper_rotations=poses.site_rotations[:, sites][is_sample],
    )
    return replayed, max(0.0, -float(contacts.distance.min(initial=0.0)))


def _accepted_depths(
    labels: tuple[str, ...], grips: frozenset[tuple[str, str]]
) -> Float[np.ndarray, "geoms geoms"]:
    """Return how deep each two geoms may penetrate each other [m].

    Args:
        labels: Name of the body of each geom.
        grips: Names of two bodies of which one grasps the other.
    """
    accepted = np.full((len(labels), len(labels)), DEEPEST_CONTACT)
    of_body = {name: np.array([label == name for label in labels]) for name in labels}
    for first, second in grips:
        together = of_body[first][:, None] & of_body[second]
        accepted[together | together.T] = DEEPEST_GRIP
    return accepted


def _log_penetrations(
    labels: tuple[str, ...],
    contacts: Contacts,
    sample: Int[np.ndarray, " states"],
    accepted: Float[np.ndarray, "geoms geoms"],
    log: FindingLog,
) -> None:
    """Log the contacts that are deeper than accepted.

    Args:
        labels: Name of the body of each geom.
        contacts: The contacts.
        sample: Sample that each state is or leads to.
        accepted: Depth up to which two geoms may penetrate each other [m].
        log: Takes the findings.
    """
    limits = accepted[contacts.geoms[:, 0], contacts.geoms[:, 1]]
    too_deep = np.flatnonzero(-contacts.distance > limits)

    # In the order of time, so that of equal depths the log keeps the first one.
    order = np.argsort(contacts.state[too_deep], kind="stable")
    for contact in too_deep[order].tolist():
        first, second = sorted(labels[geom] for geom in contacts.geoms[contact].tolist())
        log.add(
            PENETRATION,
            int(sample[contacts.state[contact]]),
            (first, second),
            -float(contacts.distance[contact]),
            float(limits[contact]),
        )


def _grips(scene: Scene, timeline: Timeline) -> frozenset[tuple[str, str]]:
    """Return the labels of the bodies of a hand together with those of each object that it grasps in the plan."""
    grips = set()
    for interval in timeline.intervals:
        if interval.holder is None:
            continue
        arm = scene.workcell.arm_names[interval.holder]
        item = f"object/{scene.objects[interval.object].name}"
        grips |= {(f"{arm}/{body}", item) for body in ("hand", *FINGERS)}
    return frozenset(grips)
