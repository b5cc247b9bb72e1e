"""Lay out a batch of problems at given variables as slices, the configurations at which distances are computed.

Here every array of a problem and of its variables has a leading axis B. Each problem contributes T' = T M
configurations, M samples in the interval before each of its T slices, and each configuration counts as one slice
(`dvr_jax.nlp.slices`). There are L = B T' slices in total.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from dvr_jax.geometry.arrays import Array
from dvr_jax.modes.mode import Attachment
from dvr_jax.nlp.problem import Problem, Variables
from dvr_jax.nlp.slices import Slices


def lay_out(problems: Problem, x: Variables) -> Slices:
    """Lay out the samples of B problems as L slices.

    Args:
        problems: A batch of problems.
        x: Their variables.
    """
    B, T, M = problems.sample_fraction.shape
    arms = problems.arm_at_rest.shape[-1]
    samples = T * M
    attached = attachments(
        problems,
        x.m,
        problems.mode_kind[:, :-1],
        problems.mode_parent[:, :-1],
        problems.mode_action[:, :-1],
    )
    q = sample_path(problems, x.q).reshape(B * samples, arms, -1)

    # Axes first, then components, as everywhere in vectorized code.
    axes = jnp.asarray(problems.base_rotation).transpose(3, 2, 1, 0)
    origins = jnp.asarray(problems.base_position).transpose(2, 1, 0)
    prism = jnp.concatenate([problems.prism, problems.fixed_prism], axis=1)

    return Slices(
        q=jnp.moveaxis(q, (0, 1, 2), (2, 1, 0)),
        finger_opening=_finger_openings(problems, samples, M),
        base_poses=_repeat(jnp.concatenate([axes, origins[None]]), samples),
        attached=jax.tree.map(lambda value: _phases_to_slices(value, samples), attached),
        prism=_repeat(prism.transpose(2, 1, 0), samples),
        clearance=jnp.repeat(problems.clearance, M, axis=1).reshape(B * samples, -1).T,
        fixed_pose=_repeat(jnp.asarray(problems.fixed_pose).transpose(2, 1, 0), samples),
    )


def sample_path(
    problems: Problem, q: Float[Array, "batch slices joints"]
) -> Float[Array, "batch samples joints"]:
    """Compute the joint angles at all samples [rad].

    A sample at the fraction s of the interval between two slices is ``(1 - s) q_before + s q + offset``.

    Args:
        problems: A batch of problems.
        q: Joint angles at the slices [rad].
    """
    if problems.sample_fraction.shape[-1] == 1:
        return q
    before = jnp.concatenate([problems.home[:, None], q[:, :-1]], axis=1)
    line = before[:, :, None] + problems.sample_fraction[..., None] * (q - before)[:, :, None]
    return (line + problems.sample_offset).reshape(q.shape[0], -1, q.shape[2])


def attachments(
    problems: Problem,
    m: Float[Array, "batch phases 4"],
    kind: Int[Array, "batch states chosen"],
    parent: Int[Array, "batch states chosen"],
    action: Int[Array, "batch states chosen"],
    item: Int[Array, "batch states"] | None = None,
) -> Attachment:
    """Return how objects are attached in some states of each problem.

    Args:
        problems: A batch of problems.
        m: Mode parameters.
        kind: `ModeKind` of the objects.
        parent: Arms that hold them.
        action: Actions whose parameters they are attached by.
        item: The one object of each state, where the last axis of the others has length one; all objects by default.
    """

    def of_action(value: Array) -> Array:
        """(..., B, K) to (..., B, J, N')."""
        index = jnp.broadcast_to(
            action.reshape(action.shape[0], -1), (*value.shape[:-1], action[0].size)
        )
        return jnp.take_along_axis(value, index, axis=-1).reshape(
            *value.shape[:-1], *action.shape[1:]
        )

    def of_object(value: Array) -> Array:
        """(..., B, N) to (..., B, J, N')."""
        if item is None:
            return jnp.broadcast_to(value[..., None, :], (*value.shape[:-1], *kind.shape[1:]))
        index = jnp.broadcast_to(item, (*value.shape[:-1], item.shape[1]))
        return jnp.take_along_axis(value, index, axis=-1)[..., None]

    return Attachment(
        kind=kind,
        parent=parent,
        parameters=of_action(jnp.moveaxis(m, -1, 0)),
        closing_yaw=of_action(jnp.asarray(problems.closing_yaw)),
        initial_pose=of_object(jnp.moveaxis(problems.initial_pose, -1, 0)),
        half_height=of_object(jnp.asarray(problems.prism)[..., 2]),
    )


def _repeat(value: Array, samples: int) -> Array:
    """(..., B) to (..., B T')."""
    return jnp.repeat(value, samples, axis=-1)


def _phases_to_slices(value: Array, samples: int) -> Array:
    """Values of objects in each phase (..., B, K, N), for each slice (..., N, B T')."""
    *_, B, K, N = value.shape
    repeated = jnp.repeat(jnp.moveaxis(value, -1, -3), samples // K, axis=-1)
    return repeated.reshape(*value.shape[:-3], N, B * samples)


def _finger_openings(problems: Problem, samples: int, M: int) -> Float[Array, "arms slices"]:
    """Return the finger openings at each sample.

    At the M samples before a switch, the larger one of the openings before and after the switch is used, so that there
    is room for fingers that open in this interval.
    """
    B, K, arms = problems.arm_at_rest.shape
    before = problems.finger_opening[:, :-1]
    after = problems.finger_opening[:, 1:]
    steps = samples // K
    is_switch = jnp.arange(samples).reshape(K, steps) % steps >= steps - M
    opening = jnp.where(
        is_switch[None, :, :, None], jnp.maximum(before, after)[:, :, None], before[:, :, None]
    )
    return opening.reshape(B * samples, arms).T
