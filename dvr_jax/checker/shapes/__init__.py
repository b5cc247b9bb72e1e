"""What the check itself knows of the shapes of objects, one file each."""

from dvr_jax.checker.shapes.box import BOX_CHECK
from dvr_jax.checker.shapes.cylinder import CYLINDER_CHECK
from dvr_jax.checker.shapes.shape import (
    FACE_NORMALS,
    Outline,
    ShapeCheck,
    register_shape_check,
    shape_check_named,
)

__all__ = [
    "BOX_CHECK",
    "CYLINDER_CHECK",
    "FACE_NORMALS",
    "Outline",
    "ShapeCheck",
    "register_shape_check",
    "shape_check_named",
]
