"""A batch of labelled sequences as arrays.

A batch holds each distinct action-object image once; its sequences refer to the images by index.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from dvr_jax.dataset.examples import Examples
from dvr_jax.model.encoding import MIRRORED
from dvr_jax.model.kind import Kind
from dvr_jax.model.scene_table import SceneTable

VIEW_MULTIPLE = 12
"""The views of a batch are padded to a multiple of this, so that few shapes are compiled."""

IMAGE_MULTIPLE = 16
"""The images of a batch are padded to a multiple of this, so that few shapes are compiled."""


class Batch(NamedTuple):
    """Sequences of actions, the views of scenes that they belong to, and the images that they refer to."""

    view_scene: Int[np.ndarray, " views"]
    """Scene of each view."""

    view_mirrored: Bool[np.ndarray, "views 2"]
    """Whether the x and the y of each view are reversed."""

    image_view: Int[np.ndarray, " images"]
    """View of each image."""

    image_pair: Int[np.ndarray, "images 2"]
    """The two masks of each image, as indices into the masks of its scene."""

    goal_image: Int[np.ndarray, " batch"]
    """Image of the goal's tuple of each sequence."""

    symbol: Int[np.ndarray, "batch steps"]
    """Symbol of each action."""

    normal: Float[np.ndarray, "batch steps 2"]
    """Horizontal normal of the face that each action grasps, in the view."""

    image: Int[np.ndarray, "batch steps"]
    """Image of each action's tuple."""

    target: Float[np.ndarray, "batch steps"]
    """Target of each action, 0 or 1."""

    weight: Float[np.ndarray, "batch steps"]
    """How much each action counts in the loss.

    For a dvr network this is the weight of its target in the examples. For a classifier it is 1 where the verdict on
    the sequence so far is known: at all actions of a feasible sequence, and of an infeasible one from that action on
    which refutes it. It is 0 behind the end of a sequence.
    """


class _DistinctImages(NamedTuple):
    """The distinct views and images of a batch, and which of them each sequence shows."""

    view_scene: Int[np.ndarray, " views"]
    view_of_sequence: Int[np.ndarray, " batch"]
    image_view: Int[np.ndarray, " images"]
    image_tuple: Int[np.ndarray, " images"]
    image_of_step: Int[np.ndarray, "batch steps_and_goal"]
    """The image of each action's tuple, and of the goal's."""


def assemble_batch(
    examples: Examples,
    table: SceneTable,
    sequences: Int[np.ndarray, " batch"],
    kind: Kind,
    mirrored: Bool[np.ndarray, "scenes 2"] | None = None,
) -> Batch:
    """Look up everything that a batch holds of its sequences.

    Args:
        examples: Labelled sequences.
        table: The scenes of the examples.
        sequences: Indices of the sequences of the batch.
        kind: Kind of the network, which decides what the targets are.
        mirrored: Whether the x and the y of each scene are reversed; None reverses nothing.

    Returns:
        The batch.
    """
    scene = examples.scene[sequences]
    actions = examples.actions[sequences]
    inside = np.arange(actions.shape[1]) < examples.length[sequences][:, None]
    actions = np.where(inside, actions, 0)
    shown = _distinct_images(table, scene, actions, inside)

    # Mirrored views have mirrored symbols and normals.
    view_mirrored = np.zeros((len(shown.view_scene), 2), np.bool_)
    if mirrored is not None:
        view_mirrored = mirrored[shown.view_scene]
    reversed_axes = view_mirrored[shown.view_of_sequence][:, None]
    in_x = reversed_axes[..., 0].astype(int)
    in_y = reversed_axes[..., 1].astype(int)
    symbol = table.symbol[scene[:, None], actions]
    normal = table.normal[scene[:, None], actions]

    target, weight = _targets(examples, sequences, kind, inside)
    return Batch(
        view_scene=shown.view_scene.astype(np.int32),
        view_mirrored=view_mirrored,
        image_view=shown.image_view.astype(np.int32),
        image_pair=table.pairs[shown.view_scene[shown.image_view], shown.image_tuple],
        goal_image=shown.image_of_step[:, -1],
        symbol=MIRRORED[in_x, in_y, symbol],
        normal=np.where(reversed_axes, -normal, normal),
        image=shown.image_of_step[:, :-1],
        target=np.where(weight, target, 0).astype(np.float32),
        weight=weight.astype(np.float32),
    )


def _distinct_images(
    table: SceneTable,
    scene: Int[np.ndarray, " batch"],
    actions: Int[np.ndarray, "batch steps"],
    inside: Bool[np.ndarray, "batch steps"],
) -> _DistinctImages:
    """Number the distinct views and images of a batch, padded to few different numbers of them."""
    # Behind its end a sequence repeats the goal's tuple, for which no further image is encoded.
    goal_tuple = table.goal_tuple[scene][:, None]
    tuples = np.where(inside, table.tuple_index[scene[:, None], actions], goal_tuple)
    tuples = np.concatenate([tuples, goal_tuple], axis=1)

    view_scene, view_of_sequence = np.unique(scene, return_inverse=True)
    tuples_of_scene = table.pairs.shape[1]
    image_code = view_of_sequence[:, None] * tuples_of_scene + tuples
    distinct, image_of_step = np.unique(image_code, return_inverse=True)
    padded = _pad_to_multiple(distinct, IMAGE_MULTIPLE)
    image_view, image_tuple = np.divmod(padded, tuples_of_scene)

    return _DistinctImages(
        view_scene=_pad_to_multiple(view_scene, VIEW_MULTIPLE),
        view_of_sequence=view_of_sequence,
        image_view=image_view,
        image_tuple=image_tuple,
        image_of_step=image_of_step.reshape(tuples.shape).astype(np.int32),
    )


def _targets(
    examples: Examples,
    sequences: Int[np.ndarray, " batch"],
    kind: Kind,
    inside: Bool[np.ndarray, "batch steps"],
) -> tuple[np.ndarray, np.ndarray]:
    """Return target and weight of each action, as `Batch` defines them; a target without weight is arbitrary."""
    if kind == "dvr":
        return examples.targets[sequences], examples.weight[sequences]

    target = np.broadcast_to(examples.feasible[sequences][:, None], inside.shape)
    refuting_step = examples.refuted_after[sequences][:, None] - 1
    return target, inside & (np.arange(inside.shape[1]) >= refuting_step)


def _pad_to_multiple(
    values: Int[np.ndarray, " values"],
    multiple: int,
) -> Int[np.ndarray, " padded"]:
    """Return the values, with the first one repeated behind them until their number is a multiple."""
    missing = -len(values) % multiple
    return np.append(values, np.repeat(values[:1], missing))
