"""A proposal draws random mode parameters for one action and computes the gripper poses that belong to them.

The batch axes are (M, B, J): M prefixes, B keyframe candidates of each prefix, and J proposals for each candidate
(`dvr_jax.seeds.keyframe_beam`). The random numbers are an argument: an array ``u`` of the shape
(`UNIFORM_NUMBERS`, B, J), uniform in [0, 1). They are the same for every prefix, so that the proposals of a prefix do
not depend on the batch that it is in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Rotation, Vector, compose, materialize, rotate
from dvr_jax.modes.held import GraspFrame, grasp_frame

UNIFORM_NUMBERS = 10
"""Number of uniform random numbers for each proposal."""


class BeamStep(NamedTuple):
    """One action for each of M prefixes, as arrays."""

    prism: Float[Array, "prefixes objects 4"]
    """Shapes of the objects as prisms (hx, hy, hz, r) [m]."""

    initial_pose: Float[Array, "prefixes objects 4"]
    """Where the scene has the objects: x, y, z [m], yaw [rad]."""

    fixed_prism: Float[Array, "prefixes fixed 4"]
    """Shapes of the fixed bodies as prisms (hx, hy, hz, r) [m]."""

    fixed_pose: Float[Array, "prefixes fixed 4"]
    """Poses of the fixed bodies: x, y, z of the center [m] and yaw [rad]."""

    base_rotation: Float[Array, "prefixes arms 3 3"]
    """Rotations of the bases."""

    base_position: Float[Array, "prefixes arms 3"]
    """Positions of the bases [m]."""

    home: Float[Array, "prefixes joints"]
    """Home posture of all arms [rad]."""

    finger_opening: Float[Array, "prefixes arms"]
    """Distance of each finger from its hand's middle plane at the switch [m]."""

    clearance: Float[Array, "prefixes body_rows"]
    """Distances that hands, objects and fixed bodies keep (`dvr_jax.nlp.body_clearances`) [m]."""

    depth: Int[Array, " prefixes"]
    """Number of the action in its sequence, from 0."""

    acting_arm: Int[Array, " prefixes"]
    """Arm that carries the action out."""

    giving_arm: Int[Array, " prefixes"]
    """Arm that holds the object before the action; 0 where none does."""

    item: Int[Array, " prefixes"]
    """Object that the action switches."""

    kind_after: Int[Array, " prefixes"]
    """`ModeKind` of the object afterwards."""

    parent_after: Int[Array, " prefixes"]
    """Arm that holds the object afterwards; 0 where none does."""

    closing_yaw: Float[Array, " prefixes"]
    """Yaw of the closing axis, along which the fingers close, in the object's frame after the action [rad]."""

    parameter_lower: Float[Array, "prefixes 4"]
    """Lower bounds of the mode parameters [m or rad]."""

    parameter_upper: Float[Array, "prefixes 4"]
    """Upper bounds of the mode parameters [m or rad]."""

    support: Float[Array, "prefixes *candidates 5"]
    """Rectangle on which the object is placed: center x, y [m], yaw [rad], half extents [m]. It has an axis of
    candidates in a scene in which objects are supports, because candidates differ in where a lower object stands."""

    inner_prism: Float[Array, "prefixes 4"]
    """Prism of the part of the object that has to lie within the support [m]; see `ModeSwitch.inner_prism`."""

    kept_clear: Float[Array, "prefixes regions 5"]
    """Rectangles that the placed object must not cover, as `support`; zeros where there is none."""

    meeting_center: Float[Array, "prefixes 2"]
    """Center (x, y) of the region where the acting and the giving arm meet [m]."""

    meeting_axis: Float[Array, "prefixes 2"]
    """Unit vector along the line through the bases of the acting and the giving arm."""

    sibling_penalty: Float[Array, " prefixes"]
    """Penalty on the violation of a proposal for each better sibling [m]."""


class ObjectBefore(NamedTuple):
    """How the switched object is attached before the action, in every candidate."""

    kind: Int[Array, " prefixes"]
    """`ModeKind` of the object."""

    closing_yaw: Float[Array, " prefixes"]
    """Yaw of the closing axis where the object is held [rad]."""

    parameters: Float[Array, "prefixes candidates 4"]
    """Mode parameters of each candidate."""


