"""Footprint distances against MuJoCo's `mj_geomDistance` of the same shapes as solids of one height."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvr_jax.geometry.footprint import (
    Circle,
    Footprint,
    Rectangle,
    contains_point,
    covers,
    fits,
    inside,
    signed_distance,
)

lengths = st.floats(0.01, 0.2)
coordinates = st.floats(-0.3, 0.3)
angles = st.floats(-math.pi, math.pi)
rectangles = st.builds(
    Rectangle, st.tuples(coordinates, coordinates), st.tuples(lengths, lengths), angles
)
circles = st.builds(Circle, st.tuples(coordinates, coordinates), lengths)


def mujoco_distance(first: Footprint, second: Footprint) -> float:
    """Distance of the two as boxes and upright cylinders, negative inside."""
    spec = mujoco.MjSpec()
    for shape in (first, second):
        body = spec.worldbody.add_body(pos=[*shape.center, 0.0])
        if isinstance(shape, Circle):
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[shape.radius, 1.0, 0.0])
        else:
            body.quat = [math.cos(shape.yaw / 2), 0, 0, math.sin(shape.yaw / 2)]
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[*shape.half, 1.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 2.0, None))


@settings(max_examples=150, deadline=None)
@given(rectangles | circles, rectangles | circles)
def test_agrees_with_mujoco(first: Footprint, second: Footprint) -> None:
    own = signed_distance(first, second)
    peer = mujoco_distance(first, second)
    assert own == pytest.approx(signed_distance(second, first), abs=1e-12)
    # MuJoCo's distance of solids is iterative, and of deep overlaps an upper bound: magnitudes are compared apart.
    if own > 1e-4:
        assert peer == pytest.approx(own, abs=2e-5)
    elif own < -1e-4:
        assert peer < 1e-6


@settings(max_examples=200, deadline=None)
@given(rectangles, rectangles, st.integers(0, 2**32 - 1))
def test_inside_and_overlap_by_sampled_points(
    inner: Rectangle, outer: Rectangle, seed: int
) -> None:
    local = np.random.default_rng(seed).uniform(-1, 1, (40, 2))
    points = np.asarray(inner.center) + (local * np.asarray(inner.half)) @ inner.axes()
    contained = [contains_point((float(x), float(y)), outer) for x, y in points]
    if inside(inner, outer):
        assert all(contained)
    if signed_distance(inner, outer) > 1e-9:
        assert not any(contained)


def test_known_distances() -> None:
    square = Rectangle((0.0, 0.0), (1.0, 1.0), math.pi / 4)
    assert signed_distance(square, Circle((3.0, 0.0), 0.5)) == pytest.approx(3 - math.sqrt(2) - 0.5)
    assert signed_distance(square, Circle((0.0, 0.0), 0.5)) == pytest.approx(-1.5)
    assert signed_distance(square, Rectangle((4.0, 0.0), (1.0, 3.0), 0.0)) == pytest.approx(
        3 - math.sqrt(2)
    )
    assert signed_distance(Circle((0.0, 0.0), 1.0), Circle((3.0, 4.0), 1.5)) == pytest.approx(2.5)
    assert inside(Circle((0.0, 0.0), 1.0), square) and not inside(Circle((0.01, 0.0), 1.0), square)


@settings(deadline=None, max_examples=200)
@given(st.tuples(*[st.floats(0.01, 0.3)] * 2), st.tuples(*[st.floats(0.01, 0.3)] * 2))
def test_what_fits_fits_at_some_angle(
    half: tuple[float, float], sides: tuple[float, float]
) -> None:
    angle = np.linspace(0, np.pi, 20_001)
    c = np.abs(np.cos(angle))
    s = np.abs(np.sin(angle))
    spare = np.minimum(
        sides[0] - 2 * (half[0] * c + half[1] * s), sides[1] - 2 * (half[0] * s + half[1] * c)
    ).max()
    if abs(spare) > 1e-4:  # else the angles tried are too few
        assert fits(Rectangle((1.0, 2.0), half, 0.3), sides) == (spare > 0)


def test_a_circle_fits_by_its_diameter() -> None:
    assert fits(Circle((0.0, 0.0), 0.1), (0.3, 0.2)) and not fits(
        Circle((0.0, 0.0), 0.11), (0.2, 0.3)
    )


@settings(max_examples=200, deadline=None)
@given(rectangles | circles, rectangles, st.integers(0, 2**32 - 1))
def test_a_footprint_covers_what_has_no_point_outside(
    outer: Footprint, inner: Rectangle, seed: int
) -> None:
    """A disc and a rectangle are convex, so points of the inner one's border decide."""
    corners = inner.corners()
    weights = np.random.default_rng(seed).dirichlet(np.full(4, 0.2), size=400)
    points = np.concatenate([corners, weights @ corners])
    distances = [signed_distance(Circle((x, y), 0.0), outer) for x, y in points]
    if max(distances) > 1e-6:
        assert not covers(outer, inner)
    elif max(distances[:4]) < -1e-6:
        assert covers(outer, inner)


def test_the_border_is_covered() -> None:
    square = Rectangle((0.1, 0.2), (0.05, 0.05), 0.4)
    assert covers(square, square)
    assert covers(Circle((0.1, 0.2), 0.05 * math.sqrt(2)), square)
    assert not covers(Circle((0.1, 0.2), 0.05 * math.sqrt(2) - 1e-6), square)


def test_a_disc_covers_smaller_discs() -> None:
    outer = Circle((0.1, 0.2), 0.05)
    assert covers(outer, Circle((0.1, 0.23), 0.02)) and not covers(
        outer, Circle((0.1, 0.23), 0.021)
    )
    assert covers(outer, Circle((0.1, 0.23), 0.021), 2e-3)
