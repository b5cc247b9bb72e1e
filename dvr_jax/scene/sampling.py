"""Random scenes as in the paper: sizes, positions, turns and the target uniform within ranges, kept when valid.

Beyond the paper a share of the boxes are small cubes (`SceneDistribution.cube_share`).
A whole scene is drawn and thrown away unless it is valid, so the scenes are uniform over the valid ones. In a share of
the scenes (half) an object that is not the goal's is put onto the target; in the others it may stand there by chance.
Scene i of a seed depends on the seed and i alone: a longer draw begins with the shorter one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np

from dvr_jax.errors import DvrError
from dvr_jax.geometry.footprint import inside
from dvr_jax.scene.colours import PALETTE
from dvr_jax.scene.types import Goal, Region, Scene, SceneObject, Shape
from dvr_jax.scene.validation import make_scene
from dvr_jax.workcell.constants import BASE_POSITIONS, MAXIMUM_OBJECTS

ShapeChoice = Literal["box", "cylinder", "mixed"]
"""Which shapes are drawn; "mixed" tosses a coin for each object."""

MOST_DRAWS = 5_000
"""Scenes thrown away before a distribution is given up as impossible."""

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SceneDistribution:
    """Uniform ranges (low, high), in metres unless said otherwise."""

    shape: ShapeChoice = "box"
    """Shapes of the objects."""
    narrow_side: Range = (0.05, 0.075)
    """A box's side that fits between the fingers (8 cm); which of x and y it is, is a coin's toss."""
    wide_side: Range = (0.05, 0.20)
    """A box's other horizontal side."""
    height: Range = (0.04, 0.12)
    """Height of boxes and cylinders."""
    cube_share: float = 0.25
    """Share of the boxes that are small cubes instead. Two hands find no room on one, so it is exchanged on the table
    where another box is handed over: shortest solutions of six actions come of them."""
    cube_side: Range = (0.022, 0.03)
    """Side of a small cube. A gripper's centre lies 1 cm within what it holds; on a cube of 3.5 cm two hands do."""
    goal_radius: Range = (0.02, 0.0375)
    """Radius of a cylinder that is the goal's object: it fits between the fingers."""
    radius: Range = (0.02, 0.08)
    """Radius of the other cylinders: some are too thick to be grasped, and stand in the way for good."""
    target_margin: Range = (0.01, 0.03)
    """The target is a square, longer by this than the goal object's longest horizontal side."""
    x: Range = (-1.0, 1.0)
    """Centres of objects and target along the line through both bases."""
    y: Range = (-0.9, 0.9)
    """Centres of objects and target across it."""
    base_distance: Range = (0.28, 0.95)
    """Distance of every centre from the nearer base: within an arm's reach, not under its shoulder."""
    occupied_share: float = 0.5
    """Share of the scenes in which another object's centre is put onto the target (with two objects or more)."""


DEFAULT_DISTRIBUTION = SceneDistribution()


def sample_scenes(
    number: int, number_of_objects: int, seed: int, distribution: SceneDistribution = DEFAULT_DISTRIBUTION
) -> Iterator[Scene]:
    """Scenes 0 to number - 1 of a seed, one after the other."""
    if number < 1:
        raise DvrError(f"the number of scenes is {number}; valid is 1 or more.")
    if seed < 0:
        raise DvrError(f"the seed is {seed}; valid is 0 or more.")
    _validate_request(number_of_objects, distribution)
    return (scene_of_seed(seed, index, number_of_objects, distribution) for index in range(number))


def scene_of_seed(
    seed: int, index: int, number_of_objects: int, distribution: SceneDistribution = DEFAULT_DISTRIBUTION
) -> Scene:
    """Scene `index` of a seed."""
    return sample_scene(np.random.default_rng([seed, index]), number_of_objects, distribution)


def sample_scene(
    generator: np.random.Generator,
    number_of_objects: int,
    distribution: SceneDistribution = DEFAULT_DISTRIBUTION,
) -> Scene:
    """One valid scene; consumes random numbers from `generator`."""
    _validate_request(number_of_objects, distribution)
    occupied = number_of_objects > 1 and bool(generator.random() < distribution.occupied_share)
    for _ in range(MOST_DRAWS):
        objects, goal, standing_there = _draw(generator, number_of_objects, distribution, occupied)
        # The occupant's centre is drawn on the target, so it alone must be told to be within reach like the others.
        within_reach = standing_there is None or _within_reach(objects[standing_there].position, distribution)
        goal_object = next(item for item in objects if item.name == goal.object)
        if not within_reach or inside(goal_object.footprint, goal.region.footprint):
            continue
        try:
            return make_scene(objects, goal)
        except DvrError:
            continue
    raise DvrError(
        f"none of {MOST_DRAWS} scenes of {number_of_objects} objects drawn from {distribution} was valid; "
        "smaller objects or wider x and y give room."
    )


