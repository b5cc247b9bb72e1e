"""Every shape against the outline of its footprint and against MuJoCo's geom."""

import math

import mujoco
import numpy as np
import pytest

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import Circle, Rectangle, signed_distance
from dvr_jax.shapes import BOX, CYLINDER, FACES, Shape, shape_named, shape_names

SIZES = {"box": (0.06, 0.2, 0.11), "cylinder": (0.035, 0.14)}


@pytest.fixture(params=shape_names())
def shape(request: pytest.FixtureRequest) -> Shape:
    return shape_named(request.param)


def extent(shape: Shape, direction: tuple[float, float]) -> float:
    """Extent of the footprint along a direction, from the distances of two far walls."""
    angle = math.atan2(direction[1], direction[0])
    footprint = shape.footprint(SIZES[shape.name], (0.0, 0.0), 0.0)
    total = 0.0
    for side in (-1, 1):
        wall = Rectangle((side * direction[0] * 2, side * direction[1] * 2), (0.5, 5.0), angle)
        total += 1.5 - signed_distance(footprint, wall)
    return total


def test_widths_at_the_faces_are_those_of_the_footprint(shape: Shape) -> None:
    normals = {"+x": (1.0, 0.0), "+y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}
    assert tuple(normals) == FACES
    for face, (x, y) in normals.items():
        size = SIZES[shape.name]
        assert shape.grip_width(size, face) == pytest.approx(extent(shape, (x, y)))
        assert shape.tangent_half_extent(size, face) == pytest.approx(extent(shape, (-y, x)) / 2)
        assert FACES[shape.face_index(face)] == face


def test_the_prism_and_the_bounding_box_are_mujocos(shape: Shape) -> None:
    size = SIZES[shape.name]
    name, numbers = shape.mujoco_geom(size)
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}"), size=numbers)
    model = spec.compile()
    np.testing.assert_allclose(model.geom_aabb[0, 3:], shape.half_extents(size))
    hx, hy, hz, r = shape.prism(size)
    np.testing.assert_allclose((hx + r, hy + r, hz), shape.half_extents(size))


def test_footprints_stand_where_they_are_put() -> None:
    assert BOX.footprint((0.2, 0.1, 0.3), (0.4, 0.5), 0.6) == Rectangle(
        (0.4, 0.5), (0.1, 0.05), 0.6
    )
    assert CYLINDER.footprint((0.2, 0.1), (0.4, 0.5), 0.6) == Circle((0.4, 0.5), 0.2)


def test_an_unknown_shape_is_refused_with_the_known_ones() -> None:
    with pytest.raises(DvrError, match="no shape 'ball'; valid: 'box', 'cylinder'"):
        shape_named("ball")
