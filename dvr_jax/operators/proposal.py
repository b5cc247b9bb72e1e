"""Proposals: random mode parameters for one action, and the gripper poses that they ask for.

Batch axes are (M, B, J): M prefixes, B keyframe candidates of each, J proposals for each candidate. Random numbers
come in as an array ``u`` of uniform numbers in [0, 1), `UNIFORM_NUMBERS` for each (B, J), the same for every prefix:
what a prefix gets does not depend on the batch that it is in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Rotation, Vector, compose, materialize, rotate
from dvr_jax.modes.held import GraspFrame, grasp_frame

UNIFORM_NUMBERS = 10
"""Uniform numbers that a proposal takes."""


class BeamStep(NamedTuple):
    """One action for each of M prefixes, as arrays."""

    prism: Float[Array, "prefixes objects 4"]
    """Shapes of the objects."""

    initial_pose: Float[Array, "prefixes objects 4"]
    """Where the scene has the objects: x, y, z [m], yaw [rad]."""

    fixed_prism: Float[Array, "prefixes fixed 4"]
    """Shapes of the fixed bodies."""

    fixed_pose: Float[Array, "prefixes fixed 4"]
    """Poses of the fixed bodies."""

    base_rotation: Float[Array, "prefixes arms 3 3"]
    """Rotations of the bases."""

    base_position: Float[Array, "prefixes arms 3"]
    """Positions of the bases [m]."""

    home: Float[Array, "prefixes joints"]
    """Home posture of all arms [rad]."""

    finger_opening: Float[Array, "prefixes arms"]
    """Distance of each finger from its hand's middle plane at the switch [m]."""

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
    """Yaw of the closing axis in the object's frame [rad]."""

    parameter_lower: Float[Array, "prefixes 4"]
    """Lower bounds of the mode parameters."""

    parameter_upper: Float[Array, "prefixes 4"]
    """Upper bounds of the mode parameters."""

    support: Float[Array, "prefixes 5"]
    """Rectangle that the object is put on: center x, y, yaw, half extents."""

    meeting_center: Float[Array, "prefixes 2"]
    """Center (x, y) of the region where the acting and the giving arm meet [m]."""

    meeting_axis: Float[Array, "prefixes 2"]
    """Direction of the line through their bases: a unit vector."""

    sibling_penalty: Float[Array, " prefixes"]
    """By how much a further child of the same parent must be better [m]."""


class ObjectBefore(NamedTuple):
    """How the switched object is attached before the action, in every candidate."""

    kind: Int[Array, " prefixes"]
    """`ModeKind` of the object."""

    closing_yaw: Float[Array, " prefixes"]
    """Yaw of the closing axis where the object is held [rad]."""

    parameters: Float[Array, "prefixes candidates 4"]
    """Mode parameters of each candidate."""


class ProposedPoses(NamedTuple):
    """Mode parameters, and the poses of the G grippers that they ask for."""

    m: Float[Array, "4 prefixes candidates proposals"]
    """Mode parameters of the action."""

    rotation: Float[Array, "grippers 3 3 prefixes candidates proposals"]
    """Axes of the acting gripper; in a handover (G = 2) those of the giving one after it."""

    position: Float[Array, "grippers 3 prefixes candidates proposals"]
    """Gripper centers [m]."""

    overhang: Float[Array, "prefixes candidates proposals"]
    """By how much a placed object sticks out of its support [m]; it counts as violation."""


@dataclass(frozen=True)
class Proposal:
    """One way to sample an action."""

    name: str
    """Unique among all proposals, as in "handover"."""

    propose: Callable[
        [BeamStep, ObjectBefore, Float[Array, "numbers candidates proposals"]], ProposedPoses
    ]
    """The compiled sampler, a `dvr_jax.runtime.compilation.Program`."""

    sibling_penalty: float
    """By how much a further child of the same parent must be better [m]: the larger, the more varied the beam."""


def of_item(
    value: Float[Array, "prefixes objects"], step: BeamStep
) -> Float[Array, "prefixes 1 1"]:
    """Entries of the switched objects.

    Args:
        value: A number for each object.
        step: The action of each prefix.
    """
    return jnp.take_along_axis(jnp.asarray(value), step.item[:, None], axis=1)[:, :, None]


def of_arm(
    value: Float[Array, "prefixes arms *rest"], arm: Int[Array, " prefixes"]
) -> Float[Array, "prefixes *rest"]:
    """Entries of one arm of each prefix.

    Args:
        value: Something for each arm.
        arm: Index of the arm.
    """
    index = jnp.asarray(arm).reshape(-1, *(1,) * (value.ndim - 1))
    return jnp.take_along_axis(jnp.asarray(value), index, axis=1)[:, 0]


def held_frame(before: ObjectBefore) -> GraspFrame:
    """The gripper that holds the object, in the object's frame; batch axes (M, B, 1)."""
    parameters = jnp.moveaxis(jnp.asarray(before.parameters), -1, 0)[..., None]
    return materialize(grasp_frame(parameters, before.closing_yaw[:, None, None]))


def world_gripper(
    rotation: Rotation, position: Vector, frame: GraspFrame, shape: tuple[int, ...]
) -> tuple[Rotation, Vector]:
    """World pose of a gripper from the pose of the object that it holds.

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
