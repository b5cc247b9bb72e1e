"""The independent check of a plan: every sample of its motion is replayed in MuJoCo C and held against the actions.

The actions are walked once to know who holds what from which switch to which (`AttachmentInterval`); all else is read from MuJoCo's
own kinematics and collisions. Neither the optimiser's kinematics nor its distances are used. Metres, radians, seconds.
An object is *held* from its grasp's switch to the sample before its release, and *stands* in all others. Whatever
touches, a gripper and what it holds included, may do so only to `DEEPEST_CONTACT`; where two things might meet between
two samples, states in between are looked at too. There are no dynamics: no forces, no friction; a grasp carries because
its fingers are closed.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dvr_jax.checker import CheckReport, Finding, FindingLog, describe
from dvr_jax.checker.contacts import dense_states, find_contacts
from dvr_jax.checker.timeline import AttachmentInterval, attachment_timeline, next_interval
from dvr_jax.errors import DvrError
from dvr_jax.logic import FACES, Action
from dvr_jax.motion.motion import Motion, validate_motion
from dvr_jax.scene.mjcf import build_model, home_qpos, object_body_name, qpos_layout
from dvr_jax.scene.types import Scene
from dvr_jax.scene.validation import TABLE_FOOTPRINT
from dvr_jax.workcell.constants import (
    ARM_NAMES,
    FINGER_OPEN,
    FINGER_SPEED,
    JOINT_ACCELERATION,
    JOINT_LOWER,
    JOINT_UPPER,
    JOINT_VELOCITY,
    MAXIMUM_OPENING,
)

__all__ = ["CheckReport", "Finding", "check_motion", "describe"]

Floats = NDArray[np.float64]

DEEPEST_CONTACT = 3e-3
"""Deepest penetration, m."""
LIMIT_TOLERANCE = 1e-3
"""Largest excess over a joint limit, rad; also the largest deviation from the home posture."""
FINGER_TOLERANCE = 1e-4
"""Largest excess of a finger's travel over 0 to FINGER_OPEN, m."""
ROUNDING = 1 + 1e-6
"""Factor of limits of speed and acceleration."""
SWITCH_SPEED = 0.1
"""Fastest joint of an arm that takes or gives an object, as it does, rad/s."""
OBJECT_SPEED = 5.0
"""Fastest motion of an object, m/s: anything faster is a jump."""
SHIFT, TURN = 1e-3, 1e-2
"""Largest displacement (m) and rotation (rad) of what must stay: standing objects, held ones in their gripper."""
SWITCH_SHIFT, SWITCH_TURN = 3e-3, 2e-2
"""The same of an object across the one sample step at which it is grasped or released."""
CENTRE_TOLERANCE = 1e-3
"""Largest distance of the gripper's centre from the object that it grasps, m."""
AXIS_TOLERANCE = 2e-2
"""Largest angle between the closing axis and the grasped face's normal, rad."""
AXIS_OFFSET = 2e-3
"""Largest distance between the closing axis and the axis of a grasped cylinder, m."""
SUPPORT_TOLERANCE = 2e-3
"""Largest height of a placed object above or below its support, and largest overhang, m."""
GRIP_TOLERANCE = 1e-3
"""Largest distance of a finger from the side of what it holds, m."""


def check_motion(scene: Scene, actions: Sequence[Action], motion: Motion) -> CheckReport:
    """Replay a motion that claims to carry out the actions from the scene's initial state to its goal.

    Raises DvrError for what cannot be replayed: arrays that do not fit the scene, actions that do not apply.
    """
    _validate_fit(scene, actions, motion)
    last = len(motion.time) - 1
    story = attachment_timeline(scene, actions, last + 1, motion.switch)
    log = FindingLog(motion.time)
    replay, deepest = _replay(scene, motion, log)
    _check_joints(motion, home_qpos(scene), log)
    _check_switches(motion, story, log)
    _check_objects(scene, motion, story, replay, log)
    for span in story:
        if span.arm >= 0:
            _check_grasp(scene, span, replay, log)
            _check_grip(scene, motion, span, next_interval(story, span), replay, log)
            if span.end > last and span.object == scene.goal_index:
                log.add("goal held", last, (_label(scene, span.object), ARM_NAMES[span.arm]), 1.0, 0.0)
        elif span.support:
            for sample in (span.start, span.end - 1):
                _check_support(scene, span.object, span.support, sample, replay, log)
    _check_support(scene, scene.goal_index, "goal", last, replay, log)
    findings = tuple(sorted(log.worst.values(), key=lambda finding: (finding.time, finding.kind, finding.names)))
    return CheckReport(not findings, findings, deepest, last + 1, float(motion.time[-1] - motion.time[0]))


