"""Problems of public benchmarks, translated to the arms and tables of this package: samplers of their scenes.

Only facts carry over: which bodies there are, how large they are, where they may stand, and what shall hold at the end.
Each family names its source. The robots differ, so the scenes are moved to where the arms of a workcell reach.

The benchmark plans the frozen scenes of `PUBLIC_SCENES`, which `draw_all` drew.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np

from dvr_jax.errors import DvrError, SceneError
from dvr_jax.geometry.footprint import Rectangle, signed_distance
from dvr_jax.goals import Goal, HandsEmpty, Inside, On, Region
from dvr_jax.runtime.json_text import parse_json
from dvr_jax.scene.files import scene_from_json, scene_to_json
from dvr_jax.scene.types import FixedBody, Scene, SceneObject
from dvr_jax.scene.validation import make_scene
from dvr_jax.workcell.workcell import SIDE_BY_SIDE_WORKCELL

PUBLIC_SCENES: Traversable = files("dvr_jax.bench") / "public_scenes.jsonl"
"""The frozen scenes, one on each line, with the name of its family."""

PUBLIC_SEED = 20
"""Seed of the frozen scenes."""

MOST_DRAWS = 10_000
"""Positions and scenes that are thrown away before a sampler is given up."""

BODY_GAP = 1e-3
"""Least distance of the bodies of a scene whose source only asks that they do not overlap [m]."""


@dataclass(frozen=True)
class Family:
    """Scenes of one public problem."""

    name: str
    """Name of the family in commands and files."""

    title: str
    """What has to be done, in a few words."""

    source: str
    """Project, problem and licence."""

    number: int
    """How many scenes there are."""

    draw: Callable[[np.random.Generator, int], Scene]
    """Function of a generator and the scene's number that draws a scene; it raises `SceneError` if the draw is no valid
    scene."""


def draw_scene(family: Family, index: int) -> Scene:
    """Draw one scene of a family; it depends on `PUBLIC_SEED`, the family and the index alone.

    Args:
        family: The family.
        index: Number of the scene within the family, counted from 0.

    Returns:
        A valid scene.

    Raises:
        DvrError: No draw was a valid scene.
    """
    place = [known.name for known in FAMILIES].index(family.name)
    generator = np.random.default_rng([PUBLIC_SEED, place, index])
    for _ in range(MOST_DRAWS):
        try:
            return family.draw(generator, index)
        except SceneError:
            continue
    raise DvrError(f"no valid scene {index} of {family.name!r} was drawn in {MOST_DRAWS} tries.")


def draw_all() -> str:
    """Draw all scenes and return the text of `PUBLIC_SCENES`."""
    lines = [
        json.dumps({"family": family.name, "scene": json.loads(scene_to_json(scene))})
        for family in FAMILIES
        for scene in (draw_scene(family, index) for index in range(family.number))
    ]
    return "\n".join(lines) + "\n"


def read_public_scenes(names: Sequence[str]) -> Iterator[tuple[str, Scene]]:
    """Read the frozen scenes of some families.

    Args:
        names: Names of the families.

    Yields:
        The name of the family, and a scene.

    Raises:
        DvrError: There is no family of one of the names.
    """
    known = [family.name for family in FAMILIES]
    for name in names:
        if name not in known:
            raise DvrError(f"there is no family {name!r}; valid: {', '.join(known)}.")

    for line in PUBLIC_SCENES.read_text(encoding="utf-8").splitlines():
        row = parse_json(line)
        if row["family"] in names:
            yield row["family"], scene_from_json(json.dumps(row["scene"]))


def _uniform(
    generator: np.random.Generator, low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    """Draw a point of a rectangle, rounded to 0.1 mm."""
    x, y = generator.uniform(low, high)
    return (round(float(x), 4), round(float(y), 4))


def _place_apart(
    generator: np.random.Generator,
    size: tuple[float, float],
    low: tuple[float, float],
    high: tuple[float, float],
    others: Sequence[Rectangle],
    gap: float,
) -> tuple[float, float]:
    """Draw the center of a box that keeps a distance from other footprints.

    Args:
        generator: Where random numbers come from.
        size: Extents of the box along x and y [m].
        low: Least x and y of the center [m].
        high: Largest x and y of the center [m].
        others: The other footprints.
        gap: Least distance [m].

    Raises:
        SceneError: There was no room for the box.
    """
    for _ in range(MOST_DRAWS):
        center = _uniform(generator, low, high)
        own = Rectangle(center, (size[0] / 2, size[1] / 2), 0.0)
        if all(signed_distance(own, other) >= gap for other in others):
            return center
    raise SceneError(
        "there is no room for another box; valid is a box that fits between the others."
    )


def _draw_transfer(generator: np.random.Generator, index: int) -> Scene:
    """A 6 cm cube and a patch of 20 x 20 cm anywhere on a table of 35 x 140 cm, at least 25 cm apart.

    The strip of the source, 45 to 80 cm in front of its robot, is moved to 29 to 64 cm beside the line of the bases.
    """
    low = (-0.7, 0.29)
    high = (0.7, 0.64)
    for _ in range(MOST_DRAWS):
        cube = _uniform(generator, low, high)
        patch = _uniform(generator, low, high)
        if np.hypot(cube[0] - patch[0], cube[1] - patch[1]) >= 0.25:
            break
    region = Region(patch, 0.0, (0.2, 0.2), name="patch", inside=Inside.CENTER)
    goal = Goal((On("cube", "patch"), HandsEmpty()))
    item = SceneObject("cube", "box", (0.06, 0.06, 0.06), cube, 0.0)
    return make_scene([item], goal, regions=[region])


def _draw_occupied(generator: np.random.Generator, index: int) -> Scene:
    """A block whose region of 4 to 10 cm is 25 % larger than itself, and 0 to 4 obstructions, most of them on it.

    The table of the source, 40 x 80 cm, begins 22 cm in front of its arm; here it does so in front of the left arm.
    """
    low = np.array([-0.53, -0.4])
    high = np.array([-0.13, 0.4])

    def on_table(size: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
        least = low + size[:2] / 2
        most = high - size[:2] / 2
        return (float(least[0]), float(least[1])), (float(most[0]), float(most[1]))

    # The region, and the block off it.
    region_size = np.round(generator.uniform(0.04, 0.1, 2), 4)
    center = _uniform(generator, *on_table(region_size))
    region = Region(center, 0.0, (float(region_size[0]), float(region_size[1])), name="target")
    sides = np.round(0.8 * region_size, 4)
    block_size = (float(sides[0]), float(sides[1]), 0.05)
    position = _place_apart(
        generator,
        block_size[:2],
        *on_table(sides),
        [region.footprint],
        BODY_GAP,
    )
    objects = [SceneObject("block", "box", block_size, position, 0.0)]

    # Nine of ten obstructions stand on the region, at least in part.
    for number in range(index % 5):
        half = generator.uniform((0.01, 0.01, 0.01), (0.02, 0.02, 0.03))
        size = np.round(2 * half, 4)
        others = [item.footprint for item in objects if isinstance(item.footprint, Rectangle)]
        if generator.uniform() < 0.9:
            reach = (region_size + size[:2]) / 2 - BODY_GAP
            least = (center[0] - float(reach[0]), center[1] - float(reach[1]))
            most = (center[0] + float(reach[0]), center[1] + float(reach[1]))
        else:
            least, most = on_table(size)
            others.append(region.footprint)
        extents = (float(size[0]), float(size[1]), float(size[2]))
        position = _place_apart(generator, extents[:2], least, most, others, BODY_GAP)
        objects.append(SceneObject(f"obstruction{number}", "box", extents, position, 0.0))

    return make_scene(objects, Goal((On("block", "target"), HandsEmpty())), regions=[region])


def _draw_plate(generator: np.random.Generator, index: int) -> Scene:
    """Five blocks of 7 x 7 x 10 cm on a table of 60 x 120 cm, and a plate of 27 x 27 cm in its middle for all of them.

    The blocks stand at least 5 cm from each other and from the plate. The middle is 55 cm in front of the left arm.
    """
    middle = (-0.2, 0.0)
    plate = Region(middle, 0.0, (0.27, 0.27), name="plate")
    objects: list[SceneObject] = []
    for number in range(5):
        taken = [plate.footprint]
        taken += [item.footprint for item in objects if isinstance(item.footprint, Rectangle)]
        position = _place_apart(
            generator,
            (0.07, 0.07),
            (middle[0] - 0.265, middle[1] - 0.565),
            (middle[0] + 0.265, middle[1] + 0.565),
            taken,
            0.05,
        )
        objects.append(SceneObject(f"block{number}", "box", (0.07, 0.07, 0.1), position, 0.0))
    facts = tuple(On(item.name, "plate") for item in objects)
    return make_scene(objects, Goal((*facts, HandsEmpty())), regions=[plate])


def _draw_tray(generator: np.random.Generator, index: int) -> Scene:
    """Two bars on the right of two arms that stand side by side, and a tray on their left with another bar on it."""
    tray = FixedBody("tray", "box", (0.4, 0.4, 0.04), (-0.6, 0.1, 0.02), 0.0)
    bar = (0.2, 0.06, 0.06)
    objects = [
        SceneObject("bar1", "box", bar, (0.4, 0.1), float(np.deg2rad(120))),
        SceneObject("bar2", "box", bar, (0.7, 0.1), float(np.deg2rad(-90))),
        SceneObject("bar3", "box", bar, (-0.6, 0.1), 0.0, support="tray"),
    ]
    top = Region((-0.6, 0.1), 0.0, (0.4, 0.4), name="top", support="tray")
    goal = Goal((On("bar1", "top"), On("bar2", "top"), HandsEmpty()))
    return make_scene(objects, goal, SIDE_BY_SIDE_WORKCELL, fixed=[tray], regions=[top])


def _draw_shelf(generator: np.random.Generator, index: int) -> Scene:
    """One or two blocks of 10 x 5 x 5 cm on the table, and a shelf of two boards whose lower one they belong on.

    The boards are 25.4 x 60.2 cm large, 1.27 cm thick and 25.4 cm apart, with walls on three sides. The open side looks
    at the left arm, whose base is 64 cm in front of the middle.
    """
    thickness = 0.0127
    depth = 0.254
    width = 0.602
    x, y = _uniform(generator, (-0.13, -0.15), (-0.09, 0.15))
    heights = (0.254, 0.508)
    top = heights[1]
    boards = [
        FixedBody(name, "box", (depth, width, thickness), (x, y, height - thickness / 2), 0.0)
        for name, height in zip(("lower", "upper"), heights, strict=True)
    ]
    back = x + (depth + thickness) / 2
    side = (width + thickness) / 2
    walls = [
        FixedBody("back", "box", (thickness, width, top), (back, y, top / 2), 0.0),
        FixedBody("wall1", "box", (depth, thickness, top), (x, y - side, top / 2), 0.0),
        FixedBody("wall2", "box", (depth, thickness, top), (x, y + side, top / 2), 0.0),
    ]
    region = Region((x, y), 0.0, (depth, width), name="board", support="lower")

    objects: list[SceneObject] = []
    size = (0.1, 0.05, 0.05)
    for number in range(1 + index % 2):
        taken = [item.footprint for item in objects if isinstance(item.footprint, Rectangle)]
        position = _place_apart(generator, size[:2], (-0.5, -0.4), (-0.32, 0.4), taken, 0.05)
        objects.append(SceneObject(f"block{number}", "box", size, position, 0.0))

    facts = tuple(On(item.name, "board") for item in objects)
    return make_scene(
        objects, Goal((*facts, HandsEmpty())), fixed=[*boards, *walls], regions=[region]
    )


def _draw_tower(generator: np.random.Generator, index: int) -> Scene:
    """Three cubes of 4, 5 and 4 cm on a square of 40 x 40 cm, turned at random: the small ones go onto the large one.

    The middle of the square is 55 cm in front of the left arm.
    """
    middle = (-0.2, 0.0)
    low = (middle[0] - 0.2, middle[1] - 0.2)
    high = (middle[0] + 0.2, middle[1] + 0.2)
    objects = []
    for name, side in (("top", 0.04), ("bottom", 0.05), ("center", 0.04)):
        yaw = round(float(generator.uniform(-math.pi, math.pi)), 4)
        position = _uniform(generator, low, high)
        objects.append(SceneObject(name, "box", (side, side, side), position, yaw))
    goal = Goal((On("center", "bottom"), On("top", "center"), HandsEmpty()))
    return make_scene(objects, goal)


FAMILIES: tuple[Family, ...] = (
    Family(
        "transfer",
        "a cube onto a patch anywhere on the table; some need a handover",
        "KinDER, VegaPickPlace3D (MIT)",
        40,
        _draw_transfer,
    ),
    Family(
        "occupied",
        "a block onto a region that 0 to 4 other blocks occupy",
        "KinDER, Obstruction3D (MIT)",
        40,
        _draw_occupied,
    ),
    Family(
        "plate",
        "five blocks onto a plate",
        "PDDLStream, packed (GPL-3)",
        20,
        _draw_plate,
    ),
    Family(
        "tray",
        "two bars onto a tray on which another bar lies",
        "rai, two Pandas and a tray (MIT)",
        1,
        _draw_tray,
    ),
    Family(
        "shelf",
        "one or two blocks onto the lower board of a shelf",
        "KinDER, Shelf3D (MIT)",
        20,
        _draw_shelf,
    ),
    Family(
        "tower",
        "three cubes onto each other",
        "MimicGen, StackThree_D1 (NVIDIA Source Code License)",
        20,
        _draw_tower,
    ),
)
"""The families, in the order of the file."""
