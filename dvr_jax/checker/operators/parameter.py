"""The parameters of the operators: what an action's arguments mean to the check, and which values are valid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dvr_jax.checker.shapes import FACE_NORMALS
from dvr_jax.scene.start import objects_as_supports
from dvr_jax.scene.types import Scene

Arguments = Mapping[str, str]
"""The arguments of an action by the names of its operator's parameters, as in {"arm": "left", "object": "yellow"}."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an operator."""

    name: str
    """Name, unique in its operator."""

    plural: str
    """Plural of the name, for messages."""

    values: Callable[[Scene], tuple[str, ...]]
    """Valid arguments in a scene."""


def _arm_names(scene: Scene) -> tuple[str, ...]:
    return scene.workcell.arm_names


def _object_names(scene: Scene) -> tuple[str, ...]:
    return scene.object_names


def _faces(scene: Scene) -> tuple[str, ...]:
    return tuple(FACE_NORMALS)


def _support_names(scene: Scene) -> tuple[str, ...]:
    return (*scene.supports(), *objects_as_supports(scene))


ARM = Parameter("arm", "arms", _arm_names)
"""The arm that acts."""

OBJECT = Parameter("object", "objects", _object_names)
"""The object whose attachment changes."""

FACE = Parameter("face", "faces", _faces)
"""The face at which a gripper grasps."""

SUPPORT = Parameter("support", "supports", _support_names)
"""The support on which an object is put down."""
