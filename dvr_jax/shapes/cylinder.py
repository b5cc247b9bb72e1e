"""The upright cylinder: size = (radius, height) [m]."""

from __future__ import annotations

from dvr_jax.geometry.footprint import Circle, Footprint
from dvr_jax.shapes.shape import Shape, Size, register_shape


def _half_extents(size: Size) -> tuple[float, float, float]:
    return (size[0], size[0], size[1] / 2)


def _prism(size: Size) -> tuple[float, float, float, float]:
    return (0.0, 0.0, size[1] / 2, size[0])


def _footprint(size: Size, position: tuple[float, float], yaw: float) -> Footprint:
    return Circle(position, size[0])


def _grip_width(size: Size, face: str) -> float:
    return 2 * size[0]


def _tangent_half_extent(size: Size, face: str) -> float:
    return size[0]


def _mujoco_geom(size: Size) -> tuple[str, list[float]]:
    return "cylinder", [size[0], size[1] / 2, 0.0]


CYLINDER = register_shape(
    Shape(
        name="cylinder",
        size_names=("radius", "height"),
        half_extents=_half_extents,
        prism=_prism,
        footprint=_footprint,
        grip_width=_grip_width,
        tangent_half_extent=_tangent_half_extent,
        has_faces=False,
        mujoco_geom=_mujoco_geom,
    )
)
"""An upright cylinder."""
