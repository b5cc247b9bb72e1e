"""States between the samples of a motion, where the check looks as well."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int

from dvr_jax.motion.motion import Motion

LARGEST_TURN = 0.2
"""Largest turn of a joint or an object between two states [rad]; within it an arc is hardly longer than its chord."""


def dense_states(
    model: mujoco.MjModel, motion: Motion
) -> tuple[Float[np.ndarray, "states nq"], Int[np.ndarray, " states"]]:
    """Insert states between the samples of a motion so that nothing turns by more than `LARGEST_TURN` at once.

    Args:
        model: Model of the scene.
        motion: The motion.

    Returns:
        The states in the order of time, and for each the sample that it is or leads to.
    """
    qpos = motion.qpos
    turn = np.abs(np.diff(qpos[:, _revolute_columns(model)], axis=0)).max(axis=1)
    for columns in _quaternion_columns(model):
        before = qpos[:-1, columns]
        after = qpos[1:, columns]
        # Half the angle between two orientations; a quaternion and its negative are the same orientation.
        cosine = np.clip(np.abs((before * after).sum(axis=1)), 0, 1)
        turn = np.maximum(turn, 2 * np.arccos(cosine))
    pieces = np.maximum(np.ceil(turn / LARGEST_TURN), 1).astype(np.int64)

    # Sort by the sample that a state leads to; a sample comes after the states that lead to it.
    between, step = states_between(model, qpos, pieces)
    sample = np.concatenate([np.arange(len(qpos)), step + 1])
    is_sample = np.repeat([1, 0], [len(qpos), len(step)])
    order = np.lexsort((is_sample, sample))
    return np.concatenate([qpos, between])[order], sample[order]


def states_between(
    model: mujoco.MjModel,
    states: Float[np.ndarray, "states nq"],
    pieces: Int[np.ndarray, " steps"],
) -> tuple[Float[np.ndarray, "inner nq"], Int[np.ndarray, " inner"]]:
    """Divide the steps between consecutive states evenly, on straight lines.

    Args:
        model: Model of the scene.
        states: States; there is one step less.
        pieces: Number of pieces of each step; 1 leaves a step as it is.

    Returns:
        The new states, whose quaternions are not normalized (MuJoCo does so), and the step of each.
    """
    step = np.repeat(np.arange(len(pieces)), pieces - 1)
    # Number of each new state within its step, from 1.
    first_of_step = np.cumsum(pieces - 1) - (pieces - 1)
    number = np.arange(len(step)) - np.repeat(first_of_step, pieces - 1) + 1
    fraction = (number / pieces[step])[:, None]

    before = states[step]
    after = states[step + 1].copy()
    for columns in _quaternion_columns(model):
        # Of the two quaternions of one orientation, take the nearer one.
        product = (before[:, columns] * after[:, columns]).sum(axis=1)
        after[:, columns] *= np.where(product < 0, -1.0, 1.0)[:, None]
    return before + fraction * (after - before), step


def _revolute_columns(model: mujoco.MjModel) -> Int[np.ndarray, " joints"]:
    """Places of all revolute joints in a state."""
    return np.asarray(model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE])


def _quaternion_columns(model: mujoco.MjModel) -> Int[np.ndarray, "objects 4"]:
    """Places of all objects' quaternions in a state."""
    first = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    # A free joint has three numbers for the position, then four for the quaternion.
    return np.asarray(first[:, None] + np.arange(3, 7))
