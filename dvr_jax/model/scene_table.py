"""What batches and greedy sequences need of many scenes, as one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, UInt8

from dvr_jax.logic import Grounding
from dvr_jax.model.encoding import ActionCodes, encode_actions, goal_tuple
from dvr_jax.model.images import ImageStack
from dvr_jax.operators import ground_scene
from dvr_jax.scene.types import Scene


@dataclass(frozen=True)
class SceneTable:
    """Images, actions and tuples of several scenes; scenes with fewer objects have padding behind their own."""

    height: Float[Array, "scenes pixels pixels"]
    """Heights of each scene, on the device."""

    masks: UInt8[Array, "scenes masks pixels pixels"]
    """Masks of each scene, on the device."""

    groundings: tuple[Grounding, ...]
    """Grounded actions of each scene."""

    symbol: Int[np.ndarray, "scenes actions"]
    """Symbol of each action, an index into `dvr_jax.model.encoding.SYMBOLS`."""

    normal: Float[np.ndarray, "scenes actions 2"]
    """Horizontal normal of the face that each action grasps, in the world."""

    tuple_index: Int[np.ndarray, "scenes actions"]
    """Tuple of each action, an index into `pairs` of its scene."""

    pairs: Int[np.ndarray, "scenes tuples 2"]
    """The two masks of each tuple, as indices into `masks` of its scene."""

    goal_tuple: Int[np.ndarray, " scenes"]
    """The goal's tuple of each scene."""


def build_scene_table(scenes: Sequence[Scene], images: ImageStack) -> SceneTable:
    """Ground and encode the actions of scenes.

    Args:
        scenes: The scenes.
        images: Their images, in the same order.

    Returns:
        The table.
    """
    groundings: list[Grounding] = []
    codes: list[ActionCodes] = []
    for scene in scenes:
        grounding = ground_scene(scene)
        groundings.append(grounding)
        codes.append(encode_actions(grounding, scene.objects))

    return SceneTable(
        height=jnp.asarray(images.height),
        masks=jnp.asarray(images.masks),
        groundings=tuple(groundings),
        symbol=_stack_padded([item.symbol for item in codes]),
        normal=_stack_padded([item.normal for item in codes]),
        tuple_index=_stack_padded([item.tuple_index for item in codes]),
        pairs=_stack_padded([item.pairs for item in codes]),
        goal_tuple=np.array([goal_tuple(scene) for scene in scenes], np.int32),
    )


def _stack_padded(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Stack arrays of different lengths, with zeros behind the shorter ones."""
    longest = max(len(array) for array in arrays)
    result = np.zeros((len(arrays), longest, *arrays[0].shape[1:]), arrays[0].dtype)
    for row, array in zip(result, arrays, strict=True):
        row[: len(array)] = array
    return result
