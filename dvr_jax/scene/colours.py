"""Colours: which names are colours, which colour an object has, and the goal's red. RGB, 0 to 1."""

from dvr_jax.scene.types import Scene

Colour = tuple[float, float, float]

PALETTE: dict[str, Colour] = {
    "yellow": (0.97, 0.76, 0.13),
    "blue": (0.13, 0.37, 0.78),
    "green": (0.20, 0.62, 0.30),
    "orange": (0.95, 0.49, 0.11),
    "purple": (0.52, 0.29, 0.68),
    "cyan": (0.15, 0.68, 0.76),
    "pink": (0.93, 0.47, 0.66),
    "brown": (0.53, 0.36, 0.23),
    "grey": (0.45, 0.47, 0.50),
    "red": (0.80, 0.25, 0.20),
}
"""Colours by name. An object named after one has it; the others take the free ones in order."""

GOAL_COLOUR: Colour = (0.85, 0.10, 0.10)
"""The goal's spot; no object takes "red" unless it is named so."""


def object_colours(scene: Scene) -> tuple[Colour, ...]:
    """One colour an object (RGB, 0 to 1): the one that it is named after, else the next that nobody took."""
    names = [item.name for item in scene.objects]
    free = iter([colour for name, colour in PALETTE.items() if name not in names and name != "red"])
    return tuple(PALETTE[name] if name in PALETTE else next(free) for name in names)
