"""Random scenes as in the paper: sizes, positions, turns and the goal region uniform within ranges.

Beyond the paper, a share of the boxes are small cubes (`SceneDistribution.cube_share`). A scene is drawn as a whole and
thrown away unless it is valid, so the scenes are uniform over the valid ones. In half of the scenes an object that is
not the goal's is put onto the goal region; in the others it may stand there by chance. Fixed bodies, if wanted, are
drawn after that into places that are still free (`dvr_jax.scene.fixed_sampling`), so the objects of a scene are the
same with and without them.

Scene i of a seed depends on the seed and i alone: a longer draw begins with the shorter one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import inside
from dvr_jax.scene.colors import PALETTE
from dvr_jax.scene.distribution import (
    DEFAULT_DISTRIBUTION,
    SceneDistribution,
    ShapeChoice,
    validate_request,
)
from dvr_jax.scene.fixed_sampling import add_fixed_bodies
from dvr_jax.scene.types import OnRegion, Region, Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.scene.workcell_rules import validate_workcell
from dvr_jax.workcell.workcell import DEFAULT_WORKCELL, Workcell

__all__ = [
    "DEFAULT_DISTRIBUTION",
    "SceneDistribution",
    "ShapeChoice",
    "sample_scene",
    "sample_scenes",
    "scene_of_seed",
]

MOST_DRAWS = 5_000
"""Scenes that are thrown away before a distribution is given up as impossible."""


def sample_scenes(
    number: int,
    number_of_objects: int,
    seed: int,
    distribution: SceneDistribution = DEFAULT_DISTRIBUTION,
    workcell: Workcell = DEFAULT_WORKCELL,
) -> Iterator[Scene]:
    """Draw scenes 0 to `number` - 1 of a seed, one after the other.

    Args:
        number: How many scenes.
        number_of_objects: Objects in each scene.
        seed: A number that decides all scenes.
        distribution: What the scenes are drawn from.
        workcell: Arms and table of all scenes.

    Returns:
        The scenes, each drawn when it is asked for.

    Raises:
        SceneError: An argument is out of range, or no valid scene is found.
    """
    if number < 1:
        raise SceneError(f"the number of scenes is {number}; valid is 1 or more.")
    if seed < 0:
        raise SceneError(f"the seed is {seed}; valid is 0 or more.")

    validate_request(number_of_objects, distribution)
    validate_workcell(workcell)

    return (
        scene_of_seed(seed, index, number_of_objects, distribution, workcell)
        for index in range(number)
    )


def scene_of_seed(
    seed: int,
    index: int,
    number_of_objects: int,
    distribution: SceneDistribution = DEFAULT_DISTRIBUTION,
    workcell: Workcell = DEFAULT_WORKCELL,
) -> Scene:
    """Draw one scene of a seed.

    Args:
        seed: The seed.
        index: Number of the scene, counted from 0.
        number_of_objects: Objects in the scene.
        distribution: What the scene is drawn from.
        workcell: Arms and table of the scene.

    Returns:
        The scene.

    Raises:
        SceneError: An argument is out of range, or no valid scene is found.
    """
    return sample_scene(
        np.random.default_rng([seed, index]), number_of_objects, distribution, workcell
    )


def sample_scene(
    generator: np.random.Generator,
    number_of_objects: int,
    distribution: SceneDistribution = DEFAULT_DISTRIBUTION,
    workcell: Workcell = DEFAULT_WORKCELL,
) -> Scene:
    """Draw one valid scene.

    Args:
        generator: Where random numbers come from; some are consumed.
        number_of_objects: Objects in the scene.
        distribution: What the scene is drawn from.
        workcell: Arms and table of the scene.

    Returns:
        The scene.

    Raises:
        SceneError: An argument is out of range, or no valid scene is found.
    """
    validate_request(number_of_objects, distribution)
    validate_workcell(workcell)
    occupied = number_of_objects > 1 and bool(generator.random() < distribution.occupied_share)

    for _ in range(MOST_DRAWS):
        draft = _draw(generator, number_of_objects, distribution, workcell, occupied)
        scene = _valid_scene(draft, distribution, workcell)
        if scene is not None:
            return add_fixed_bodies(generator, scene, distribution.fixed_bodies)

    raise SceneError(
        f"none of {MOST_DRAWS} scenes of {number_of_objects} objects drawn from {distribution} was valid; "
        "smaller objects or wider x and y give room."
    )


@dataclass(frozen=True, slots=True)
class _Draft:
    """A scene's parts, valid or not."""

    objects: tuple[SceneObject, ...]
    goal_index: int
    goal: OnRegion

    occupant: int | None
    """Index of the object that was put onto the goal region."""


