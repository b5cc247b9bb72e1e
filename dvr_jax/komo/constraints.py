"""All constraint rows of one NLP at given variables, in metres and radians, with structured Jacobians.

Every Jacobian is assembled from twists in closed form: a slice's rows times the joints' screws, never by differentiating a whole
slice (which costs 35 to 150 times the evaluation; see the distances' wrenches in `dvr_jax.geometry.distances`).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import compose_rotations, cross, half_rotation_vector, rotation_angle, transpose
from dvr_jax.komo.contacts import Contacts, slice_contacts, slice_distances
from dvr_jax.komo.modes import ModeTransforms, ObjectPoses, mode_transforms, object_poses
from dvr_jax.komo.problem import Problem, Variables
from dvr_jax.robot.kinematics import capsule_segments, hand_pose, joint_screws, link_poses, load_arm


class Rows(NamedTuple):
    """Constraint residuals of one NLP; Jacobians are None where they were not asked for."""

    distance: Array
    """(T, P) signed distances [m], feasible where >= 0; see `dvr_jax.komo.contacts` for the rows."""
    distance_q: Array | None
    """(T, 14, P)."""
    distance_m: Array | None
    """(T, 4, N, P) with respect to the parameters of the action that each object is attached by."""
    switch: Array
    """(K, 6) pose of the switched object under the old mode minus that under the new: position [m], twice the
    quaternion's vector part (the rotation vector [rad] to third order)."""
    switch_angle: Array
    """(K,) angle between the two orientations [rad]."""
    switch_q: Array | None
    """(K, 6, 14)."""
    switch_m: Array | None
    """(K, 6, 2, 4) with respect to the parameters of the old and of the new mode."""
    footprint: Array
    """(K, 4) by how much the footprint sticks out of the support on each side [m], feasible where <= 0 (-1 for a grasp)."""
    footprint_m: Array | None
    """(K, 4, 4)."""


class Motion(NamedTuple):
    """World geometry of all slices; the slice axis is last."""

    a: Array
    """(3, 2 C, T) starts of the arms' capsules [m]."""
    b: Array
    """(3, 2 C, T) ends of the arms' capsules [m]."""
    hand_R: Array
    """(3, 3, 2, T) gripper axes."""
    hand_p: Array
    """(3, 2, T) gripper centres [m]."""
    screws: Array
    """(6, 14, T) joint twists."""


def arm_motion(q: Array, opening: Array) -> Motion:
    """Geometry of both arms along joint angles ``(T, 14)`` with finger openings ``(T, 2)``."""
    T = q.shape[0]
    angles = jnp.moveaxis(q.T.reshape(2, 7, T), 0, 1)
    rotations, positions = link_poses(angles)
    a, b = capsule_segments(rotations, positions, opening.T)
    hand_R, hand_p = hand_pose(rotations, positions)
    C2 = 2 * load_arm().number_of_capsules
    return Motion(
        a=jnp.swapaxes(a, 1, 2).reshape(3, C2, T),
        b=jnp.swapaxes(b, 1, 2).reshape(3, C2, T),
        hand_R=hand_R,
        hand_p=hand_p,
        screws=jnp.swapaxes(joint_screws(rotations, positions), 1, 2).reshape(6, 14, T),
    )


