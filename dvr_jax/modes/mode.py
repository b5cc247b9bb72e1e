"""The records that all modes share: kinds, attachments, poses."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from jaxtyping import Bool, Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.geometry.vectors import Rotation, Vector

PARAMETERS = 4
"""Mode parameters of an action. What they mean depends on the mode that the action starts; see `held` and `placed`."""


class ModeKind(IntEnum):
    """How an object is attached during a phase."""

    ABSENT = -1
    """The object is left out of the world, which makes a problem easier: a relaxation."""

    FIXED = 0
    """The object stands where the scene has it."""

    PLACED = 1
    """The object stands where an action has placed it."""

    HELD = 2
    """The object is rigidly attached to the gripper of the arm that is its parent."""


class Attachment(NamedTuple):
    """How objects are attached, and the mode parameters of the actions that attached them.

    The batch axes are the same for all fields, usually (objects, slices).
    """

    kind: Int[Array, "*#batch"]
    """A `ModeKind`."""

    parent: Int[Array, "*#batch"]
    """The arm that holds a held object; 0 for all others."""

    parameters: Float[Array, "4 *#batch"]
    """Mode parameters of the action that attached the object; without meaning where the object is fixed."""

    closing_yaw: Float[Array, "*#batch"]
    """Yaw of a held object's closing axis in the object's frame, before the fourth parameter is added [rad]."""

    initial_pose: Float[Array, "4 *#batch"]
    """Where the scene has the object: x, y, z of its center [m] and its yaw [rad]."""

    half_height: Float[Array, "*#batch"]
    """Half the object's height [m]."""


class HandPoses(NamedTuple):
    """World poses of all grippers in every slice."""

    rotation: Float[Array, "3 3 arms slices"]
    """Axes of the hands, columns first: y closes, z approaches."""

    position: Float[Array, "3 arms slices"]
    """Gripper centers [m]."""


class ObjectPoses(NamedTuple):
    """World poses of objects, and how the objects move with mode parameters and joints."""

    rotation: Float[Array, "3 3 objects slices"]
    """Axes of the objects, columns first."""

    position: Float[Array, "3 objects slices"]
    """Centers of the objects [m]."""

    twists: Float[Array, "6 4 objects slices"]
    """World twist of each object at unit rate of each mode parameter.

    A twist is the angular velocity, then the velocity of the point at the world's origin.
    """

    held: Bool[Array, "arms objects slices"]
    """True where an arm holds the object, which then moves with all joints of that arm."""


Frame = tuple[Rotation, Vector]
"""Rotation and origin of a frame."""