@dataclass(frozen=True, slots=True)
class _Replay:
    """World positions (..., 3) and rotations (..., 3, 3) of objects (T, N) and gripper centres (T, 2), by MuJoCo."""

    object_position: Floats
    object_rotation: Floats
    gripper_position: Floats
    gripper_rotation: Floats


def _label(scene: Scene, index: int) -> str:
    return f"object/{scene.objects[index].name}"


def _validate_fit(scene: Scene, actions: Sequence[Action], motion: Motion) -> None:
    validate_motion(motion)
    layout = qpos_layout(len(scene.objects))
    if motion.qpos.shape[1] != layout.size:
        raise DvrError(
            f"the motion's states have {motion.qpos.shape[1]} numbers; "
            f"valid are {layout.size} for {len(scene.objects)} objects."
        )
    if len(motion.switch) != len(actions):
        raise DvrError(f"the motion has {len(motion.switch)} switches; valid are {len(actions)}, one an action.")
    lengths = np.linalg.norm(motion.qpos[:, layout.objects[:, 3:]], axis=-1)
    if np.abs(lengths - 1).max() > 1e-3:
        raise DvrError(
            f"the motion has a quaternion of length {lengths.flat[np.abs(lengths - 1).argmax()]:g}; valid is 1."
        )


def _replay(scene: Scene, motion: Motion, log: FindingLog) -> tuple[_Replay, float]:
    """All poses, and the deepest penetration (m) of anything."""
    model = copy.copy(build_model(scene))
    data = mujoco.MjData(model)
    bodies = [model.body(object_body_name(item.name)).id for item in scene.objects]
    sites = [model.site(f"{arm}/gripper").id for arm in ARM_NAMES]
    states, sample = dense_states(motion)
    # The arrays stay where they are from one state to the next; only contacts move.
    arrays = (data.xpos, data.xmat, data.site_xpos, data.site_xmat, data.geom_xpos, data.geom_xmat)
    poses = [np.empty((len(states), *values.shape)) for values in arrays]
    for index, qpos in enumerate(states):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        for kept, values in zip(poses, arrays, strict=True):
            kept[index] = values
    contacts = find_contacts(model, states, poses[4], poses[5].reshape(*poses[5].shape[:2], 3, 3))

    labels = {body: model.body(body).name for body in range(model.nbody)}
    labels.update({body: _label(scene, index) for index, body in enumerate(bodies)})
    for contact in np.flatnonzero(contacts.distance < -DEEPEST_CONTACT):
        names = tuple(sorted(labels[body] for body in model.geom_bodyid[contacts.geoms[contact]].tolist()))
        depth = -float(contacts.distance[contact])
        log.add("penetration", int(sample[contacts.state[contact]]), names, depth, DEEPEST_CONTACT)
    T = len(motion.qpos)
    # Of the states that lead to a sample, the last one is the sample.
    is_sample = np.append(np.diff(sample) > 0, True)
    position, rotation, site_position, site_rotation = (values[is_sample] for values in poses[:4])
    return _Replay(
        position[:, bodies],
        rotation[:, bodies].reshape(T, -1, 3, 3),
        site_position[:, sites],
        site_rotation[:, sites].reshape(T, -1, 3, 3),
    ), max(0.0, -float(contacts.distance.min(initial=0.0)))