def per_slice(problem_row: Array, T: int) -> Array:
    """Rows of the K phases repeated for the slices of each phase: ``(K, ...)`` to ``(T, ...)``."""
    K = problem_row.shape[0]
    return jnp.repeat(problem_row, T // K, axis=0, total_repeat_length=T)


def evaluate(problem: Problem, x: Variables, with_jacobians: bool) -> Rows:
    """All rows at ``x``."""
    T, K = x.q.shape[0], x.m.shape[0]
    modes = mode_transforms(problem, x.m)
    attachment, attached_by = per_slice(problem.attachment[:-1], T), per_slice(problem.attached_by[:-1], T)
    motion = arm_motion(x.q, per_slice(problem.opening, T))

    def objects_of(attached: Array, by: Array, R: Array, p: Array) -> ObjectPoses:
        return object_poses(problem, modes, attached, by, R, p)

    objects = jax.vmap(objects_of, in_axes=(0, 0, -1, -1))(attachment, attached_by, motion.hand_R, motion.hand_p)
    distance_q = distance_m = None
    if with_jacobians:

        def contacts(a: Array, b: Array, screws: Array, poses: ObjectPoses, attached: Array) -> Contacts:
            return slice_contacts(a, b, screws, poses, problem.half, attached)

        rows = jax.vmap(contacts, in_axes=(-1, -1, -1, 0, 0))(motion.a, motion.b, motion.screws, objects, attachment)
        distance, distance_q, distance_m = rows
    else:

        def distances(a: Array, b: Array, poses: ObjectPoses, attached: Array) -> Array:
            return slice_distances(a, b, poses, problem.half, attached)[0]

        distance = jax.vmap(distances, in_axes=(-1, -1, 0, 0))(motion.a, motion.b, objects, attachment)

    last = slice(T // K - 1, None, T // K)
    residual, angle, switch_q, switch_m = jax.vmap(_switch_rows, in_axes=(None, None, 0, -1, -1, -1))(
        problem, modes, jnp.arange(K), motion.hand_R[..., last], motion.hand_p[..., last], motion.screws[..., last]
    )
    arguments = (x.m, problem.half[problem.switched_object], problem.support)
    placing = problem.is_grasp[:, None] <= 0
    footprint = jnp.where(placing, jax.vmap(_footprint)(*arguments), -1)
    footprint_m = None
    if with_jacobians:
        footprint_m = jnp.where(placing[..., None], jax.vmap(jax.jacfwd(_footprint))(*arguments), 0)
    else:
        switch_q = switch_m = None
    return Rows(
        distance, distance_q, distance_m, residual, angle, switch_q, switch_m, footprint, footprint_m
    )


def _switch_rows(
    problem: Problem, modes: ModeTransforms, k: Array, hand_R: Array, hand_p: Array, screws: Array
) -> tuple[Array, Array, Array, Array]:
    """Residual (6,), angle, and Jacobians (6, 14), (6, 2, 4) of the mode switch k."""
    switched = problem.switched_object[k]
    one = problem._replace(half=problem.half[switched][None], initial_pose=problem.initial_pose[switched][None])

    def pose(phase: Array) -> ObjectPoses:
        return object_poses(
            one, modes, problem.attachment[phase, switched][None], problem.attached_by[phase, switched][None], hand_R, hand_p
        )

    old, new = pose(k), pose(k + 1)
    w, v = half_rotation_vector(compose_rotations(old.R, transpose(new.R)))
    angle = rotation_angle(compose_rotations(old.R, transpose(new.R)))[0]
    residual = jnp.concatenate([old.p - new.p, 2 * v])[:, 0]

    def velocity(twist: Array, p: Array, sign: float) -> Array:
        """Columns (6, J) of the residual for twists (6, J): of the point p, and of 2 v by a turn on its left or right side."""
        angular, linear = twist[:3], twist[3:]
        at = jnp.broadcast_to(p, angular.shape)
        turned = w * angular + sign * cross(angular, jnp.broadcast_to(v, angular.shape))
        return jnp.concatenate([linear + cross(angular, at), turned])

    held_old, held_new = jnp.repeat(old.held[:, 0], 7), jnp.repeat(new.held[:, 0], 7)
    jacobian_q = held_old * velocity(screws, old.p, 1.0) - held_new * velocity(screws, new.p, -1.0)
    jacobian_m = jnp.stack(
        [velocity(old.twists[..., 0], old.p, 1.0), -velocity(new.twists[..., 0], new.p, -1.0)], axis=1
    )
    return residual, angle, jacobian_q, jacobian_m


def _footprint(m: Array, half: Array, support: Array) -> Array:
    """How far a placed prism's footprint sticks out of the support's four sides [m], ``(4,)``."""
    c, s = jnp.cos(support[2]), jnp.sin(support[2])
    dx, dy = m[0] - support[0], m[1] - support[1]
    along = jnp.stack([c * dx + s * dy, c * dy - s * dx])
    cos_yaw, sin_yaw = jnp.abs(jnp.cos(m[2] - support[2])), jnp.abs(jnp.sin(m[2] - support[2]))
    extent = jnp.stack([cos_yaw * half[0] + sin_yaw * half[1], sin_yaw * half[0] + cos_yaw * half[1]]) + half[3]
    return jnp.concatenate([along + extent - support[3:], extent - along - support[3:]])
