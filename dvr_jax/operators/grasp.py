"""The operator "grasp": an empty gripper takes an object that stands, or that another arm holds (a handover).

The mode parameters of a grasp are (tangent, height, pitch, yaw); `dvr_jax.modes.held` defines them.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import compose, materialize, rotation_about_z, vector
from dvr_jax.logic import Action, shipped_action
from dvr_jax.modes.held import GraspFrame, grasp_frame
from dvr_jax.modes.mode import ModeKind
from dvr_jax.operators.operator import (
    FREE,
    ModeSwitch,
    ObjectMode,
    Operator,
    Parameter,
    SkeletonState,
)
from dvr_jax.operators.proposal import (
    BeamStep,
    ObjectBefore,
    Proposal,
    ProposedPoses,
    held_frame,
    of_item,
    of_switched_object,
    world_gripper,
)
from dvr_jax.runtime.compilation import Program
from dvr_jax.scene.types import Scene, SceneObject
from dvr_jax.shapes import FACES

GRASP_MARGIN = 0.01
"""How far inside the object's sides the gripper's center stays, so that the pads are within them [m]."""

HEIGHT_MARGIN = 0.003
"""How far below the top and above the bottom of the object the gripper's center stays [m]. It is smaller than half a
pad, because fingers would touch the table around a small cube whose top was higher above the pads' centers."""

PITCH_LIMIT = 2.2
"""Largest tilt of the approach axis from straight down, in both directions [rad].

It is larger than pi/2, because some handovers need an approach from below the horizontal.
"""

PITCH_RANGE = 1.75
"""Largest tilt of the approach axis of a proposal from straight down [rad]: 10 degrees beyond the horizontal."""

LARGEST_GRASP = (1e3, 1e3, PITCH_RANGE, math.pi)
"""Proposals stay within the bounds of the switch and within plus and minus these mode parameters [m, m, rad, rad]."""

MEETING_ALONG = 0.25
"""Objects are handed over within this distance of the meeting region's center, along the line through both bases
[m]."""

MEETING_ACROSS = 0.4
"""Objects are handed over within this distance of the meeting region's center, across the line through both bases
[m]."""

MEETING_HEIGHT = (0.15, 0.6)
"""Lowest and highest z of the center of an object that is handed over [m]."""

MEETING_TILT = 0.8
"""Largest tilt of an object that is handed over [rad]."""

GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""

LEVER_MOMENT = 0.1
"""Moment of an object's weight about the gripper that adds `LEVER_COST` to the cost [N m].

A grasp near the center of a heavy object is preferred, because its weight and inertia turn it in the fingers otherwise.
"""

LEVER_COST = 0.05
"""Cost of this moment; the cost of a path of two actions is about 0.1."""

PITCH_COST = 0.01
"""Weight of the squared pitch of a grasp in the cost [1/rad^2]. A steep grasp is preferred, because the hand then stays
away from what stands beside the object."""

SIBLING_PENALTY = 0.01
"""Penalty on the violation of a grasp for each better sibling in the beam [m].

A grasp decides what can be reached later, so diversity is worth more penetration for grasps than for placements.
"""


def _face_and_object(scene: Scene, action: Action) -> tuple[str, SceneObject]:
    """Return the face that an action grasps, and its object."""
    _, face, name = action.arguments
    return face, scene.objects[scene.object_index(name)]


def _room(item: SceneObject, face: str) -> tuple[float, float]:
    """Return the largest distances of the gripper's center from the object's, along tangent and vertical axis [m]."""
    tangent = item.kind.tangent_half_extent(item.size, face) - GRASP_MARGIN
    # If faces cannot be told apart (cylinders), the closing axis has to intersect the object's vertical axis.
    along = tangent if item.kind.has_faces else min(0.0, tangent)
    return along, item.half_extents[2] - HEIGHT_MARGIN