def _draw(
    generator: np.random.Generator, number_of_objects: int, distribution: SceneDistribution, occupied: bool
) -> tuple[list[SceneObject], Goal, int | None]:
    """A scene's parts, valid or not, and the index of the object that was put onto the target."""
    goal_index = int(generator.integers(number_of_objects))
    names = list(PALETTE)
    objects = []
    for index in range(number_of_objects):
        shape, size = _draw_size(generator, distribution, index == goal_index)
        position, yaw = _draw_position(generator, distribution), generator.uniform(-math.pi, math.pi)
        objects.append(SceneObject(names[index], shape, size, position, yaw))
    longest = 2 * max(objects[goal_index].half_extents[:2])
    side = longest + generator.uniform(*distribution.target_margin)
    region = Region(_draw_position(generator, distribution), generator.uniform(-math.pi, math.pi), (side, side))
    goal = Goal(names[goal_index], region)
    if not occupied:
        return objects, goal, None
    occupant = (goal_index + int(generator.integers(1, number_of_objects))) % number_of_objects
    along, across = (float(share) for share in generator.uniform(-side / 4, side / 4, size=2))
    # No matrix product: libraries order its sums by processor, and a seed's scenes should not depend on that.
    cosine, sine = math.cos(region.yaw), math.sin(region.yaw)
    position = (
        region.position[0] + (along * cosine - across * sine),
        region.position[1] + (along * sine + across * cosine),
    )
    old = objects[occupant]
    objects[occupant] = SceneObject(old.name, old.shape, old.size, position, old.yaw)
    return objects, goal, occupant


def _draw_size(
    generator: np.random.Generator, distribution: SceneDistribution, is_goal: bool
) -> tuple[Shape, tuple[float, ...]]:
    shape: Shape
    shape = ("box" if generator.random() < 0.5 else "cylinder") if distribution.shape == "mixed" else distribution.shape
    height = generator.uniform(*distribution.height)
    if shape == "cylinder":
        return shape, (generator.uniform(*(distribution.goal_radius if is_goal else distribution.radius)), height)
    if distribution.cube_share > 0 and generator.random() < distribution.cube_share:
        side = generator.uniform(*distribution.cube_side)
        return shape, (side, side, side)
    sides = [generator.uniform(*distribution.narrow_side), generator.uniform(*distribution.wide_side)]
    if generator.random() < 0.5:
        sides.reverse()
    return shape, (sides[0], sides[1], height)


def _draw_position(generator: np.random.Generator, distribution: SceneDistribution) -> tuple[float, float]:
    """A point of the table within reach of an arm."""
    for _ in range(MOST_DRAWS):
        position = (generator.uniform(*distribution.x), generator.uniform(*distribution.y))
        if _within_reach(position, distribution):
            return position
    raise DvrError(
        f"no point with x in {distribution.x} and y in {distribution.y} is {distribution.base_distance} m from a base; "
        "widen one of the three."
    )


def _within_reach(position: tuple[float, float], distribution: SceneDistribution) -> bool:
    nearest = min(math.dist(position, base) for base in BASE_POSITIONS)
    return distribution.base_distance[0] <= nearest <= distribution.base_distance[1]


def _validate_request(number_of_objects: int, distribution: SceneDistribution) -> None:
    if not 1 <= number_of_objects <= MAXIMUM_OBJECTS:
        raise DvrError(f"the number of objects is {number_of_objects}; valid are 1 to {MAXIMUM_OBJECTS}.")
    if distribution.shape not in get_args(ShapeChoice):
        raise DvrError(f"the shape is {distribution.shape!r}; valid are {', '.join(get_args(ShapeChoice))}.")
    for name in ("cube_share", "occupied_share"):
        if not 0 <= getattr(distribution, name) <= 1:
            raise DvrError(f"the {name.replace('_', ' ')} is {getattr(distribution, name)}; valid is 0 to 1.")
    for field in fields(distribution):
        value = getattr(distribution, field.name)
        if isinstance(value, tuple) and not (math.isfinite(value[0]) and value[0] <= value[1] < math.inf):
            raise DvrError(f"the range {field.name} is {value}; valid is a finite low no greater than high.")
