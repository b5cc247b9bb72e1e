"""A workcell's arms as data of compiled programs.

What differs between two arms of the same make-up (link transforms, sizes of capsules, joint limits) are arrays; what
decides the shape of a program (numbers of arms, joints and capsules, pairs that can meet) is its static structure,
which JAX and the cache of compiled programs take as part of a program's key. Base poses are no part of the model: they
belong to each problem, so that scenes with differently placed arms can share a batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import jax
import numpy as np
from jaxtyping import Float

from dvr_jax.geometry.arrays import Array
from dvr_jax.workcell.clearances import Clearances
from dvr_jax.workcell.robot import InverseKinematics, Rectangle, Robot
from dvr_jax.workcell.workcell import Workcell, cross_arm_pairs


@dataclass(frozen=True, slots=True)
class WorkcellStructure:
    """What decides the shape of a workcell's programs."""

    number_of_arms: int
    """Number A of arms."""

    joints: int
    """Number J of joints of one arm."""

    offset_axes: tuple[tuple[int, ...], ...]
    """Axes along which the origin of link frame i + 1 is displaced from link frame i; the offsets along the others are
    zero, and their products are left out of the forward kinematics."""

    capsule_links: tuple[int, ...]
    """Link of each of the C capsules of an arm."""

    holding_capsules: tuple[int, ...]
    """Capsules that touch what their arm holds."""

    table_capsules: tuple[int, int]
    """Range of the capsules that can reach the table."""

    self_pairs: tuple[Rectangle, ...]
    """Pairs of capsules of one arm that can meet."""

    cross_pairs: tuple[tuple[int, int, Rectangle], ...]
    """Pairs of capsules of two arms that can meet: first arm, second arm, pairs of their capsules."""

    inverse_kinematics: InverseKinematics
    """The closed-form inverse kinematics of the arms."""

    @property
    def number_of_capsules(self) -> int:
        """Number C of capsules of one arm."""
        return len(self.capsule_links)

    @property
    def number_of_joints(self) -> int:
        """Number D = A J of joints of all arms."""
        return self.number_of_arms * self.joints


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class WorkcellModel:
    """Kinematics and collision geometry of the arms of a workcell, without their base poses."""

    link_rotations: Float[Array, "joints 3 3"]
    """Rotation of link frame i + 1 in link frame i at joint angle zero."""

    link_offsets: Float[Array, "joints 3"]
    """Origin of link frame i + 1 in link frame i [m]."""

    hand_rotation: Float[Array, "3 3"]
    """Rotation of the hand frame in the last link's frame."""

    gripper_center: Float[Array, " 3"]
    """Point between the finger tips, in the last link's frame [m]."""

    joint_limits: Float[Array, "2 joints"]
    """Lower and upper limits of one arm's joints [rad]."""

    capsule_starts: Float[Array, "capsules 3"]
    """First ends of the capsules' segments in their link frames, fingers closed [m]."""

    capsule_ends: Float[Array, "capsules 3"]
    """Second ends [m]."""

    capsule_radii: Float[Array, " capsules"]
    """Radii of the capsules [m]."""

    finger_directions: Float[Array, "capsules 3"]
    """Direction in which a finger's capsule moves as the gripper opens; zero for all others."""

    tucked: Float[Array, " joints"]
    """Posture in which an arm keeps out of the way of another one [rad]."""

    arm_clearance: Float[Array, ""]
    """Distance that the capsules of two arms keep [m]."""

    table_clearances: Float[Array, " table_capsules"]
    """Distance that each capsule of an arm that can reach the table keeps from it [m]."""

    link_clearance: Float[Array, ""]
    """Distance that capsules keep from objects and fixed bodies, those of the hand excepted [m]."""

    hand_clearance: Float[Array, ""]
    """Distance that the capsules of a hand keep from fixed bodies [m]."""

    structure: WorkcellStructure = field(metadata={"static": True})
    """What decides the shape of programs."""


@lru_cache(maxsize=64)
def workcell_model(workcell: Workcell) -> WorkcellModel:
    """Arrays and structure of a workcell's arms, as NumPy arrays that are kept and shared.

    Workcells that differ only in base poses, homes and names, and whose arms can meet in the same places, have models
    that compare equal in structure, so their problems share compiled programs and batches.
    """
    return _model_of(
        workcell.robot, workcell.number_of_arms, cross_arm_pairs(workcell), workcell.clearances
    )


@lru_cache(maxsize=64)
def _model_of(
    robot: Robot,
    number_of_arms: int,
    cross_pairs: tuple[tuple[int, int, Rectangle], ...],
    clearances: Clearances,
) -> WorkcellModel:
    capsules = robot.capsules
    above_table = [
        clearances.hand_to_table if capsule in robot.holding_capsules else clearances.link_to_table
        for capsule in range(*robot.table_capsules)
    ]
    structure = WorkcellStructure(
        number_of_arms=number_of_arms,
        joints=robot.number_of_joints,
        offset_axes=tuple(tuple(np.flatnonzero(row).tolist()) for row in robot.link_offsets),
        capsule_links=capsules.links,
        holding_capsules=robot.holding_capsules,
        table_capsules=robot.table_capsules,
        self_pairs=robot.self_collision_pairs,
        cross_pairs=cross_pairs,
        inverse_kinematics=robot.inverse_kinematics,
    )
    return WorkcellModel(
        link_rotations=robot.link_rotations,
        link_offsets=robot.link_offsets,
        hand_rotation=robot.hand_rotation,
        gripper_center=robot.gripper_center,
        joint_limits=robot.joint_limits,
        capsule_starts=capsules.starts,
        capsule_ends=capsules.ends,
        capsule_radii=capsules.radii,
        finger_directions=capsules.finger_directions,
        tucked=np.array(robot.tucked),
        arm_clearance=np.array(clearances.arm_to_arm),
        table_clearances=np.array(above_table),
        link_clearance=np.array(clearances.link_to_object),
        hand_clearance=np.array(clearances.hand_to_object),
        structure=structure,
    )
