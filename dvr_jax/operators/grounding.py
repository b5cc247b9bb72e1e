"""Grounding a scene: all actions of a tuple of operators over its arms and objects."""

from __future__ import annotations

from collections.abc import Sequence

from dvr_jax.logic import Grounding, ground_task
from dvr_jax.operators.grasp import GRASP
from dvr_jax.operators.operator import Operator
from dvr_jax.operators.place import PLACE
from dvr_jax.scene.start import symbolic_task
from dvr_jax.scene.types import Scene

OPERATORS: tuple[Operator, ...] = (GRASP, PLACE)
"""The operators of the paper."""


def ground_scene(scene: Scene, operators: Sequence[Operator] = OPERATORS) -> Grounding:
    """Ground all actions over the arms and objects of a scene, from its initial state to its goal.

    Args:
        scene: A valid scene.
        operators: The operators that are known.

    Returns:
        The grounding; scenes with the same names share it.
    """
    return ground_task(symbolic_task(scene), tuple(operator.pddl for operator in operators))