def _check_joints(motion: Motion, home: Floats, log: FindingLog) -> None:
    """Limits, speeds and the home posture of both arms and their fingers."""
    layout = qpos_layout((motion.qpos.shape[1] - qpos_layout(0).size) // 7)
    for a, arm in enumerate(ARM_NAMES):
        for j, index in enumerate(layout.arm_joints[a]):
            names, angles = (f"{arm}/joint{j + 1}",), motion.qpos[:, index]
            excess = np.maximum(JOINT_LOWER[j] - angles, angles - JOINT_UPPER[j])
            log.add_worst("joint limit", 0, names, excess, LIMIT_TOLERANCE)
            speeds = np.diff(angles) / motion.step
            log.add_worst("joint speed", 1, names, np.abs(speeds), ROUNDING * JOINT_VELOCITY[j])
            # The arm rests before the motion and after it.
            accelerations = np.abs(np.diff(speeds, prepend=0.0, append=0.0)) / motion.step
            log.add_worst("joint acceleration", 0, names, accelerations, ROUNDING * JOINT_ACCELERATION[j])
            log.add("home posture", 0, names, float(abs(angles[0] - home[index])), LIMIT_TOLERANCE)
        for part, index in zip(("finger_left", "finger_right"), layout.fingers[a], strict=True):
            names, travel = (f"{arm}/{part}",), motion.qpos[:, index]
            log.add_worst("finger travel", 0, names, np.maximum(-travel, travel - FINGER_OPEN), FINGER_TOLERANCE)
            log.add("home finger", 0, names, float(abs(travel[0] - home[index])), SHIFT)
            log.add_worst("finger speed", 1, names, np.abs(np.diff(travel)) / motion.step, ROUNDING * FINGER_SPEED)


def _check_switches(motion: Motion, story: tuple[AttachmentInterval, ...], log: FindingLog) -> None:
    """That arms rest as they take or give."""
    joints = qpos_layout(0).arm_joints
    for span in story:
        for arm in {
            span.arm,
            *(other.arm for other in story if other.object == span.object and other.end == span.start),
        }:
            if arm >= 0 and span.start > 0:
                speeds = np.abs(motion.qpos[span.start] - motion.qpos[span.start - 1])[joints[arm]] / motion.step
                names = (f"{ARM_NAMES[arm]}/joint{int(speeds.argmax()) + 1}",)
                log.add("switch speed", span.start, names, float(speeds.max()), SWITCH_SPEED)


def _check_objects(
    scene: Scene, motion: Motion, story: tuple[AttachmentInterval, ...], replay: _Replay, log: FindingLog
) -> None:
    """The start, jumps, standing objects that move, held objects that slip."""
    for index, item in enumerate(scene.objects):
        label, p, R = _label(scene, index), replay.object_position[:, index], replay.object_rotation[:, index]
        cosine, sine = np.cos(item.yaw), np.sin(item.yaw)
        upright = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        log.add("home shift", 0, (label,), float(np.linalg.norm(p[0] - item.center)), SHIFT)
        log.add("home turn", 0, (label,), float(_angle(R[0], upright)), TURN)
        speeds = np.linalg.norm(np.diff(p, axis=0), axis=1) / motion.step
        log.add_worst("object speed", 1, (label,), speeds, OBJECT_SPEED)
    for span in story:
        label, within = _label(scene, span.object), slice(span.start, span.end)
        p, R = replay.object_position[:, span.object], replay.object_rotation[:, span.object]
        if span.start > 0:
            shift = float(np.linalg.norm(p[span.start] - p[span.start - 1]))
            log.add("switch shift", span.start, (label,), shift, SWITCH_SHIFT)
            log.add("switch turn", span.start, (label,), float(_angle(R[span.start], R[span.start - 1])), SWITCH_TURN)
        p, R = p[within], R[within]
        kind = "standing" if span.arm < 0 else "slip"
        names: tuple[str, ...] = (label,) if span.arm < 0 else (label, ARM_NAMES[span.arm])
        if span.arm >= 0:
            to_hand = replay.gripper_rotation[within, span.arm].transpose(0, 2, 1)
            p = np.einsum("tij,tj->ti", to_hand, p - replay.gripper_position[within, span.arm])
            R = to_hand @ R
        log.add_worst(f"{kind} shift", span.start, names, np.linalg.norm(p - p[0], axis=1), SHIFT)
        log.add_worst(f"{kind} turn", span.start, names, _angle(R, R[0]), TURN)


def _check_grasp(scene: Scene, grip: AttachmentInterval, replay: _Replay, log: FindingLog) -> None:
    """The gripper's centre, its closing axis and the object's width between the fingers, at the switch."""
    item, names = scene.objects[grip.object], (_label(scene, grip.object), ARM_NAMES[grip.arm])
    R = replay.object_rotation[grip.start, grip.object]
    centre = R.T @ (replay.gripper_position[grip.start, grip.arm] - replay.object_position[grip.start, grip.object])
    closing = R.T @ replay.gripper_rotation[grip.start, grip.arm][:, 1]
    half = np.array(item.half_extents)
    if item.shape == "box":
        face = FACES.index(grip.face)
        normal = np.zeros(3)
        normal[face % 2] = 1.0 if face < 2 else -1.0
        deviation = np.arctan2(np.linalg.norm(np.cross(normal, closing)), normal @ closing)
        excess, width = np.abs(centre) - half, 2 * half[face % 2]
    else:
        deviation = np.arctan2(abs(closing[2]), np.hypot(closing[0], closing[1]))
        offset = abs(centre[0] * closing[1] - centre[1] * closing[0]) / max(np.hypot(closing[0], closing[1]), 1e-9)
        log.add("closing offset", grip.start, names, float(offset), AXIS_OFFSET)
        excess, width = np.array([np.hypot(centre[0], centre[1]) - half[0], abs(centre[2]) - half[2]]), 2 * half[0]
    log.add("gripper centre", grip.start, names, float(np.linalg.norm(np.maximum(excess, 0.0))), CENTRE_TOLERANCE)
    log.add("closing axis", grip.start, names, float(deviation), AXIS_TOLERANCE)
    log.add("width", grip.start, names, float(width), MAXIMUM_OPENING + CENTRE_TOLERANCE)


def _check_grip(
    scene: Scene,
    motion: Motion,
    span: AttachmentInterval,
    after: AttachmentInterval | None,
    replay: _Replay,
    log: FindingLog,
) -> None:
    """That fingers are closed on what they hold; at the end of a span they may open once the object is where it will
    stand, or another gripper has closed on it where it will hold it."""
    within = slice(span.start, span.end)
    loose = _looseness(scene, motion, span)[within]
    if after is not None and after.arm >= 0:
        to_hand = replay.gripper_rotation[:, after.arm].transpose(0, 2, 1)
        p = replay.object_position[:, span.object] - replay.gripper_position[:, after.arm]
        p = np.einsum("tij,tj->ti", to_hand, p)
        there = np.linalg.norm(p[within] - p[after.start], axis=1) <= SWITCH_SHIFT
        excused = there & (_looseness(scene, motion, after)[within] <= GRIP_TOLERANCE)
    elif after is not None:
        p = replay.object_position[:, span.object]
        excused = np.linalg.norm(p[within] - p[after.start], axis=1) <= SWITCH_SHIFT
    else:
        excused = np.zeros(len(loose), bool)
    names = (_label(scene, span.object), ARM_NAMES[span.arm])
    log.add_worst("grip", span.start, names, np.where(excused, 0.0, loose), GRIP_TOLERANCE)


def _looseness(scene: Scene, motion: Motion, span: AttachmentInterval) -> Floats:
    """How far the fingers of a span's arm are from closed on its object (T,), m: the worse of both."""
    item = scene.objects[span.object]
    half = item.half_extents[FACES.index(span.face) % 2] if item.shape == "box" else item.half_extents[0]
    travel = motion.qpos[:, qpos_layout(len(scene.objects)).fingers[span.arm]]
    return np.asarray(np.abs(travel - half).max(axis=1))


def _check_support(scene: Scene, index: int, support: str, sample: int, replay: _Replay, log: FindingLog) -> None:
    """That an object stands upright on the table's top, its footprint within the support's rectangle."""
    item, names = scene.objects[index], (_label(scene, index), support)
    p, R = replay.object_position[sample, index], replay.object_rotation[sample, index]
    half = np.array(item.half_extents)
    if item.shape == "box":
        lowest = p[2] - np.abs(R[2]) @ half
        corners = np.array([[x, y, -1.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * half
        footprint, radius = (p + corners @ R.T)[:, :2], 0.0
    else:
        lowest = p[2] - abs(R[2, 2]) * half[2] - np.hypot(R[2, 0], R[2, 1]) * half[0]
        footprint, radius = (p - R[:, 2] * half[2])[None, :2], float(half[0])
    rectangle = scene.goal.region.footprint if support == "goal" else TABLE_FOOTPRINT
    overhang = np.abs((footprint - rectangle.center) @ rectangle.axes().T) + radius - rectangle.half
    log.add("support tilt", sample, names, float(np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])), TURN)
    log.add("support height", sample, names, float(abs(lowest)), SUPPORT_TOLERANCE)
    log.add("support overhang", sample, names, float(overhang.max()), SUPPORT_TOLERANCE)


def _angle(first: Floats, second: Floats) -> Floats:
    """Angle between rotations (..., 3, 3), rad; exact for small ones, where the trace's arc cosine is not."""
    distance = np.linalg.norm(first - second, axis=(-2, -1))
    return np.asarray(2 * np.arcsin(np.clip(distance / np.sqrt(8.0), 0.0, 1.0)))
