"""The box: size = full extents (x, y, z) in its own frame [m]."""

from __future__ import annotations

from dvr_jax.geometry.footprint import Footprint, Rectangle
from dvr_jax.shapes.shape import FACES, Shape, Size, register_shape


def _half_extents(size: Size) -> tuple[float, float, float]:
    return (size[0] / 2, size[1] / 2, size[2] / 2)


def _prism(size: Size) -> tuple[float, float, float, float]:
    return (*_half_extents(size), 0.0)


def _footprint(size: Size, position: tuple[float, float], yaw: float) -> Footprint:
    return Rectangle(position, (size[0] / 2, size[1] / 2), yaw)


def _grip_width(size: Size, face: str) -> float:
    """The faces +x and -x are closed on along x, the other two along y."""
    return size[FACES.index(face) % 2]


def _tangent_half_extent(size: Size, face: str) -> float:
    """The faces +x and -x extend along y, the other two along x."""
    return size[1 - FACES.index(face) % 2] / 2


def _mujoco_geom(size: Size) -> tuple[str, list[float]]:
    return "box", list(_half_extents(size))


BOX = register_shape(
    Shape(
        name="box",
        size_names=("x extent", "y extent", "z extent"),
        half_extents=_half_extents,
        prism=_prism,
        footprint=_footprint,
        grip_width=_grip_width,
        tangent_half_extent=_tangent_half_extent,
        has_faces=True,
        mujoco_geom=_mujoco_geom,
    )
)
"""An upright box."""
