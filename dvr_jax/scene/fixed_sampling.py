"""Random fixed bodies: walls on the table, shelf boards above it, and rims of bins.

They are drawn one after another, each into a place that is free of objects, bases and arms at home and that leaves the
goal region usable. Nothing says that the scene keeps a solution.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dvr_jax.errors import SceneError
from dvr_jax.geometry.footprint import inside
from dvr_jax.scene.mjcf import require_free_home
from dvr_jax.scene.types import FixedBody, Scene
from dvr_jax.scene.validation import validate_scene

MOST_DRAWS = 1_000
"""Bodies that are thrown away before a scene is given up as full."""

WALL_LENGTH = (0.20, 0.60)
"""Lengths of walls [m]."""

WALL_HEIGHT = (0.10, 0.40)
"""Heights of walls [m]: an arm reaches over the lower ones."""

WALL_THICKNESS = (0.02, 0.05)
"""Thicknesses of walls [m]."""

BOARD_LENGTH = (0.30, 0.60)
"""Lengths of shelf boards [m]."""

BOARD_DEPTH = (0.15, 0.30)
"""Depths of shelf boards [m]."""

BOARD_THICKNESS = (0.02, 0.04)
"""Thicknesses of shelf boards [m]."""

BOARD_HEIGHT = (0.25, 0.50)
"""Heights of the undersides of shelf boards above the table [m]."""

BIN_SIDE = (0.20, 0.40)
"""Inner sides of bins [m]."""

RIM_HEIGHT = (0.04, 0.10)
"""Heights of the rims of bins [m]."""

RIM_THICKNESS = 0.015
"""Thickness of the rims of bins [m]."""

RIM_SIDES = 4
"""Sides of a bin."""


def add_fixed_bodies(
    generator: np.random.Generator, scene: Scene, number: tuple[int, int]
) -> Scene:
    """Add random fixed bodies to a scene.

    Args:
        generator: Where random numbers come from; none is consumed if no body is wanted.
        scene: A valid scene.
        number: Least and largest number of bodies that are added.

    Returns:
        The valid scene, in whose initial state nothing penetrates.

    Raises:
        SceneError: No free place was found for a body.
    """
    least, most = number
    if most == 0:
        return scene

    missing = int(generator.integers(least, most + 1))
    while missing > 0:
        bodies = _draw_free(generator, scene, missing)
        scene = replace(scene, fixed=scene.fixed + bodies)
        missing -= len(bodies)

    return scene


def _draw_free(generator: np.random.Generator, scene: Scene, most: int) -> tuple[FixedBody, ...]:
    """Draw one wall, board or rim of at most `most` bodies until it stands free."""
    kinds: tuple[_Draw, ...] = (_draw_wall, _draw_board, _draw_rim)
    draw = kinds[int(generator.integers(len(kinds)))]

    for _ in range(MOST_DRAWS):
        bodies = draw(generator, scene, most)
        if _stand_free(scene, bodies):
            return bodies

    raise SceneError(
        f"none of {MOST_DRAWS} fixed bodies found a free place among {len(scene.objects)} objects and "
        f"{len(scene.fixed)} fixed bodies; fewer of them give room."
    )


def _stand_free(scene: Scene, bodies: tuple[FixedBody, ...]) -> bool:
    """Whether a scene stays valid with these bodies, and all of them are over the table."""
    if not all(inside(body.footprint, scene.workcell.table.footprint) for body in bodies):
        return False

    crowded = replace(scene, fixed=scene.fixed + bodies)

    try:
        validate_scene(crowded)
        require_free_home(crowded)
    except SceneError:
        return False

    return True


_Draw = Callable[[np.random.Generator, Scene, int], tuple[FixedBody, ...]]
"""Draws a wall, board or rim of at most so many bodies, somewhere over the table."""


def _draw_wall(generator: np.random.Generator, scene: Scene, most: int) -> tuple[FixedBody, ...]:
    length = generator.uniform(*WALL_LENGTH)
    thickness = generator.uniform(*WALL_THICKNESS)
    height = generator.uniform(*WALL_HEIGHT)
    x, y, yaw = _draw_pose(generator, scene)

    return (
        FixedBody(
            _new_names(scene, "wall", 1)[0],
            "box",
            (length, thickness, height),
            (x, y, height / 2),
            yaw,
        ),
    )


def _draw_board(generator: np.random.Generator, scene: Scene, most: int) -> tuple[FixedBody, ...]:
    length = generator.uniform(*BOARD_LENGTH)
    depth = generator.uniform(*BOARD_DEPTH)
    thickness = generator.uniform(*BOARD_THICKNESS)
    center = generator.uniform(*BOARD_HEIGHT) + thickness / 2
    x, y, yaw = _draw_pose(generator, scene)

    return (
        FixedBody(
            _new_names(scene, "board", 1)[0],
            "box",
            (length, depth, thickness),
            (x, y, center),
            yaw,
        ),
    )


def _draw_rim(generator: np.random.Generator, scene: Scene, most: int) -> tuple[FixedBody, ...]:
    """The sides of a rectangular bin, or only the first ones where fewer bodies are wanted."""
    inner = (generator.uniform(*BIN_SIDE), generator.uniform(*BIN_SIDE))
    height = generator.uniform(*RIM_HEIGHT)
    x, y, yaw = _draw_pose(generator, scene)
    bodies = []

    for side, name in enumerate(_new_names(scene, "rim", min(most, RIM_SIDES))):
        # Side k lies in the direction of k quarter turns; neighbors overlap in the corners.
        normal = yaw + side * math.pi / 2
        distance = (inner[side % 2] + RIM_THICKNESS) / 2
        center = (
            x + distance * math.cos(normal),
            y + distance * math.sin(normal),
            height / 2,
        )
        length = inner[1 - side % 2] + 2 * RIM_THICKNESS
        bodies.append(FixedBody(name, "box", (RIM_THICKNESS, length, height), center, normal))

    return tuple(bodies)


def _draw_pose(generator: np.random.Generator, scene: Scene) -> tuple[float, float, float]:
    """Position (x, y) on the table [m] and yaw [rad]."""
    half_x, half_y = scene.workcell.table.half_extents
    x = generator.uniform(-half_x, half_x)
    y = generator.uniform(-half_y, half_y)

    return x, y, generator.uniform(-math.pi, math.pi)


def _new_names(scene: Scene, kind: str, number: int) -> list[str]:
    """Names such as "wall2" that neither objects nor fixed bodies of the scene have."""
    taken = {*scene.object_names, *(body.name for body in scene.fixed)}
    names: list[str] = []
    count = 1
    while len(names) < number:
        name = f"{kind}{count}"
        if name not in taken:
            names.append(name)
        count += 1

    return names