def _valid_scene(
    draft: _Draft, distribution: SceneDistribution, workcell: Workcell
) -> Scene | None:
    """The scene of a draft; None if it breaks a rule, or if its goal holds from the start."""
    if draft.occupant is not None:
        # The occupant's position is drawn on the region: it alone need not be within reach like all others.
        position = draft.objects[draft.occupant].position
        if not _within_reach(position, distribution, workcell):
            return None
    if inside(draft.objects[draft.goal_index].footprint, draft.goal.region.footprint):
        return None

    try:
        return make_scene(draft.objects, draft.goal, workcell)
    except SceneError:
        return None


def _draw(
    generator: np.random.Generator,
    number_of_objects: int,
    distribution: SceneDistribution,
    workcell: Workcell,
    occupied: bool,
) -> _Draft:
    """Draw a scene's parts. The order of the draws is part of what a seed means."""
    goal_index = int(generator.integers(number_of_objects))
    names = list(PALETTE)
    objects = []

    for index in range(number_of_objects):
        shape, size = _draw_size(generator, distribution, index == goal_index)
        position = _draw_position(generator, distribution, workcell)
        yaw = generator.uniform(-math.pi, math.pi)
        objects.append(SceneObject(names[index], shape, size, position, yaw))

    longest = 2 * max(objects[goal_index].half_extents[:2])
    side = longest + generator.uniform(*distribution.target_margin)
    center = _draw_position(generator, distribution, workcell)
    region = Region(center, generator.uniform(-math.pi, math.pi), (side, side))

    occupant = None
    if occupied:
        occupant = (goal_index + int(generator.integers(1, number_of_objects))) % number_of_objects
        objects[occupant] = replace(objects[occupant], position=_draw_on_region(generator, region))

    return _Draft(tuple(objects), goal_index, OnRegion(names[goal_index], region), occupant)


def _draw_on_region(generator: np.random.Generator, region: Region) -> tuple[float, float]:
    """A point of the middle quarter of a square region."""
    side = region.size[0]
    along, across = (float(offset) for offset in generator.uniform(-side / 4, side / 4, size=2))
    # No matrix product: libraries order its sums by processor, and a seed's scenes must not depend on that.
    cosine = math.cos(region.yaw)
    sine = math.sin(region.yaw)

    return (
        region.position[0] + (along * cosine - across * sine),
        region.position[1] + (along * sine + across * cosine),
    )


def _draw_size(
    generator: np.random.Generator,
    distribution: SceneDistribution,
    is_goal: bool,
) -> tuple[str, tuple[float, ...]]:
    """Shape and size of one object."""
    shape: str = distribution.shape
    if shape == "mixed":
        shape = "box" if generator.random() < 0.5 else "cylinder"

    height = generator.uniform(*distribution.height)

    if shape == "cylinder":
        radius = generator.uniform(*(distribution.goal_radius if is_goal else distribution.radius))
        return shape, (radius, height)
    if distribution.cube_share > 0 and generator.random() < distribution.cube_share:
        side = generator.uniform(*distribution.cube_side)
        return shape, (side, side, side)

    narrow = generator.uniform(*distribution.narrow_side)
    wide = generator.uniform(*distribution.wide_side)
    if generator.random() < 0.5:
        return shape, (wide, narrow, height)

    return shape, (narrow, wide, height)


def _draw_position(
    generator: np.random.Generator,
    distribution: SceneDistribution,
    workcell: Workcell,
) -> tuple[float, float]:
    """A point of the table within reach of an arm."""
    for _ in range(MOST_DRAWS):
        x = generator.uniform(*distribution.x)
        y = generator.uniform(*distribution.y)
        if _within_reach((x, y), distribution, workcell):
            return x, y
    raise SceneError(
        f"no point with x in {distribution.x} and y in {distribution.y} is {distribution.base_distance} m from a base; "
        "widen one of the three."
    )


def _within_reach(
    position: tuple[float, float],
    distribution: SceneDistribution,
    workcell: Workcell,
) -> bool:
    nearest = min(math.dist(position, arm.position) for arm in workcell.arms)
    lower, upper = distribution.base_distance

    return lower <= nearest <= upper
