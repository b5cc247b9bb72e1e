"""Shapes of objects and fixed bodies, one file each."""

from dvr_jax.shapes.box import BOX
from dvr_jax.shapes.cylinder import CYLINDER
from dvr_jax.shapes.shape import FACES, Shape, Size, register_shape, shape_named, shape_names

__all__ = [
    "BOX",
    "CYLINDER",
    "FACES",
    "Shape",
    "Size",
    "register_shape",
    "shape_named",
    "shape_names",
]
