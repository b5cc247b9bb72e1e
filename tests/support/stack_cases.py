"""Scenes of cubes that stand on each other, or shall do so, with the least number of actions by the logic."""

from typing import Any

from dvr_jax.goals import Goal, HandsEmpty, Holding, On, Region
from dvr_jax.scene.types import Scene, SceneObject

PLATE = Region((0.2, 0.0), 0.0, (0.2, 0.2), "plate")
TABLE = "table"


def cube(name: str, x: float, y: float, support: str = TABLE) -> SceneObject:
    return SceneObject(name, "box", (0.05, 0.05, 0.05), (x, y), 0.0, support=support)


APART = (cube("a", -0.3, -0.3), cube("b", -0.3, 0.0), cube("c", -0.3, 0.3))
PILE = (cube("a", -0.3, 0.0), cube("b", -0.3, 0.0, "a"), cube("c", -0.3, 0.0, "b"))
PAIR = (cube("a", -0.3, 0.0), cube("b", -0.3, 0.0, "a"), cube("c", -0.3, 0.3))

CASES: list[tuple[tuple[SceneObject, ...], tuple[Any, ...], int]] = [
    (APART, (On("b", "a"), On("c", "b")), 4),
    (APART, (On("b", "a"), On("a", "plate")), 4),
    (PILE, (On("a", "plate"), HandsEmpty()), 6),
    (PILE, (On("a", "b"), On("b", "c")), 6),
    (PAIR, (On("a", "c"), HandsEmpty()), 4),
    (PAIR, (Holding("left", "a"),), 2),
    (PAIR, (On("a", "b"),), 4),
]
"""Objects, facts, and the least number of actions."""


def scene_of(objects: tuple[SceneObject, ...], facts: tuple[Any, ...]) -> Scene:
    return Scene(objects, Goal(facts), regions=(PLATE,))