def _refute(scene: Scene, action: Action) -> str | None:
    """Return why an object is too wide or too small to be grasped at a face, or None."""
    face, item = _face_and_object(scene, action)
    width = item.kind.grip_width(item.size, face)
    opening = scene.workcell.robot.maximum_opening
    if width > opening:
        return f"{item.name} is {100 * width:.1f} cm wide at its {face} face, the gripper opens {100 * opening:.0f} cm"

    if min(_room(item, face)) < 0:
        return (
            f"{item.name} is too small to hold the gripper's center with its margins of "
            f"{100 * GRASP_MARGIN:.1f} cm to the sides and {100 * HEIGHT_MARGIN:.1f} cm to top and bottom"
        )
    return None


def _preference(item: SceneObject) -> tuple[float, float, float, float]:
    """Return the weights of the squared mode parameters of a grasp in the cost [1/m^2 or 1/rad^2]."""
    lever = 2 * LEVER_COST * (GRAVITY * item.mass / LEVER_MOMENT) ** 2
    return (lever, lever, PITCH_COST, 0.0)


def _is_duplicate(scene: Scene, action: Action) -> bool:
    """Return whether an action grasps a cylinder at another face than +x.

    The faces of a cylinder cannot be told apart, so a grasp at +x, whose yaw is free, represents all four grasps.
    """
    face, item = _face_and_object(scene, action)
    return not item.kind.has_faces and face != FACES[0]


def _switch(state: SkeletonState, action: Action) -> ModeSwitch:
    """Return the mode switch of a grasp: the object is held by the acting arm afterwards."""
    scene = state.scene
    face, item = _face_and_object(scene, action)
    arm = scene.workcell.arm_index(action.arguments[0])
    index = scene.object_index(item.name)
    before = state.modes[index]
    tangent, height = _room(item, face)
    yaw_room = 0.0 if item.kind.has_faces else FREE

    # In a handover the giving arm takes part too: it rests at the switch and opens its fingers.
    opening = list(state.finger_opening)
    arms_at_rest = {arm}
    if before.kind == ModeKind.HELD:
        opening[before.parent] = scene.workcell.robot.finger_travel
        arms_at_rest.add(before.parent)
    opening[arm] = item.kind.grip_width(item.size, face) / 2

    return ModeSwitch(
        item=index,
        acting_arm=arm,
        arms_at_rest=frozenset(arms_at_rest),
        mode=ObjectMode(ModeKind.HELD, arm),
        lower=(-tangent, -height, -PITCH_LIMIT, -yaw_room),
        upper=(tangent, height, PITCH_LIMIT, yaw_room),
        finger_opening=tuple(opening),
        closing_yaw=FACES.index(face) * math.pi / 2,
        preference=_preference(item),
    )


def _sample_grasp(step: BeamStep, u: Array) -> tuple[Array, GraspFrame]:
    """Draw mode parameters (4, M, B, J) within their bounds; return them and the gripper's pose in the object's frame.

    The batch axes are M prefixes, B candidates and J proposals (`dvr_jax.operators.proposal`).
    """
    widest = jnp.asarray(LARGEST_GRASP, u.dtype)
    low = jnp.clip(step.parameter_lower, -widest, widest).T[..., None, None]
    high = jnp.clip(step.parameter_upper, -widest, widest).T[..., None, None]
    m = materialize(low + (high - low) * u[:4, None])
    return m, materialize(grasp_frame(m, step.closing_yaw[:, None, None]))


