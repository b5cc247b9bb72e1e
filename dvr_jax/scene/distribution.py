"""How random scenes are distributed: the ranges that sizes and positions are drawn from."""

import math
from dataclasses import dataclass, fields
from typing import Literal, get_args

from dvr_jax.errors import SceneError
from dvr_jax.scene.types import MAXIMUM_FIXED_BODIES, MAXIMUM_OBJECTS

ShapeChoice = Literal["box", "cylinder", "mixed"]
"""Which shapes are drawn; "mixed" tosses a coin for each object."""

Range = tuple[float, float]
"""Least and largest value of a uniform distribution."""


@dataclass(frozen=True, slots=True)
class SceneDistribution:
    """Uniform ranges (low, high), in meters unless said otherwise."""

    shape: ShapeChoice = "box"
    """Shapes of the objects."""

    narrow_side: Range = (0.05, 0.075)
    """A box's side that fits between the fingers (8 cm); a coin's toss decides whether it is x or y."""

    wide_side: Range = (0.05, 0.20)
    """A box's other horizontal side."""

    height: Range = (0.04, 0.12)
    """Height of boxes and cylinders."""

    cube_share: float = 0.25
    """Share of the boxes that are small cubes instead. Two hands find no room on a small cube, so it is exchanged on
    the table where another box is handed over; shortest solutions of six actions come from small cubes."""

    cube_side: Range = (0.022, 0.03)
    """Side of a small cube. A gripper's center lies 1 cm within what it holds; a cube of 3.5 cm has room for two."""

    goal_radius: Range = (0.02, 0.0375)
    """Radius of a cylinder that is the goal's object: it fits between the fingers."""

    radius: Range = (0.02, 0.08)
    """Radius of the other cylinders: some are too thick to be grasped, and stand in the way for good."""

    target_margin: Range = (0.01, 0.03)
    """The goal region is a square, longer by this than the goal object's longest horizontal side."""

    x: Range = (-1.0, 1.0)
    """First coordinate of the centers of objects and goal region."""

    y: Range = (-0.9, 0.9)
    """Second coordinate of these centers."""

    base_distance: Range = (0.28, 0.95)
    """Distance of every center from the nearest base: within an arm's reach, and not under its shoulder."""

    occupied_share: float = 0.5
    """Share of the scenes in which another object's center is put onto the goal region (of scenes with two objects or
    more)."""

    fixed_bodies: tuple[int, int] = (0, 0)
    """Least and largest number of fixed bodies."""


DEFAULT_DISTRIBUTION = SceneDistribution()
"""The distribution of the benchmarks and of the shipped networks' training data."""


def validate_request(number_of_objects: int, distribution: SceneDistribution) -> None:
    """Refuse a number of objects or a distribution that cannot be.

    Args:
        number_of_objects: Objects in each scene.
        distribution: The distribution.

    Raises:
        SceneError: A value is out of range; the message names it.
    """
    if not 1 <= number_of_objects <= MAXIMUM_OBJECTS:
        raise SceneError(
            f"the number of objects is {number_of_objects}; valid are 1 to {MAXIMUM_OBJECTS}."
        )
    if distribution.shape not in get_args(ShapeChoice):
        raise SceneError(
            f"the shape is {distribution.shape!r}; valid are {', '.join(get_args(ShapeChoice))}."
        )

    for name in ("cube_share", "occupied_share"):
        share = getattr(distribution, name)
        if not 0 <= share <= 1:
            raise SceneError(f"the {name.replace('_', ' ')} is {share}; valid is 0 to 1.")

    for field in fields(distribution):
        value = getattr(distribution, field.name)
        if isinstance(value, tuple) and not (
            math.isfinite(value[0]) and value[0] <= value[1] < math.inf
        ):
            raise SceneError(
                f"the range {field.name} is {value}; valid is a finite low no greater than high."
            )

    least, most = distribution.fixed_bodies
    if not (
        isinstance(least, int)
        and isinstance(most, int)
        and 0 <= least <= most <= MAXIMUM_FIXED_BODIES
    ):
        raise SceneError(
            f"the range fixed_bodies is {distribution.fixed_bodies}; "
            f"valid are whole numbers from 0 to {MAXIMUM_FIXED_BODIES}."
        )
