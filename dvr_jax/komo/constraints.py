"""All constraint rows of a batch of NLPs at given variables, in metres and radians, with structured Jacobians.

Every Jacobian is assembled from twists in closed form: a contact wrench times the joints' screws, never by
differentiating a whole slice (which costs 35 to 150 times the evaluation). Geometry is computed for all L = B T
slices of B problems side by side."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.distances import Prism
from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    add,
    compose,
    cross,
    half_rotation_vector,
    materialize,
    rotation_angle,
    scale,
    subtract,
    transpose,
)
from dvr_jax.komo.contacts import Distances, arm_signs, measure_distances, object_signs
from dvr_jax.komo.modes import Attachment, ObjectPoses, object_poses
from dvr_jax.komo.problem import Problem, Variables
from dvr_jax.robot.kinematics import capsule_segments, hand_pose, joint_screws, link_poses

PATH_SAMPLES = 3
"""Samples of a slice at which a path's distances are taken: at the slice and evenly between it and the one before, on
a straight line in joint space. With the slices alone a finger hops over an object's edge between two of them."""


def samples_of(T: int, K: int) -> int:
    """Samples of a slice: 1 for keyframes, which nothing connects."""
    return PATH_SAMPLES if T > K else 1


class Jacobians(NamedTuple):
    """Derivatives of the rows with respect to the joint angles *at the sample* and the mode parameters; see `Rows`."""

    arm_q: Array
    """(B, T', 14, Pa) of the arm rows' distances."""
    object_q: Array
    """(B, T', 14, Po) of the object rows' distances."""
    object_m: Array
    """(B, T', 4 N, Po) of the object rows' distances with respect to the mode parameters that each object depends
    on."""
    switch_q: Array
    """(B, K, 6, 14)."""
    switch_m: Array
    """(B, K, 6, 2, 4) with respect to the parameters of the old and of the new mode."""
    footprint_m: Array
    """(B, K, 4, 4)."""


class Rows(NamedTuple):
    """Constraint residuals of B problems."""

    distance: Array
    """(B, T', P) signed distances [m] at T' = T M samples, M of each slice, feasible where >= 0: arm rows, then
    object rows (`dvr_jax.komo.contacts`)."""
    switch: Array
    """(B, K, 6) pose of the switched object under the old mode minus that under the new: position [m], twice the
    quaternion's vector part (the rotation vector [rad] to third order)."""
    switch_angle: Array
    """(B, K) angle between the two orientations [rad]."""
    footprint: Array
    """(B, K, 4) by how much the footprint sticks out of the support on each side [m], feasible where <= 0 (-1 for a
    grasp)."""


