"""All constraint rows of a batch of NLPs at given variables, in metres and radians.

Distances are taken slice by slice (`dvr_jax.nlp.slices`); mode switches and footprints concern a problem's K switch
slices only and are computed here, with their Jacobians in closed form."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from dvr_jax.geometry.vectors import (
    Rotation,
    Vector,
    compose,
    cross,
    half_rotation_vector,
    materialize,
    rotation_angle,
    transpose,
)
from dvr_jax.modes.poses import Attachment, object_poses
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import Slices


class ConstraintValues(NamedTuple):
    """Constraint residuals of B problems."""

    distance: Array
    """(B, T', P) signed distances [m] at T' = T M samples, M of each slice, feasible where >= 0."""
    switch: Array
    """(B, K, 6) pose of the switched object under the old mode minus that under the new: position [m], twice the
    quaternion's vector part (the rotation vector [rad] to third order)."""
    switch_angle: Array
    """(B, K) angle between the two orientations [rad]."""
    footprint: Array
    """(B, K, 4) by how much the footprint sticks out of the support on each side [m], feasible where <= 0 (-1 for a
    grasp)."""


class Jacobians(NamedTuple):
    """Derivatives of switches and footprints."""

    switch_q: Array
    """(B, K, 6, 14)."""
    switch_m: Array
    """(B, K, 6, 2, 4) with respect to the parameters of the old and of the new mode."""
    footprint_m: Array
    """(B, K, 4, 4)."""


def _phases_to_slices(value: Array, T: int) -> Array:
    """Per-phase values of objects ``(..., B, K, N)`` for each slice: ``(..., N, B T)``."""
    *_, B, K, N = value.shape
    return jnp.repeat(jnp.moveaxis(value, -1, -3), T // K, axis=-1).reshape(*value.shape[:-3], N, B * T)


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
        """(..., B, K) to (..., B, J, N')."""
        index = jnp.broadcast_to(by.reshape(by.shape[0], -1), (*value.shape[:-1], by[0].size))
        return jnp.take_along_axis(value, index, axis=-1).reshape(*value.shape[:-1], *by.shape[1:])

    def of_object(value: Array) -> Array:
        """(..., B, N) to (..., B, J, N')."""
        if of is None:
            return jnp.broadcast_to(value[..., None, :], (*value.shape[:-1], *kind.shape[1:]))
        index = jnp.broadcast_to(of[..., 0], (*value.shape[:-1], of.shape[1]))
        return jnp.take_along_axis(value, index, axis=-1)[..., None]

    return Attachment(
        kind=kind,
        parameters=of_action(jnp.moveaxis(m, -1, 0)),
        face_yaw=of_action(problem.face_yaw),
        initial=of_object(jnp.moveaxis(problem.initial_pose, -1, 0)),
        half_height=of_object(problem.half[..., 2]),
    )


def sample_path(problem: Problem, q: Array) -> Array:
    """Joint angles (B, T', 14) at the samples of the slices (B, T, 14)."""
    if problem.share.shape[-1] == 1:
        return q
    before = jnp.concatenate([problem.home[:, None], q[:, :-1]], axis=1)
    line = before[:, :, None] + problem.share[..., None] * (q - before)[:, :, None]
    return (line + problem.offset).reshape(q.shape[0], -1, q.shape[2])


def lay_out(problem: Problem, x: Variables) -> Slices:
    """The samples of B problems (every leaf has a leading axis B) as L = B T' slices."""
    B, T, M = problem.share.shape
    T *= M
    attached = _attach(problem, x.m, problem.attachment[:, :-1], problem.attached_by[:, :-1])
    return Slices(
        q=jnp.moveaxis(sample_path(problem, x.q).reshape(B * T, 2, 7), (0, 1, 2), (2, 1, 0)),
        opening=_openings(problem, T, M),
        attached=jax.tree.map(lambda value: _phases_to_slices(value, T), attached),
        half=jnp.repeat(problem.half.transpose(2, 1, 0), T, axis=2),
    )


def collect(
    problem: Problem, x: Variables, distance: Array, hand_R: Rotation, hand_p: Vector, screws: Array
) -> tuple[ConstraintValues, Jacobians]:
    """All rows of B problems from what `measure` says of their L slices."""
    B, K = x.m.shape[:2]
    distance = distance.reshape(B, -1, distance.shape[-1])
    T = distance.shape[1]

    def at_switch(value: Array) -> Array:
        """(..., L) to (..., B K)."""
        return value.reshape(*value.shape[:-1], B, T)[..., T // K - 1 :: T // K].reshape(*value.shape[:-1], B * K)

    switch, angle, switch_q, switch_m = _switch_rows(
        problem, x.m, *(at_switch(value) for value in (hand_R, hand_p, screws))
    )
    footprint, footprint_m = _footprints(problem, x.m)
    return ConstraintValues(distance, switch, angle, footprint), Jacobians(switch_q, switch_m, footprint_m)


def _switch_rows(
    problem: Problem, m: Array, hand_R: Rotation, hand_p: Vector, screws: Array
) -> tuple[Array, Array, Array, Array]:
    """Residuals (B, K, 6), angles (B, K), Jacobians (B, K, 6, 14) and (B, K, 6, 2, 4) of the mode switches."""
    B, K = m.shape[:2]
    of = problem.switched_object[..., None]

    def attach(phases: slice) -> Attachment:
        kind = jnp.take_along_axis(problem.attachment[:, phases], of, axis=2)
        by = jnp.take_along_axis(problem.attached_by[:, phases], of, axis=2)
        return jax.tree.map(lambda v: v.reshape(*v.shape[:-3], 1, B * K), _attach(problem, m, kind, by, of))

    # The object before and after the switch, as two objects of one slice.
    old, new = attach(slice(0, K)), attach(slice(1, K + 1))
    both = materialize(jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=-2), old, new))
    objects = materialize(object_poses(both, hand_R, hand_p))
    difference = materialize(compose(objects.R[:, :, 0], transpose(objects.R[:, :, 1])))
    w, v = materialize(half_rotation_vector(difference))
    residual = jnp.concatenate([objects.p[:, 0] - objects.p[:, 1], 2 * v])

    # The residual's change with a twist of the old pose and of the new one: of the point p, and of 2 v by a turn on
    # its left or right side.
    held = jnp.repeat(objects.held.astype(m.dtype), screws.shape[1] // 2, axis=0)
    columns = jnp.concatenate([screws[:, :, None] * held, objects.twists], axis=1)
    columns = materialize(columns)
    angular, linear = columns[:3], columns[3:]
    side = jnp.asarray([1.0, -1.0], m.dtype)[:, None]
    moved = linear + cross(angular, objects.p[:, None])
    turned = w * angular + side * cross(angular, v[:, None, None])
    change = materialize(side * jnp.concatenate([moved, turned]))
    return (
        residual.reshape(6, B, K).transpose(1, 2, 0),
        rotation_angle(difference).reshape(B, K),
        change[:, :14].sum(2).reshape(6, 14, B, K).transpose(2, 3, 0, 1),
        change[:, 14:].reshape(6, 4, 2, B, K).transpose(3, 4, 0, 2, 1),
    )


def _footprints(problem: Problem, m: Array) -> tuple[Array, Array]:
    """How far placed prisms' footprints stick out of their supports' four sides [m], ``(B, K, 4)``, and the
    derivatives ``(B, K, 4, 4)``."""
    half = jnp.take_along_axis(problem.half, problem.switched_object[..., None], axis=1)
    support = problem.support
    c, s = jnp.cos(support[..., 2]), jnp.sin(support[..., 2])
    dx, dy = m[..., 0] - support[..., 0], m[..., 1] - support[..., 1]
    along = jnp.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)
    turn = m[..., 2] - support[..., 2]
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    side, front = half[..., 0], half[..., 1]
    extent = jnp.stack(
        [jnp.abs(cosine) * side + jnp.abs(sine) * front, jnp.abs(sine) * side + jnp.abs(cosine) * front], axis=-1
    )
    extent += half[..., 3, None]
    zero = jnp.zeros_like(c)
    # |cos|' = -sin sign(cos), |sin|' = cos sign(sin).
    fall, rise = -sine * jnp.sign(cosine), cosine * jnp.sign(sine)
    widening = jnp.stack([fall * side + rise * front, rise * side + fall * front], axis=-1)
    along_m = jnp.stack([jnp.stack([c, s], axis=-1), jnp.stack([-s, c], axis=-1)], axis=-2)
    widening_m = jnp.stack([widening, jnp.stack([zero, zero], axis=-1)], axis=-1)
    value = jnp.concatenate([along + extent, extent - along], axis=-1) - jnp.tile(support[..., 3:], 2)
    slope = jnp.concatenate(
        [jnp.concatenate([along_m, -along_m], axis=-2), jnp.concatenate([widening_m, widening_m], axis=-2)], axis=-1
    )
    placing = problem.is_grasp[..., None] <= 0
    return jnp.where(placing, value, -1), jnp.where(placing[..., None], slope, 0)