class ProposedPoses(NamedTuple):
    """Proposed mode parameters, and the poses of the G grippers that belong to them."""

    m: Float[Array, "4 prefixes candidates proposals"]
    """Mode parameters of the action."""

    rotation: Float[Array, "grippers 3 3 prefixes candidates proposals"]
    """Axes of the acting gripper; in a handover (G = 2) those of the giving one after it."""

    position: Float[Array, "grippers 3 prefixes candidates proposals"]
    """Gripper centers [m]."""

    overhang: Float[Array, "prefixes candidates proposals"]
    """By how much a placed object sticks out of its support, and into regions that stay clear [m]; it counts as
    violation."""


@dataclass(frozen=True)
class Proposal:
    """A way to sample the mode parameters of an action."""

    name: str
    """Unique among all proposals, as in "handover"."""

    propose: Callable[
        [BeamStep, ObjectBefore, Float[Array, "numbers candidates proposals"]], ProposedPoses
    ]
    """Compiled function (a `dvr_jax.runtime.compilation.Program`) of the actions, of the objects' attachments before
    them, and of uniform random numbers, which returns the proposals."""

    sibling_penalty: float
    """Penalty on the violation of a proposal for each better sibling [m]; the larger, the more diverse the beam."""


def of_switched_object(step: BeamStep) -> BeamStep:
    """Return the actions with the objects that they switch as the only bodies of their scenes.

    A program that takes them serves scenes with any number of objects and fixed bodies, so that it is compiled once.

    Args:
        step: The action of each prefix.
    """
    prefixes = np.arange(len(step.item))
    none = slice(0, 0)
    return step._replace(
        prism=step.prism[prefixes, step.item][:, None],
        initial_pose=step.initial_pose[prefixes, step.item][:, None],
        fixed_prism=step.fixed_prism[:, none],
        fixed_pose=step.fixed_pose[:, none],
        clearance=step.clearance[:, none],
        item=0 * step.item,
    )


def of_item(
    value: Float[Array, "prefixes objects"], step: BeamStep
) -> Float[Array, "prefixes 1 1"]:
    """Return the entry of the switched object for each prefix.

    Args:
        value: A number for each object.
        step: The action of each prefix.
    """
    return jnp.take_along_axis(jnp.asarray(value), step.item[:, None], axis=1)[:, :, None]


def of_arm(
    value: Float[Array, "prefixes arms *rest"], arm: Int[Array, " prefixes"]
) -> Float[Array, "prefixes *rest"]:
    """Return the entry of one arm for each prefix.

    Args:
        value: Array with an axis of arms.
        arm: Index of the arm.
    """
    index = jnp.asarray(arm).reshape(-1, *(1,) * (value.ndim - 1))
    return jnp.take_along_axis(jnp.asarray(value), index, axis=1)[:, 0]


def held_frame(before: ObjectBefore) -> GraspFrame:
    """Return the pose, in the object's frame, of the gripper that holds it; the batch axes are (M, B, 1)."""
    parameters = jnp.moveaxis(jnp.asarray(before.parameters), -1, 0)[..., None]
    return materialize(grasp_frame(parameters, before.closing_yaw[:, None, None]))


def world_gripper(
    rotation: Rotation, position: Vector, frame: GraspFrame, shape: tuple[int, ...]
) -> tuple[Rotation, Vector]:
    """Compute the world pose of a gripper from the world pose of the object that it holds.

    Args:
        rotation: Axes of the object (3, 3, ...).
        position: Center of the object (3, ...) [m].
        frame: The gripper in the object's frame.
        shape: Batch axes of the result.

    Returns:
        Axes (3, 3, *shape) and center (3, *shape) [m] of the gripper.
    """
    hand_R, hand_p = materialize(
        (compose(rotation, frame.rotation), position + rotate(rotation, frame.position))
    )
    return jnp.broadcast_to(hand_R, (3, 3, *shape)), jnp.broadcast_to(hand_p, (3, *shape))