def _phases_to_slices(value: Array, T: int) -> Array:
    """Per-phase values of objects or arms ``(B, K, N)`` for each slice: ``(N, B T)``."""
    B, K, N = value.shape
    return jnp.repeat(value.transpose(2, 0, 1), T // K, axis=2).reshape(N, B * T)


def _openings(problem: Problem, T: int, M: int) -> Array:
    """Finger openings of both arms at each of T samples, ``(2, B T)``: in the M samples of a switch's slice the wider
    of before and after it, so that fingers that open as they let go find room."""
    B, K, _ = problem.resting.shape
    before, after = problem.opening[:, :-1], problem.opening[:, 1:]
    switching = jnp.arange(T).reshape(K, T // K) % (T // K) >= T // K - M
    opening = jnp.where(switching[None, :, :, None], jnp.maximum(before, after)[:, :, None], before[:, :, None])
    return opening.reshape(B * T, 2).T


def _attach(problem: Problem, m: Array, kind: Array, by: Array, of: Array | None = None) -> Attachment:
    """Attachments ``(B, J, N')`` with the parameters of the actions ``by``; ``of`` selects objects where N' is not
    all of them."""

    def of_action(value: Array) -> Array:
        B = value.shape[0]
        return jnp.take_along_axis(value, by.reshape(B, -1), axis=1).reshape(by.shape)

    def of_object(value: Array) -> Array:
        return (
            jnp.broadcast_to(value[:, None], kind.shape)
            if of is None
            else jnp.take_along_axis(value, of[..., 0], axis=1)[..., None]
        )

    return Attachment(
        kind=kind,
        parameters=tuple(of_action(m[..., i]) for i in range(4)),
        face_yaw=of_action(problem.face_yaw),
        initial=tuple(of_object(problem.initial_pose[..., i]) for i in range(4)),
        half_height=of_object(problem.half[..., 2]),
    )


def sample_path(problem: Problem, q: Array, samples: int) -> Array:
    """Joint angles (B, T', 14) at the samples of the slices (B, T, 14)."""
    if samples == 1:
        return q
    before = jnp.concatenate([problem.home[:, None], q[:, :-1]], axis=1)
    share = jnp.arange(1, samples + 1, dtype=q.dtype)[:, None] / samples
    return (before[:, :, None] + share * (q - before)[:, :, None]).reshape(q.shape[0], -1, q.shape[2])


def evaluate(problem: Problem, x: Variables) -> tuple[Rows, Jacobians]:
    """All rows of B problems at ``x`` (every leaf has a leading axis B). Jacobians that are not used cost nothing
    under jit."""
    B, T = x.q.shape[:2]
    K, N = x.m.shape[1], problem.half.shape[1]
    M = samples_of(T, K)
    T = T * M
    L = B * T
    q = jnp.moveaxis(sample_path(problem, x.q, M).reshape(L, 2, 7), (0, 1, 2), (2, 1, 0))
    rotations, positions = link_poses(q)
    a, b = materialize(capsule_segments(rotations, positions, _openings(problem, T, M)))
    hand_R, hand_p = materialize(hand_pose(rotations, positions))
    screws = materialize(joint_screws(rotations, positions)).reshape(6, 14, L)

    attached = _attach(problem, x.m, problem.attachment[:, :-1], problem.attached_by[:, :-1])
    attached = materialize(jax.tree.map(lambda value: _phases_to_slices(value, T), attached))
    objects = materialize(object_poses(attached, hand_R, hand_p))
    half: Prism = tuple(jnp.repeat(problem.half[..., i].T, T, axis=1) for i in range(4))  # type: ignore[assignment]
    distances = materialize(measure_distances(a, b, objects, half, attached.kind))

    last = slice(T // K - 1, None, T // K)

    def at_switch(value: Array) -> Array:
        """(2, L) to (2, B K)."""
        return value.reshape(2, B, T)[:, :, last].reshape(2, B * K)

    R_switch: Rotation = tuple(tuple(at_switch(v) for v in column) for column in hand_R)  # type: ignore[assignment]
    p_switch: Vector = (at_switch(hand_p[0]), at_switch(hand_p[1]), at_switch(hand_p[2]))
    screws_switch = screws.reshape(6, 14, B, T)[..., last].reshape(6, 14, B * K)
    switch, angle, switch_q, switch_m = _switch_rows(problem, x.m, R_switch, p_switch, screws_switch)

    switched = jnp.take_along_axis(problem.half, problem.switched_object[..., None], axis=1)
    each_footprint = jax.vmap(jax.vmap(_footprint))
    each_slope = jax.vmap(jax.vmap(jax.jacfwd(_footprint)))
    placing = problem.is_grasp[..., None] <= 0
    footprint = jnp.where(placing, each_footprint(x.m, switched, problem.support), -1)
    footprint_m = jnp.where(placing[..., None], each_slope(x.m, switched, problem.support), 0)

    distance = jnp.concatenate([distances.arm, distances.object]).T.reshape(B, T, -1)
    arm_q, object_q, object_m = _distance_jacobians(distances, screws, objects, N)
    rows = Rows(distance, switch, angle, footprint)
    return materialize((rows, Jacobians(
        arm_q.reshape(B, T, 14, -1), object_q.reshape(B, T, 14, -1), object_m.reshape(B, T, 4 * N, -1),
        switch_q, switch_m, footprint_m,
    )))  # fmt: skip


def _times(columns: Array, wrench: Array) -> Array:
    """Wrenches ``(L, 6, P)`` times twist columns ``(L, 6, C)``: ``(L, C, P)``; a sum of six products fuses, a batched
    dot does not."""
    return sum(columns[:, i, :, None] * wrench[:, i, None, :] for i in range(6))  # type: ignore[return-value]


def _distance_jacobians(
    distances: Distances, screws: Array, objects: ObjectPoses, N: int
) -> tuple[Array, Array, Array]:
    dtype = screws.dtype
    S, arm_wrench, wrench = materialize(
        (screws.transpose(2, 0, 1), distances.arm_wrench.transpose(2, 0, 1), distances.object_wrench.transpose(2, 0, 1))
    )
    arm_q = jnp.asarray(arm_signs(), dtype) * _times(S, arm_wrench)
    joints, role = object_signs(N)
    L, _, _P = wrench.shape
    held = jnp.stack([jnp.where(h, 1, 0).astype(dtype).T for h in objects.held], axis=1)
    by_object = (held[..., None] * jnp.asarray(role, dtype)).sum(2)
    sign = materialize(jnp.asarray(joints, dtype) + jnp.repeat(by_object, 7, axis=1))
    object_q = sign * _times(S, wrench)
    columns = jnp.stack(
        [jnp.stack([jnp.concatenate([t[part][i] for t in objects.twists]) for i in range(3)]) for part in range(2)]
    )
    columns = materialize(columns.reshape(6, 4 * N, L).transpose(2, 0, 1))
    object_m = jnp.asarray(jnp.tile(role, (4, 1)), dtype) * _times(columns, wrench)
    return arm_q, object_q, object_m


def _switch_rows(
    problem: Problem, m: Array, hand_R: Rotation, hand_p: Vector, screws: Array
) -> tuple[Array, Array, Array, Array]:
    """Residuals (B, K, 6), angles (B, K), Jacobians (B, K, 6, 14) and (B, K, 6, 2, 4) of the mode switches."""
    B, K = m.shape[:2]
    of = problem.switched_object[..., None]

    def pose(phases: slice) -> ObjectPoses:
        kind = jnp.take_along_axis(problem.attachment[:, phases], of, axis=2)
        by = jnp.take_along_axis(problem.attached_by[:, phases], of, axis=2)
        attached = jax.tree.map(lambda v: v.reshape(1, B * K), _attach(problem, m, kind, by, of))
        return object_poses(attached, hand_R, hand_p)

    old, new = pose(slice(0, K)), pose(slice(1, K + 1))
    old, new, screws = materialize((old, new, screws))
    difference = materialize(compose(old.R, transpose(new.R)))
    w, v = half_rotation_vector(difference)
    residual = jnp.stack([*subtract(old.p, new.p), *scale(2.0, v)])

    def velocity(angular: Vector, linear: Vector, p: Vector, sign: float) -> Array:
        """(6, J, B K) change of the residual with a twist: of the point p, and of 2 v by a turn on its left or right
        side."""
        turned = add(scale(w, angular), scale(sign, cross(angular, v)))
        return jnp.stack([*add(linear, cross(angular, p)), *turned])

    axes, at_origin = (screws[0], screws[1], screws[2]), (screws[3], screws[4], screws[5])
    held_old, held_new = (jnp.repeat(jnp.concatenate(pose.held).astype(w.dtype), 7, axis=0) for pose in (old, new))
    switch_q = held_old * velocity(axes, at_origin, old.p, 1.0) - held_new * velocity(axes, at_origin, new.p, -1.0)
    switch_m = jnp.stack(
        [
            sign * jnp.concatenate([velocity(angular, linear, pose.p, sign) for angular, linear in pose.twists], axis=1)
            for pose, sign in ((old, 1.0), (new, -1.0))
        ],
        axis=1,
    )
    return (
        residual.reshape(6, B, K).transpose(1, 2, 0),
        rotation_angle(difference).reshape(B, K),
        switch_q.reshape(6, 14, B, K).transpose(2, 3, 0, 1),
        switch_m.reshape(6, 2, 4, B, K).transpose(3, 4, 0, 1, 2),
    )


def _footprint(m: Array, half: Array, support: Array) -> Array:
    """How far a placed prism's footprint sticks out of the support's four sides [m], ``(4,)``."""
    c, s = jnp.cos(support[2]), jnp.sin(support[2])
    dx, dy = m[0] - support[0], m[1] - support[1]
    along = jnp.stack([c * dx + s * dy, c * dy - s * dx])
    cos_yaw, sin_yaw = jnp.abs(jnp.cos(m[2] - support[2])), jnp.abs(jnp.sin(m[2] - support[2]))
    extent = jnp.stack([cos_yaw * half[0] + sin_yaw * half[1], sin_yaw * half[0] + cos_yaw * half[1]]) + half[3]
    return jnp.concatenate([along + extent - support[3:], extent - along - support[3:]])
