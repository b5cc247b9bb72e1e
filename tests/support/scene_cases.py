"""A scene of three objects and its actions, for the tests of several layers."""

from dvr_jax.logic import Action
from dvr_jax.scene.types import OnRegion, Region, SceneObject
from dvr_jax.scene.validation import make_scene

GOAL = OnRegion("yellow", Region((0.3, -0.25), 0.4, (0.22, 0.2)))

SCENE = make_scene(
    [
        SceneObject("yellow", "box", (0.05, 0.16, 0.10), (-0.15, 0.22), 0.5),
        SceneObject("can", "cylinder", (0.035, 0.14), (0.12, -0.2), 0.0),
        SceneObject("green", "box", (0.06, 0.06, 0.18), (0.05, 0.3), 0.3),
    ],
    GOAL,
)
"""Two arms that face each other, two boxes and a cylinder."""


def grasp(arm: str, face: str, item: str) -> Action:
    return Action("grasp", (arm, face, item))


def place(arm: str, item: str, support: str) -> Action:
    return Action("place", (arm, item, support))
