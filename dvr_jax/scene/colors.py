"""Colors of what a scene holds: objects, goal region and fixed bodies, as RGB from 0 to 1."""

from dvr_jax.scene.types import Scene

Color = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1."""

PALETTE: dict[str, Color] = {
    "yellow": (0.97, 0.76, 0.13),
    "blue": (0.13, 0.37, 0.78),
    "green": (0.20, 0.62, 0.30),
    "orange": (0.95, 0.49, 0.11),
    "purple": (0.52, 0.29, 0.68),
    "cyan": (0.15, 0.68, 0.76),
    "pink": (0.93, 0.47, 0.66),
    "brown": (0.53, 0.36, 0.23),
    "gray": (0.45, 0.47, 0.50),
    "red": (0.80, 0.25, 0.20),
}
"""Colors of objects by name. An object that is named after a color has that color; the others take the free ones in
this order. Sampled objects are named after the first ones, so the order decides names in scene files."""

SPELLINGS = {"grey": "gray"}
"""Other spellings of the palette's names."""

GOAL_COLOR: Color = (0.85, 0.10, 0.10)
"""Color of the goal region. To keep it apart, no object takes "red" unless it is named so."""

REGION_PALETTE: dict[str, Color] = {
    "red": GOAL_COLOR,
    "teal": (0.10, 0.50, 0.48),
    "olive": (0.50, 0.52, 0.15),
    "plum": (0.55, 0.20, 0.45),
    "navy": (0.15, 0.22, 0.50),
    "rust": (0.62, 0.28, 0.12),
    "slate": (0.32, 0.38, 0.42),
    "moss": (0.25, 0.42, 0.18),
    "wine": (0.45, 0.10, 0.20),
}
"""Colors of regions by name, in the order in which regions take them; the first one is that of the paper's goal."""

FIXED_COLOR: Color = (0.60, 0.59, 0.55)
"""Color of all fixed bodies: darker than the table, grayer than any object."""


def object_color_names(scene: Scene) -> tuple[str, ...]:
    """Name the color of each object: the one that it is named after, else the next one that no object has."""
    names = [SPELLINGS.get(name, name) for name in scene.object_names]
    free = iter([color for color in PALETTE if color not in names and color != "red"])

    return tuple(name if name in PALETTE else next(free) for name in names)


def object_colors(scene: Scene) -> tuple[Color, ...]:
    """Color of each object, in the scene's order."""
    return tuple(PALETTE[name] for name in object_color_names(scene))


def region_color_names(scene: Scene) -> tuple[str, ...]:
    """Name the color of each region, in the order of `Scene.all_regions`."""
    return tuple(REGION_PALETTE)[: len(scene.all_regions)]


def region_colors(scene: Scene) -> tuple[Color, ...]:
    """Color of each region, in the order of `Scene.all_regions`."""
    return tuple(REGION_PALETTE[name] for name in region_color_names(scene))
