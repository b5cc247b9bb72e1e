"""What a shape is: everything that the rest of the package needs to know about boxes, cylinders and their like.

A shape is a value. Adding one means writing one file with a `Shape` and registering it; scene files, the MuJoCo model,
grasps, placements and pictures then know it. Random scenes keep to boxes and cylinders.

All shapes are *prisms* to the optimizer: half extents ``(hx, hy, hz)`` of a box whose horizontal outline is rounded
outwards by ``r``. A box has ``r = 0``, an upright cylinder ``hx = hy = 0``; see `dvr_jax.geometry.prisms`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Footprint

Size = tuple[float, ...]
"""The numbers that describe one body of a shape [m], in the order of `Shape.size_names`."""

FACES = ("+x", "+y", "-x", "-y")
"""Side faces of an object by their outward normal in its own frame; the paper's eta counts them, 0 to 3."""


@dataclass(frozen=True)
class Shape:
    """One kind of body: how its size is given and what follows from it. All lengths are in meters."""

    name: str
    """Name in scene files."""

    size_names: tuple[str, ...]
    """What each number of a size means, as in ("x extent", "y extent", "z extent")."""

    half_extents: Callable[[Size], tuple[float, float, float]]
    """Half extents of the bounding box in the body's own frame."""

    prism: Callable[[Size], tuple[float, float, float, float]]
    """The numbers (hx, hy, hz, r) by which the optimizer knows the body."""

    footprint: Callable[[Size, tuple[float, float], float], Footprint]
    """What an upright body of this size, position (x, y) and yaw [rad] covers of the plane that it stands on."""

    grip_width: Callable[[Size, str], float]
    """Extent along the closing axis of a gripper that grasps the body at a face."""

    tangent_half_extent: Callable[[Size, str], float]
    """Half extent of the body along the horizontal tangent of a face."""

    has_faces: bool
    """Whether the four faces can be told apart. Where they cannot, a grasp at +x has a free yaw and stands for all
    four."""

    mujoco_geom: Callable[[Size], tuple[str, list[float]]]
    """MuJoCo's name of the geom type ("box", "cylinder", ...) and its size."""

    def face_index(self, face: str) -> int:
        """Return the number of a face, the paper's eta."""
        return FACES.index(face)


_SHAPES: dict[str, Shape] = {}


def register_shape(shape: Shape) -> Shape:
    """Make a shape known by its name, so that scenes can use it; returns the shape."""
    _SHAPES[shape.name] = shape
    return shape


def shape_named(name: str) -> Shape:
    """Return the registered shape of this name.

    Raises:
        DvrError: There is none; the message lists the names that are known.
    """
    if name not in _SHAPES:
        raise DvrError(f"there is no shape {name!r}; valid: {', '.join(map(repr, shape_names()))}.")
    return _SHAPES[name]


def shape_names() -> tuple[str, ...]:
    """Names of all registered shapes."""
    return tuple(_SHAPES)