def propose_grasp(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Propose grasps of a standing object, uniformly within the bounds of the mode parameters.

    Args:
        step: The action of each prefix.
        before: How the object is attached before the action.
        u: Uniform random numbers in [0, 1).
    """
    return _propose_grasp(of_switched_object(step), before, u)


@Program
def _propose_grasp(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Do the work of `propose_grasp`, for the switched objects alone."""
    m, frame = _sample_grasp(step, u)

    # The object stands where the scene has it, or where an earlier action has placed it.
    is_fixed = (before.kind == ModeKind.FIXED)[:, None, None]
    placed_at = jnp.moveaxis(before.parameters, -1, 0)[..., None]
    x, y, z, yaw = (of_item(step.initial_pose[..., i], step) for i in range(4))
    half_height = of_item(step.prism[..., 2], step)
    yaw = jnp.where(is_fixed, yaw, placed_at[2])
    z = jnp.where(is_fixed, z, placed_at[3] + half_height)
    R = rotation_about_z(*materialize((jnp.cos(yaw), jnp.sin(yaw))))
    p = vector(jnp.where(is_fixed, x, placed_at[0]), jnp.where(is_fixed, y, placed_at[1]), z)

    rotation, position = world_gripper(R, p, frame, m.shape[1:])
    return ProposedPoses(m, rotation[None], position[None], jnp.zeros_like(m[0]))


def propose_handover(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Propose grasps of an object that another arm holds, at random poses of the object between both arms.

    Args:
        step: The action of each prefix.
        before: How the giving gripper holds the object.
        u: Uniform random numbers in [0, 1).
    """
    return _propose_handover(of_switched_object(step), before, u)


@Program
def _propose_handover(
    step: BeamStep, before: ObjectBefore, u: Float[Array, "numbers candidates proposals"]
) -> ProposedPoses:
    """Do the work of `propose_handover`, for the switched objects alone."""
    m, taker = _sample_grasp(step, u)

    # The object's position is uniform in a box around the meeting region's center. The box is aligned with the line
    # through both bases.
    along = -MEETING_ALONG + 2 * MEETING_ALONG * u[4]
    across = -MEETING_ACROSS + 2 * MEETING_ACROSS * u[5]
    height = MEETING_HEIGHT[0] + (MEETING_HEIGHT[1] - MEETING_HEIGHT[0]) * u[6]
    axis_x, axis_y = (step.meeting_axis[:, None, None, i] for i in range(2))
    center_x, center_y = (step.meeting_center[:, None, None, i] for i in range(2))
    p = vector(
        center_x + (axis_x * along - axis_y * across),
        center_y + (axis_y * along + axis_x * across),
        height[None],
    )

    # The object's orientation is R = Rz(axis) Rx(tilt) Rz(yaw - axis): a yaw, then a tilt about a horizontal axis.
    yaw = 2 * math.pi * u[7]
    axis = 2 * math.pi * u[8]
    angles = jnp.stack([axis, MEETING_TILT * u[9], yaw - axis])
    (ca, ct, cy), (sa, st, sy) = materialize((jnp.cos(angles), jnp.sin(angles)))
    zero = jnp.zeros_like(ca)
    tilt = jnp.stack([vector(zero + 1, zero, zero), vector(zero, ct, st), vector(zero, -st, ct)])
    R = compose(materialize(compose(rotation_about_z(ca, sa), tilt)), rotation_about_z(cy, sy))
    R = materialize(R)[:, :, None]

    shape = m.shape[1:]
    hands = [world_gripper(R, p, frame, shape) for frame in (taker, held_frame(before))]
    rotations, positions = zip(*hands, strict=True)
    return ProposedPoses(m, jnp.stack(rotations), jnp.stack(positions), jnp.zeros_like(m[0]))


STANDING_GRASP = Proposal("grasp", propose_grasp, SIBLING_PENALTY)
"""How a grasp of a standing object is sampled."""

HANDOVER = Proposal("handover", propose_handover, SIBLING_PENALTY)
"""How a grasp of an object in another gripper is sampled."""


def _proposal(before: ModeKind) -> Proposal:
    """Return how a grasp is sampled, given whether the object stands or is held before it."""
    return HANDOVER if before == ModeKind.HELD else STANDING_GRASP


GRASP = Operator(
    name="grasp",
    parameters=(Parameter.ARM, Parameter.FACE, Parameter.OBJECT),
    pddl=shipped_action("grasp"),
    phrase="{0} grasps {2} at its {1} face",
    mode_after=ModeKind.HELD,
    refute=_refute,
    is_duplicate=_is_duplicate,
    switch=_switch,
    proposal=_proposal,
)
"""The operator by which an empty gripper takes an object at one of its side faces."""
