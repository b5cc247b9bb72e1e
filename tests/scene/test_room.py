"""Regions under a base: refused only where no place is left, compared with a search of all places."""

import itertools
import math

import numpy as np
import pytest

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import Circle, Footprint, Rectangle, inside, signed_distance
from dvr_jax.goals import OnRegion, Region
from dvr_jax.scene.room import has_room
from dvr_jax.scene.types import SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.scene.workcell_rules import base_footprints
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL

BASE = DEFAULT_WORKCELL.arms[0]
FEET = base_footprints(BASE, DEFAULT_WORKCELL.robot)


def places(item: Rectangle, region: Rectangle) -> list[Footprint]:
    """The footprint at many places and angles on the region."""
    found: list[Footprint] = []
    for x, y, yaw in itertools.product(
        np.linspace(-1, 1, 25), np.linspace(-1, 1, 25), np.linspace(0, math.pi / 2, 7)
    ):
        center = np.asarray(region.center) + (np.array([x, y]) * region.half) @ region.axes()
        placed = Rectangle((float(center[0]), float(center[1])), item.half, region.yaw + yaw)
        if inside(placed, region):
            found.append(placed)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_what_is_refused_has_no_place(seed: int) -> None:
    generator = np.random.default_rng(seed)
    angle, distance = generator.uniform(0, 2 * math.pi), generator.uniform(0, 0.16)
    center = (
        BASE.position[0] + distance * math.cos(angle),
        BASE.position[1] + distance * math.sin(angle),
    )
    region = Rectangle(center, tuple(generator.uniform(0.04, 0.12, 2)), generator.uniform(-3, 3))
    item = Rectangle((0.0, 0.0), (0.02, 0.03), 0.0)
    is_free = any(
        all(signed_distance(place, foot) >= 0 for foot in FEET) for place in places(item, region)
    )
    assert has_room(item, region, FEET) or not is_free


def test_both_answers_occur() -> None:
    for item in (Rectangle((0, 0), (0.02, 0.02), 0), Circle((0, 0), 0.02)):
        assert not has_room(item, Rectangle(BASE.position, (0.05, 0.05), 0.3), FEET)
        assert has_room(item, Rectangle(BASE.position, (0.2, 0.2), 0.3), FEET)
        assert has_room(item, Rectangle((0.0, 0.0), (0.05, 0.05), 0.3), FEET)


def test_a_region_under_a_base_is_refused() -> None:
    cube = SceneObject("cube", "box", (0.05, 0.05, 0.05), (-0.3, 0.2), 0.0)
    goal = OnRegion("cube", Region(BASE.position, 0.0, (0.12, 0.12)))
    with pytest.raises(
        SceneError, match="lies under the left arm's base and leaves no room for 'cube'"
    ):
        make_scene([cube], goal)
